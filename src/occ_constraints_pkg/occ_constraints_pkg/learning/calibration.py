# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The false-alarm guarantee: bounds moved outward until fresh safe episodes rarely raise an alarm.

Split conformal prediction on whole episodes, in its nested form (V. Vovk, A. Gammerman, G. Shafer,
"Algorithmic Learning in a Random World", 2005; C. Gupta, A. K. Kuchibhotla, A. Ramdas, Pattern
Recognition 127, 2022). Samples of one episode are dependent, so the unit is the episode. The larger
the tolerance, the larger the safe set; the score of an episode is the smallest tolerance at which
all its samples are safe. Given n episodes that nothing was learned from, and a fresh one like them,
each is equally likely to have the k-th smallest score, so the fresh one exceeds the k-th smallest
of the n with probability at most 1 - k / (n + 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol, Self, TypeVar

import numpy as np
from scipy.special import betaincinv

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.guarantee import CONFIDENCE, Calibration
from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.space import FeatureSpace

# First increment of the margin if rounding leaves a sample outside.
_LEAST_STEP = 1e-18
_LARGEST = np.finfo(np.float64).max


class Movable(Protocol):
    """A safe set that grows with a margin; every safe set moved by less lies within it."""

    def moved(self, margin: float) -> Self:
        """Return the safe set with all its bounds moved, in parts of each feature's scale."""

    def contains(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) finite rows whether it is inside: (n,) bool."""

    def tolerances(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) the margins at which each of (n, k) rows is just inside, but for rounding."""


_Set = TypeVar('_Set', bound=Movable)


@dataclass(frozen=True, eq=False)
class SafeSet:
    """A tree within the box of the demonstrations.

    Attributes:
        tree: the tree.
        box: (k, 2) smallest and largest safe value of each feature.
        scale: (k,) unit of the margin in each feature; does not change when bounds move.
        limits: (k, 2) physical bounds, infinite where there is none.
    """

    tree: Node
    box: np.ndarray
    scale: np.ndarray
    limits: np.ndarray

    def moved(self, margin: float) -> SafeSet:
        """Return the safe set with all its bounds moved outward.

        A bound stops at the physical limit and, between two branches, in the middle of the gap. So
        a larger margin always gives a larger set, and every state in it is at most that far from
        the learned safe set; if the tree has no gap, it holds all such states within the limits.

        Args:
            margin: at least 0, in parts of each feature's scale.
        """
        with np.errstate(over='ignore'):
            step = np.minimum(margin * self.scale, _LARGEST)
            lows, highs = self.box[:, 0] - step, self.box[:, 1] + step
        box = np.stack(
            [np.maximum(lows, self.limits[:, 0]), np.minimum(highs, self.limits[:, 1])], axis=1
        ).clip(-_LARGEST, _LARGEST)
        return replace(self, tree=_moved(self.tree, step.tolist(), self.limits.tolist()), box=box)

    def contains(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) finite rows whether it is inside: (n,) bool."""
        inside = ((rows >= self.box[:, 0]) & (rows <= self.box[:, 1])).all(axis=1)
        return inside & self.tree.contains(rows)

    def tolerances(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) the margins at which each of (n, k) rows is just inside, but for rounding."""
        with np.errstate(over='ignore'):
            outside = np.maximum(self.box[:, 0] - rows, rows - self.box[:, 1]) / self.scale
        worst = np.maximum(outside.max(axis=1, initial=0.0), 0.0)
        self._descend(self.tree, rows, np.arange(len(rows)), worst)
        return worst

    def _descend(self, node: Node, rows: np.ndarray, places: np.ndarray, worst: np.ndarray) -> None:
        if node.feature is None or not len(places):
            return
        column = rows[places, node.feature]
        cell = np.searchsorted(_middles(node), column)
        for index, branch in enumerate(node.branches):
            own = cell == index
            with np.errstate(over='ignore'):
                outside = np.maximum(branch.low - column[own], column[own] - branch.high)
                outside /= self.scale[node.feature]
            worst[places[own]] = np.maximum(worst[places[own]], outside)
            self._descend(branch.node, rows, places[own], worst)


def episodes_needed(false_alarm: float) -> int:
    """Return how many episodes must be held out for a stated probability of a false alarm.

    Raises:
        ConfigurationError: it is not a number above 0 and below 1.
    """
    return math.ceil(1 / _exact(false_alarm)) - 1


def calibrate(
    safe_set: _Set, rows: np.ndarray, episodes: np.ndarray, false_alarm: float
) -> tuple[_Set, Calibration]:
    """Move the bounds of a safe set outward until a bound on false alarms is guaranteed.

    Args:
        safe_set: as learned, from other episodes than these.
        rows: (n, k) samples of safe episodes, finite and within the physical limits.
        episodes: (n,) the episode each sample belongs to.
        false_alarm: the largest probability that a fresh safe episode has a violation.

    Returns:
        The moved safe set, and the guarantee (without the rules that were dropped).

    Raises:
        ConfigurationError: the probability is not within 0 to 1, or there are too few episodes.
    """
    names, places = np.unique(episodes, return_inverse=True)
    count, needed = len(names), episodes_needed(false_alarm)
    if count < needed:
        raise ConfigurationError(
            f'false_alarm {false_alarm:g} needs {needed} safe episodes to calibrate on, got '
            f'{count}; allowed with so many is '
            + (f'{least_false_alarm(count)} or more' if count else 'none: give more episodes')
        )
    rank = math.ceil((count + 1) * (1 - _exact(false_alarm)))
    scores = np.zeros(count)
    np.maximum.at(scores, places, safe_set.tolerances(rows))
    margin = float(np.sort(scores)[rank - 1])
    alarms_before = _alarms(safe_set, rows, places, count)
    moved, alarms_after = safe_set, alarms_before
    extra = max(np.spacing(margin), _LEAST_STEP)
    # Rounding of the moved bounds may leave samples outside; slightly larger margins include them.
    while alarms_after > count - rank:
        moved = safe_set.moved(margin)
        alarms_after = _alarms(moved, rows, places, count)
        if alarms_after > count - rank:
            margin, extra = min(margin + extra, _LARGEST), 2.0 * extra
    if moved is safe_set:
        margin = 0.0
    return moved, Calibration(
        float(false_alarm),
        count,
        rank,
        margin,
        1.0 - rank / (count + 1),
        1.0 - float(betaincinv(rank, count + 1 - rank, 1.0 - CONFIDENCE)),
        alarms_before,
        alarms_after,
    )


def space_limits(space: FeatureSpace) -> np.ndarray:
    """Return the (k, 2) physical bounds of a feature space."""
    return np.stack([space.lows, space.highs], axis=1)


def _exact(false_alarm: float) -> Fraction:
    """Return the decimal number as written: 0.1 is a tenth, not the nearest float."""
    if not (isinstance(false_alarm, int | float) and 0.0 < false_alarm < 1.0):
        raise ConfigurationError(
            f'false_alarm is {false_alarm!r}; allowed is a number above 0 and below 1'
        )
    return Fraction(repr(float(false_alarm)))


def least_false_alarm(count: int) -> str:
    """Return the smallest probability that ``count`` episodes allow, rounded up to four digits."""
    return f'{math.ceil(10_000 / (count + 1)) / 10_000:g}'


def _alarms(safe_set: Movable, rows: np.ndarray, places: np.ndarray, count: int) -> int:
    """Return how many of ``count`` episodes have a sample outside."""
    outside = np.zeros(count, dtype=bool)
    outside[places[~safe_set.contains(rows)]] = True
    return int(outside.sum())


def _middles(node: Node) -> list[float]:
    """Return the inclusive upper ends of the cells of a node's branches, except the last."""
    middles = []
    for left, right in zip(node.branches[:-1], node.branches[1:], strict=True):
        middle = left.high / 2.0 + right.low / 2.0
        # Rounding must not move a value into the cell of a neighbour.
        middles.append(min(max(middle, left.high), math.nextafter(right.low, -math.inf)))
    return middles


def _moved(node: Node, step: list[float], ranges: list[list[float]]) -> Node:
    """Move the bounds of a node and what is below it; ``ranges`` is the cell it lies in."""
    if node.feature is None:
        return node
    feature = node.feature
    floor, ceiling = ranges[feature]
    middles = _middles(node)
    floors = [floor, *(math.nextafter(middle, math.inf) for middle in middles)]
    branches = []
    for branch, low, high in zip(node.branches, floors, [*middles, ceiling], strict=True):
        own = [
            max(branch.low - step[feature], low, -_LARGEST),
            min(branch.high + step[feature], high, _LARGEST),
        ]
        inner = [own if index == feature else item for index, item in enumerate(ranges)]
        branches.append(
            replace(branch, low=own[0], high=own[1], node=_moved(branch.node, step, inner))
        )
    return replace(node, branches=tuple(branches))
