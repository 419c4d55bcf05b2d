# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.learning.density import Density, bandwidth, estimate
from occ_constraints_pkg.learning.division import (
    assess_and_shrink,
    clip,
    divide,
    impurity,
    is_eligible,
    revise,
)
from occ_constraints_pkg.learning.settings import OCTreeSettings
from scipy.stats import norm


def three_modes():
    """Two modes that run into each other and one apart, as in the article's example."""
    one = norm.ppf((np.arange(10_000) + 0.5) / 10_000)
    return np.concatenate([one, one + 6.0, one + 20.0])


def test_the_articles_example_step_by_step():
    ordered = np.sort(three_modes())
    density = estimate(ordered)
    level = 0.05 * density.values.max()
    pieces = clip(density, level)
    assert len(pieces) == 2
    (first, second), (third, fourth) = pieces
    for end in (first, second, third, fourth):
        assert density.at(np.array([end])) == pytest.approx(level)
    assert first < 0.0 < 6.0 < second < third < 20.0 < fourth

    revised = revise(density, pieces, 0.5)
    valley = revised[0][1]
    assert revised == [(first, valley), (valley, second), (third, fourth)]
    assert valley == pytest.approx(3.0, abs=0.1)

    intervals, counts = assess_and_shrink(ordered, revised, 10)
    assert len(intervals) == 3
    for (left, right), (low, high), count in zip(intervals, revised, counts, strict=True):
        inside = ordered[(ordered >= low) & (ordered <= high)]
        assert (left, right) == (inside.min(), inside.max())
        assert count == len(inside)


def density_of(values):
    values = np.array(values, dtype=np.float64)
    return Density(np.arange(len(values), dtype=np.float64), values, 1.0)


@pytest.mark.parametrize(
    ('level', 'pieces'),
    [
        (0.0, [(0.0, 6.0)]),
        (1.0, [(0.5, 3.75), (4.25, 6.0)]),
        (2.0, [(1.0, 3.5), (4.5, 5.5)]),
        (3.0, [(2.5, 3.25), (4.75, 5.25)]),
        (4.0, [(3.0, 3.0), (5.0, 5.0)]),
    ],
)
def test_clip_ends_where_the_density_crosses_the_level(level, pieces):
    found = clip(density_of([0.0, 2.0, 2.0, 4.0, 0.0, 4.0, 0.0]), level)
    expected = pieces if level != 1.0 else [(0.5, 3.75), (4.25, 5.75)]
    assert found == expected


@pytest.mark.parametrize(
    ('alpha', 'cuts'),
    [(0.0, []), (0.24, []), (0.25, [2.0]), (0.5, [2.0]), (0.75, [2.0, 5.0]), (1.0, [2.0, 5.0])],
)
def test_significant_minima_split(alpha, cuts):
    # Minima 1 between 4 and 8, and 3 between 8 and 4.
    density = density_of([0.0, 4.0, 1.0, 8.0, 5.0, 3.0, 4.0, 0.0])
    ends = [0.5, *cuts, 7.0]
    assert revise(density, [(0.5, 7.0)], alpha) == list(zip(ends[:-1], ends[1:], strict=True))


def test_as_many_pieces_as_modes_are_left_alone():
    density = density_of([0.0, 4.0, 0.0, 4.0, 0.0])
    pieces = [(0.5, 1.5), (2.5, 3.5)]
    assert revise(density, pieces, 1.0) == pieces
    # One mode that is clipped in two: no split either.
    assert revise(density_of([0.0, 1.0, 2.0, 1.0, 0.0]), pieces, 1.0) == pieces


@pytest.mark.parametrize(
    ('least', 'intervals', 'counts'),
    [
        (0.0, [[1, 2], [3, 3], [7, 8]], [3, 1, 2]),
        (2.0, [[1, 2], [7, 8]], [3, 2]),
        (2.5, [[1, 2]], [3]),
        (4.0, [], []),
    ],
)
def test_pieces_with_few_samples_are_dropped_and_the_rest_shrunk(least, intervals, counts):
    ordered = np.array([0.0, 1.0, 2.0, 2.0, 3.0, 7.0, 8.0, 9.0])
    # A sample on the border of two pieces belongs to the right one; one piece is empty.
    pieces = [(0.5, 3.0), (3.0, 3.5), (4.0, 6.0), (6.5, 8.0)]
    found, sizes = assess_and_shrink(ordered, pieces, least)
    assert found.tolist() == intervals
    assert sizes.tolist() == counts


