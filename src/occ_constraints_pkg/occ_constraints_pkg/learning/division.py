# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Division of one attribute into target intervals (OC-tree article, p. 10 to 14).

Pages are those of the accepted manuscript, arXiv:1805.05021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from occ_constraints_pkg.learning.density import Density, bandwidth, estimate
from occ_constraints_pkg.learning.settings import OCTreeSettings

# Attributes with larger values are not divided: their range or bandwidth could overflow.
LARGEST = 1e300
# Minimum bandwidth in units of the spacing of floats: a grid has up to 32 cells per bandwidth.
_LEAST_RESOLUTION = 64
# Steps between neighbouring values that are checked at once.
_STEPS_AT_ONCE = 4096


@dataclass(frozen=True)
class Division:
    """Disjoint closed intervals of one attribute, in ascending order.

    Attributes:
        intervals: (m, 2) left and right bounds, both belonging to the interval.
        counts: (m,) training samples inside each.
        impurity: the article's proxy of the Gini impurity; smaller is purer.
    """

    intervals: np.ndarray
    counts: np.ndarray
    impurity: float


def divide(
    ordered: np.ndarray,
    extent: tuple[float, float],
    total: int,
    settings: OCTreeSettings,
    kept: tuple[float, float] | None = None,
) -> Division | None:
    """Divide one attribute at one node: clip, revise, assess, shrink, and rate the result.

    The steps and their order are the article's (p. 10-11, steps a to d; impurity p. 12-13).

    Args:
        ordered: (n,) the node's values of the attribute, ascending.
        extent: the node's present interval of the attribute.
        total: number of samples the whole tree is trained on.
        settings: the learner's parameters.
        kept: for clipping by mass: the attribute's interval, see
            :mod:`~occ_constraints_pkg.learning.trimming`.

    Returns:
        The division, or ``None`` when the attribute is not eligible, no interval holds enough
        samples, or the one interval found is the node's own.
    """
    if max(-extent[0], extent[1]) > LARGEST or ordered[0] == ordered[-1]:
        return None
    h = bandwidth(ordered)
    if not is_eligible(ordered, h):
        return None
    density = estimate(ordered, h)
    level = settings.gamma * float(density.values.max())
    pieces = clip(density, level) if kept is None else [kept]
    pieces = revise(density, pieces, settings.alpha)
    intervals, counts = assess_and_shrink(ordered, pieces, settings.beta * total)
    if not len(intervals) or (len(intervals) == 1 and tuple(intervals[0]) == extent):
        return None
    return Division(intervals, counts, impurity(ordered, intervals, counts, extent))


def divide_family(
    smallest: np.ndarray,
    largest: np.ndarray,
    extent: tuple[float, float],
    kept: tuple[float, float],
) -> Division | None:
    """Shrink the one interval of all features of a family, for clipping by mass.

    Args:
        smallest: (n,) the smallest member of each of the node's samples.
        largest: (n,) the largest member.
        extent: the node's present interval of the family.
        kept: the family's interval, see :mod:`~occ_constraints_pkg.learning.trimming`.

    Returns:
        The division into one interval, or ``None`` when that is the node's own or empty.
    """
    inside = (smallest >= kept[0]) & (largest <= kept[1])
    if not inside.any():
        return None
    intervals = np.array([[smallest[inside].min(), largest[inside].max()]])
    if tuple(intervals[0]) == extent:
        return None
    counts = np.array([np.count_nonzero(inside)])
    return Division(intervals, counts, impurity(np.sort(largest), intervals, counts, extent))


def is_eligible(ordered: np.ndarray, h: float) -> bool:
    """Return whether an attribute may be divided (article, p. 12-14, rules 1 and 3).

    These are rules of local pre-pruning; rule 2 is in `octree`. It is not eligible if all values
    are equal, or if the bandwidth is below the smallest step between distinct values: the data are
    then quantised and have no density. Far from 0, floats themselves are quantised.

    Args:
        ordered: (n,) ascending values.
        h: their bandwidth.
    """
    if h < _LEAST_RESOLUTION * np.spacing(max(-ordered[0], ordered[-1])):
        return False
    # One small step suffices, and it is usually among the first.
    for start in range(0, len(ordered) - 1, _STEPS_AT_ONCE):
        steps = np.diff(ordered[start : start + _STEPS_AT_ONCE + 1])
        if ((steps > 0) & (steps <= h)).any():
            return True
    return False


