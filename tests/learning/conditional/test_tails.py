# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.learning.conditional.tails import find_glitches, flat_tails
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Unit

UNIT = Unit('x', (0,), (BELOW, ABOVE))


def slow(rng, rows):
    """Return a slow feature within 2 to 8."""
    return 5 + 3 * np.sin(np.cumsum(rng.normal(0, 0.1, rows)))


def calm(rows=200):
    """Return small steps to and fro."""
    return np.tile([0.0, 0.1, 0.2, 0.1], rows // 4)


def test_a_glitch_jumps_in_and_out():
    column, goes_on = calm(), np.ones(200, dtype=bool)
    column[40] = 5.0
    column[80:84] = 4.0, 4.1, 4.2, 4.1
    assert np.flatnonzero(find_glitches(column, goes_on)).tolist() == [40]


def test_at_the_ends_of_an_episode_one_neighbour_decides():
    column, goes_on = calm(), np.ones(200, dtype=bool)
    goes_on[[99, 199]] = False
    column[[0, 99]] = 5.0, 7.0
    column[100:] += 3
    assert np.flatnonzero(find_glitches(column, goes_on)).tolist() == [0, 99]
    # An episode of one sample has no neighbour.
    goes_on[98] = False
    assert np.flatnonzero(find_glitches(column, goes_on)).tolist() == [0]


def test_a_feature_that_jumps_of_its_own_accord_has_no_glitches():
    rng = np.random.default_rng(0)
    often, always_there = calm(4_000), calm(4_000)
    often[::9] = rng.uniform(-5, 5, len(often[::9]))
    always_there[::50] = rng.choice([-5.0, 5.0], len(always_there[::50]))
    for column in (often, always_there):
        assert not find_glitches(column, np.ones(4_000, dtype=bool)).any()


def test_what_hardly_ever_changes_has_no_glitches():
    column = np.zeros(100)
    column[::30] = 1.0
    assert not find_glitches(column, np.ones(100, dtype=bool)).any()


def test_a_tail_of_bad_samples_is_cut_where_the_good_ones_begin():
    rng = np.random.default_rng(0)
    column = slow(rng, 10_000)
    bad = rng.random(len(column)) < 0.03
    column[bad] = rng.uniform(0, 8, bad.sum())
    found = flat_tails(0, UNIT, column, find_glitches(column, np.ones(len(column), bool)))
    assert [cut.side for cut in found] == [BELOW]
    assert 1.8 < found[0].bound < 2.1


def test_the_tails_of_good_samples_stay():
    rng = np.random.default_rng(0)
    goes_on = np.ones(10_000, dtype=bool)
    walk = np.cumsum(rng.normal(size=10_000)) / 30
    for column in (
        slow(rng, 10_000),
        rng.normal(size=10_000),
        np.exp(rng.normal(size=10_000)),
        walk,
    ):
        assert flat_tails(0, UNIT, column, find_glitches(column, goes_on)) == []


def test_visits_that_last_are_no_bad_samples():
    rng = np.random.default_rng(0)
    column = slow(rng, 10_000)
    for start in rng.integers(0, 9_990, 60):
        column[start : start + 6] = rng.uniform(0, 2)
    assert flat_tails(0, UNIT, column, find_glitches(column, np.ones(10_000, bool))) == []