@settings(max_examples=50)
@given(st.lists(st.integers(0, 12), min_size=3, max_size=40), st.data())
def test_impurity_is_the_articles_sum(numbers, data):
    ordered = np.sort(np.array(numbers, dtype=np.float64))
    assume(ordered[0] < ordered[-1])
    low, high = (
        ordered[0] - data.draw(st.integers(0, 3)),
        ordered[-1] + data.draw(st.integers(0, 3)),
    )
    ends = sorted(data.draw(st.sets(st.sampled_from(numbers), min_size=1)))
    ends = ends if len(ends) % 2 == 0 else [*ends, ends[-1]]
    intervals = np.array(ends, dtype=np.float64).reshape(-1, 2)
    counts = np.array([np.sum((ordered >= a) & (ordered <= b)) for a, b in intervals])

    # The parts in turn: gap, interval, gap, interval, ..., gap.
    inside = np.zeros(2 * len(intervals) + 1)
    for number in ordered:
        left_behind = sum(right < number for _, right in intervals)
        hit = any(left <= number <= right for left, right in intervals)
        inside[2 * left_behind + hit] += 1
    edges = [low, *intervals.ravel(), high]
    expected = 0.0
    for share, left, right in zip(inside, edges[:-1], edges[1:], strict=True):
        outliers = len(ordered) * (right - left) / (high - low)
        expected += share * outliers / (share + outliers) if share + outliers else 0.0
    assert impurity(ordered, intervals, counts, (low, high)) == pytest.approx(expected)


def test_a_tight_interval_is_purer_than_a_wide_one():
    ordered = np.linspace(0.0, 1.0, 101)
    tight, wide = np.array([[0.4, 0.6]]), np.array([[0.0, 1.0]])
    dense = np.sort(np.concatenate([ordered, np.full(900, 0.5)]))
    assert impurity(dense, tight, np.array([921]), (0.0, 1.0)) < impurity(
        dense, wide, np.array([1001]), (0.0, 1.0)
    )


def _eligible(ordered):
    return ordered[0] < ordered[-1] and is_eligible(ordered, bandwidth(ordered))


def test_eligible_are_attributes_that_vary_and_are_not_quantised():
    rng = np.random.default_rng(0)
    assert _eligible(np.sort(rng.normal(size=100)))
    assert not _eligible(np.zeros(100))
    assert not _eligible(np.zeros(1))
    # h = 0.9 * 0.5 * 1000^-0.2 = 0.11 is below the step, 1.
    assert not _eligible(np.sort(rng.integers(0, 2, size=1000).astype(np.float64)))
    # Whole numbers from a wide range are as good as continuous.
    assert _eligible(np.sort(rng.integers(0, 1000, size=1000).astype(np.float64)))


def test_a_spike_cuts_off_the_rest_by_density_only():
    rng = np.random.default_rng(3)
    lidar = np.where(rng.random(20_000) < 0.7, 0.0, rng.beta(2.0, 3.0, size=20_000))
    ordered, extent = np.sort(lidar), (0.0, lidar.max())
    by_density = OCTreeSettings(clip='density', gamma=0.05)
    article = divide(ordered, extent, len(ordered), by_density)
    ours = divide(ordered, extent, len(ordered), OCTreeSettings(), (0.0, 0.9))
    assert article.counts.sum() < 0.8 * len(ordered)
    assert ours.counts.sum() == np.count_nonzero(ordered <= 0.9)
    assert ours.intervals.tolist() == [[0.0, ordered[ordered <= 0.9].max()]]


def test_divide_says_nothing_when_nothing_is_gained():
    ordered = np.sort(np.random.default_rng(4).normal(size=100))
    extent = ordered[0], ordered[-1]
    keep_all = OCTreeSettings(alpha=0.0)
    assert divide(ordered, extent, 100, keep_all, extent) is None
    assert divide(ordered * 1e302, (-1e303, 1e303), 100, keep_all, (-1e301, 1e301)) is None
    assert divide(np.ones(100), (1.0, 1.0), 100, keep_all, (1.0, 1.0)) is None
    # A wider box, as splits of other features leave it, does shrink.
    shrunk = divide(ordered, (-9.0, 9.0), 100, keep_all, extent)
    assert shrunk.intervals.tolist() == [[ordered[0], ordered[-1]]]
    assert shrunk.counts.tolist() == [100]
    # No piece holds as many samples as beta asks for.
    assert divide(ordered, extent, 10**9, keep_all, (-1.0, 1.0)) is None
