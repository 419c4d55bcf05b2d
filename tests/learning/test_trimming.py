# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.edges import MOST_ESTIMATED, MOST_EVEN
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.trimming import edges_of, make_units, trim
from strategies import samples

SHARES = st.sampled_from([None, 0.0, 0.01, 0.05, 0.3, 0.9])


def trims(values, contamination=None, families=(), limits=None):
    return trim(make_units(values, families, limits), contamination)


def outside(values, contamination, families=(), limits=None):
    """Return the share of the samples outside all intervals together."""
    units = make_units(values, families, limits)
    inside = np.ones(len(values), dtype=bool)
    for unit, cut in zip(units, trim(units, contamination), strict=True):
        if cut is not None:
            inside &= (unit.smallest >= cut.low) & (unit.largest <= cut.high)
    return 1.0 - inside.mean()


@effort(max_examples=80)
@given(samples(), SHARES, st.booleans())
def test_no_more_than_the_share_is_outside_and_bounds_are_samples(values, share, together):
    families = [range(values.shape[1])] if together and values.shape[1] > 1 else ()
    limits = np.stack([values.min(axis=0) - 1.0, values.max(axis=0)], axis=1)
    limits[:] = limits[:, 0].min(), limits[:, 1].max()
    most = MOST_ESTIMATED if share is None else share
    if share is None:
        ends = [end for unit in make_units(values, families, limits) for end in edges_of(unit)]
        most += MOST_EVEN * sum(end is not None and end.is_even for end in ends)
    assert outside(values, share, families, limits) <= most + 1e-12
    for unit, cut in zip(
        make_units(values, families, limits), trims(values, share, families, limits), strict=True
    ):
        if cut is not None:
            assert cut.extent == (unit.smallest.min(), unit.largest.max())
            assert cut.low in unit.smallest
            assert cut.high in unit.largest
            assert cut.low <= cut.high


@given(st.integers(0, 2**32 - 1), SHARES)
def test_the_order_of_samples_does_not_matter(seed, share):
    rng = np.random.default_rng(seed)
    values = np.round(rng.normal(size=(400, 5)), 3)
    families = [(1, 2, 3)]
    limits = np.full((5, 2), [-9.0, 9.0])
    assert trims(values, share, families, limits) == trims(
        rng.permutation(values), share, families, limits
    )


def test_samples_far_out_are_left_outside_and_a_flat_end_is_not_cut():
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.uniform(0.0, 1.0, (2000, 2)), [[9.0, 0.5]] * 10])
    cut, flat = trims(values)
    assert cut.high == values[:2000, 0].max()
    assert (flat.low, flat.high) == flat.extent
    # The more is bought, the purer.
    assert cut.impurity < flat.impurity


def test_a_stated_share_is_spent_where_it_buys_most():
    rng = np.random.default_rng(1)
    thin = np.where(rng.random(5000) < 0.02, rng.uniform(1.0, 9.0, 5000), rng.random(5000))
    values = np.column_stack([thin, rng.random(5000)])
    cut, flat = trims(values, 0.03)
    assert cut.high < 1.2
    assert 0.02 < outside(values, 0.03) <= 0.03
    assert flat.high - flat.low > 0.98


def walk(rng, share_within, radius=0.2, reach=3.0, samples=20000):
    """Sectors of one who moves freely, but enters within ``radius`` less often than that."""
    distance = np.sqrt(rng.random(samples)) * radius / np.sqrt(MOST_ESTIMATED)
    near = distance < radius
    moved = near & (rng.random(samples) < 1.0 - share_within)
    # Who keeps clear is a bit further away instead.
    distance[moved] = radius * rng.uniform(1.0, 1.4, moved.sum())
    sectors = np.zeros((samples, 8))
    sectors[np.arange(samples), rng.integers(0, 8, samples)] = 1.0 - distance / reach
    return sectors


@pytest.mark.parametrize('share_within', [1.0, 0.5, 0.1, 0.0])
def test_a_family_ends_at_the_same_distance_however_well_the_demonstrator_heeded(share_within):
    sectors = walk(np.random.default_rng(2), share_within)
    (cut,) = trims(sectors, None, [range(8)], np.full((8, 2), [0.0, 1.0]))
    assert 3.0 * (1.0 - cut.high) == pytest.approx(0.2, rel=0.05)
    # Empty sectors are too many to be cut.
    assert cut.low == 0.0


