# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A margin for each demonstrated minimum and maximum.

The extreme of what was demonstrated is the edge of the demonstrations, not of what is safe: the
next episode goes a little beyond it somewhere. How far differs from bound to bound. Where each
episode has its own level (a temperature), the extremes of episodes lie far apart; where all come
to the same edge (a clearance that is kept), they hardly differ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# The tail is taken from this share of the episodes, within these numbers.
_TAIL_SHARE = 0.2
_FEWEST, _MOST = 3, 20
# The extremes of fewer episodes say too little of those of the next one.
_LEAST_EPISODES = 10
# How far a bound is moved at most: so that fresh episodes do not stay beyond it, as far as the
# extremes of one in so many episodes are apart; so that they do not come there, so many times that,
# and this share of the demonstrated range.
_REACH, _TIMES, _FARTHEST = 10, 4.0, 0.1
# Of noise, every other sample is on the same side of the median as the one before.
_LEAST_MEMORY = 0.6


def outward_margin(column: np.ndarray, episodes: np.ndarray, share: float) -> float:
    """Return how far a maximum moves out, 0 or more.

    The episodes' extremes are thought to fall off exponentially, as tails do, and so is the time
    beyond. The margin is the larger of two. With the one, a fresh episode hardly ever comes beyond
    the bound; it is at most a tenth of the demonstrated range. With the other, fresh episodes spend
    hardly any time there; it is at most as wide as the extremes of a tenth of the episodes are
    apart, the first at most four times as wide. Where many episodes have nearly the same extreme,
    as at an edge that is kept or where speed ends at a standstill, both are small.

    Args:
        column: (n,) values, those of an episode one after the other.
        episodes: (n,) int, ascending from 0, the episode of each.
        share: of the fresh episodes that may come beyond the bound, and of their time.
    """
    tail = _Tail.of(column, episodes)
    if tail is None:
        return 0.0
    most = float(tail.extremes[0] - tail.extremes[max(1, len(tail.extremes) // _REACH)])
    farthest = min(_TIMES * most, _FARTHEST * (float(tail.extremes[0]) - float(column.min())))
    by_episodes = min(farthest, tail.beyond(tail.length / len(tail.extremes), share))
    by_time = min(most, tail.beyond(float(np.mean(column > tail.start)), share))
    return max(0.0, by_episodes, by_time)


@dataclass(frozen=True)
class _Tail:
    """The largest of the episodes' extremes.

    Attributes:
        extremes: the largest value of each episode, descending.
        length: how many of them are the tail.
    """

    extremes: np.ndarray
    length: int

    @classmethod
    def of(cls, column: np.ndarray, episodes: np.ndarray) -> _Tail | None:
        """Return the tail of (n,) values in (n,) episodes; ``None`` of too few."""
        starts = np.flatnonzero(np.diff(episodes, prepend=-1))
        count = len(starts)
        if count < _LEAST_EPISODES:
            return None
        extremes = np.sort(np.maximum.reduceat(column, starts))[::-1]
        length = min(count - 1, max(_FEWEST, math.ceil(_TAIL_SHARE * count)), _MOST)
        return cls(extremes, length)

    @property
    def start(self) -> float:
        """Where it begins."""
        return float(self.extremes[self.length])

    def beyond(self, present: float, wanted: float) -> float:
        """Return how far beyond the largest extreme a share has fallen off to another.

        Args:
            present: the share beyond the start of the tail.
            wanted: the share beyond the bound.
        """
        scale = float(np.mean(self.extremes[: self.length])) - self.start
        if present <= 0 or scale <= 0:
            return 0.0
        return scale * math.log(present / wanted) - (float(self.extremes[0]) - self.start)


def is_noise(column: np.ndarray, goes_on: np.ndarray) -> bool:
    """Tell whether samples hardly know on which side of the median the one before was.

    Args:
        column: (n,) values in the order of time.
        goes_on: (n,) bool, whether the next row is the next sample of the same episode.
    """
    is_high = column > np.median(column)
    joined = goes_on[:-1]
    agreeing = (is_high[1:] == is_high[:-1])[joined]
    return len(agreeing) > 0 and float(np.mean(agreeing)) < _LEAST_MEMORY