def clip(density: Density, level: float) -> list[tuple[float, float]]:
    """Return the stretches where the density is at least ``level`` (article, p. 10, step a).

    Ends lie where the density, linear between grid points, crosses the level.
    """
    inside = np.concatenate(([False], density.values >= level, [False]))
    rises = np.flatnonzero(~inside[:-1] & inside[1:])
    falls = np.flatnonzero(inside[:-1] & ~inside[1:]) - 1
    return [
        (_crossing(density, start - 1, start, level), _crossing(density, end, end + 1, level))
        for start, end in zip(rises.tolist(), falls.tolist(), strict=True)
    ]


def _crossing(density: Density, left: int, right: int, level: float) -> float:
    if left < 0:
        return float(density.grid[0])
    if right >= len(density.grid):
        return float(density.grid[-1])
    below, above = density.values[left], density.values[right]
    share = (level - below) / (above - below)
    return float(density.grid[left] + share * (density.grid[right] - density.grid[left]))


def revise(
    density: Density, pieces: list[tuple[float, float]], alpha: float
) -> list[tuple[float, float]]:
    """Split pieces at significant minima of the density (article, p. 10-11, step b).

    A minimum between two neighbouring maxima is significant when it is at most ``alpha`` times
    the lower of the two; with alpha 0 none is. Nothing is split unless there are more modes than
    pieces.
    """
    peaks, _ = find_peaks(np.concatenate(([0.0], density.values, [0.0])))
    peaks -= 1
    if alpha == 0.0 or len(peaks) <= len(pieces):
        return pieces
    cuts = []
    for left, right in zip(peaks[:-1], peaks[1:], strict=True):
        lowest = left + int(np.argmin(density.values[left : right + 1]))
        heights = density.values[left], density.values[right]
        if density.values[lowest] <= alpha * min(heights):
            cuts.append(float(density.grid[lowest]))
    revised: list[tuple[float, float]] = []
    for low, high in pieces:
        ends = [low, *(cut for cut in cuts if low < cut < high), high]
        revised.extend(zip(ends[:-1], ends[1:], strict=True))
    return revised


def assess_and_shrink(
    ordered: np.ndarray, pieces: list[tuple[float, float]], least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Drop pieces with fewer than ``least`` samples, shrink the rest (article, p. 11, steps c, d).

    Pieces are half-open where they touch, so no sample belongs to two.

    Returns:
        (m, 2) smallest and largest sample of each piece kept, and (m,) their sample counts.
    """
    starts = np.searchsorted(ordered, [low for low, _ in pieces], side='left')
    ends = np.searchsorted(ordered, [high for _, high in pieces], side='right')
    ends[:-1] = np.minimum(ends[:-1], starts[1:])
    counts = ends - starts
    keep = (counts > 0) & (counts >= least)
    intervals = np.stack([ordered[starts[keep]], ordered[ends[keep] - 1]], axis=1)
    return intervals, counts[keep]


def impurity(
    ordered: np.ndarray, intervals: np.ndarray, counts: np.ndarray, extent: tuple[float, float]
) -> float:
    """Return the proxy of the Gini impurity against uniform outliers (article, p. 12-13).

    It assumes as many outliers as samples, uniform over the interval of the node; each part, target
    intervals and the gaps between them alike, adds n n' / (n + n').
    """
    low, high = extent
    edges = np.concatenate(([low], intervals.ravel(), [high]))
    lengths = np.diff(edges)
    outliers = len(ordered) * lengths / (high - low)
    samples = np.zeros(len(lengths))
    samples[1::2] = counts
    first = np.searchsorted(ordered, intervals[:, 0], side='left')
    last = np.searchsorted(ordered, intervals[:, 1], side='right')
    samples[0::2] = np.concatenate((first, [len(ordered)])) - np.concatenate(([0], last))
    both = samples + outliers
    return float(
        np.sum(np.divide(samples * outliers, both, out=np.zeros_like(both), where=both > 0))
    )