def test_ranges_end_on_the_lower_side():
    """A scanner that gives distances is the mirror image of a lidar that gives nearness."""
    sectors = walk(np.random.default_rng(3), 0.3)
    (near,) = trims(sectors, None, [range(8)], np.full((8, 2), [0.0, 1.0]))
    (far,) = trims(1.0 - sectors, None, [range(8)], np.full((8, 2), [0.0, 1.0]))
    assert far.low == pytest.approx(1.0 - near.high, abs=1e-12)
    assert far.high == 1.0


def test_units_that_are_not_eligible():
    rng = np.random.default_rng(4)
    values = np.column_stack(
        [np.ones(5000), rng.integers(0, 3, 5000), rng.normal(size=5000) * 1e301, rng.random(5000)]
    )
    assert [cut is None for cut in trims(values, 0.1)] == [True, True, True, False]


def test_a_chain_is_ordered_by_what_its_cuts_buy():
    rng = np.random.default_rng(5)
    values = rng.random((3000, 3))
    values[:5, 1], values[:5, 2] = 7.0, 70.0
    tree = fit_safe_set(values, OCTreeSettings(contamination=0.01))
    assert tree.feature == 2
    assert tree.branches[0].node.feature == 1
    assert fit_safe_set(values, OCTreeSettings(contamination=0.01, max_depth=1)).depth == 1


def worsened(rng, share, radius=0.2, reach=3.0):
    """Sectors of one who keeps a distance, but for a share of the samples, anywhere within it."""
    sectors = walk(rng, 0.05)
    distance = radius * np.sqrt(rng.random(int(share * len(sectors))))
    rows = rng.choice(len(sectors), len(distance), replace=False)
    sectors[rows] = 0.0
    sectors[rows, rng.integers(0, 8, len(rows))] = 1.0 - distance / reach
    return sectors


BOUNDED = np.full((8, 2), [0.0, 1.0])


@pytest.mark.parametrize('share', [0.02, 0.05, 0.1, 0.15])
def test_bad_samples_do_not_move_the_edge_however_many_they_are(share):
    sectors = worsened(np.random.default_rng(4), share)
    (cut,) = trims(sectors, None, [range(8)], BOUNDED)
    assert 3.0 * (1.0 - cut.high) == pytest.approx(0.2, rel=0.06)
    assert outside(sectors, None, [range(8)], BOUNDED) == pytest.approx(share, abs=0.012)


def test_a_stated_share_goes_to_bad_samples_first():
    rng = np.random.default_rng(5)
    values = np.column_stack([worsened(rng, 0.1), rng.normal(size=(20000, 3))])
    limits = np.concatenate([BOUNDED, np.full((3, 2), [-np.inf, np.inf])])
    for share in (0.02, 0.05, 0.1):
        (cut, *others) = trims(values, share, [range(8)], limits)
        assert np.mean(values[:, :8].max(axis=1) > cut.high) == pytest.approx(share, abs=1e-4)
        assert all((other.low, other.high) == other.extent for other in others)
    # What is stated beyond that is spent as well.
    assert outside(values, 0.15, [range(8)], limits) == pytest.approx(0.15, abs=0.01)


def test_who_drives_along_walls_is_not_taken_for_bad():
    rng = np.random.default_rng(6)
    sectors = walk(rng, 0.0)
    along = rng.choice(len(sectors), len(sectors) // 5, replace=False)
    sectors[along, 0] = 1.0 - rng.uniform(0.12, 0.18, len(along)) / 3.0
    assert outside(sectors, None, [range(8)], BOUNDED) <= MOST_ESTIMATED + 1e-12


def test_idle_sensors_at_the_end_of_their_range_are_not_bad():
    rng = np.random.default_rng(7)
    ranges = 3.0 * (1.0 - walk(rng, 0.3))
    # Nearly everywhere something is in range, except in a tenth of the samples.
    ranges *= rng.uniform(0.3, 0.7, len(ranges))[:, np.newaxis]
    ranges[rng.choice(len(ranges), len(ranges) // 10, replace=False)] = 3.0
    limits = np.full((8, 2), [0.0, 3.0])
    assert outside(ranges, None, [range(8)], limits) <= MOST_ESTIMATED + 1e-12
