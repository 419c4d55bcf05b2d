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

import numpy as np

# The tail is taken from this share of the episodes, within these numbers.
_TAIL_SHARE = 0.2
# No margin is wider than the extremes of one in so many episodes are apart.
_REACH = 10
_FEWEST, _MOST = 3, 20
# The extremes of fewer episodes say too little of those of the next one.
_LEAST_EPISODES = 10


def outward_margin(column: np.ndarray, episodes: np.ndarray, share: float) -> float:
    """Return how far a maximum moves out, 0 or more.

    The time beyond a bound is thought to fall off exponentially, as tails do: with the time spent
    beyond the tail's beginning, and with the mean excess of the episodes' extremes over it. Not all
    do: where speed ends at a standstill, many episodes have nearly the same extreme. So the margin
    is at most as wide as the extremes of a tenth of the episodes are apart, at least those of
    the first two.

    Args:
        column: (n,) values, those of an episode one after the other.
        episodes: (n,) int, ascending from 0, the episode of each.
        share: of the time that a fresh episode may spend beyond the bound.
    """
    starts = np.flatnonzero(np.diff(episodes, prepend=-1))
    count = len(starts)
    if count < _LEAST_EPISODES:
        return 0.0
    extremes = np.sort(np.maximum.reduceat(column, starts))[::-1]
    tail = min(count - 1, max(_FEWEST, math.ceil(_TAIL_SHARE * count)), _MOST)
    start = extremes[tail]
    scale = float(np.mean(extremes[:tail] - start))
    beyond = float(np.mean(column > start))
    if scale <= 0 or beyond <= share:
        return 0.0
    most = float(extremes[0] - extremes[max(1, count // _REACH)])
    return min(most, max(0.0, scale * math.log(beyond / share) - float(extremes[0] - start)))
