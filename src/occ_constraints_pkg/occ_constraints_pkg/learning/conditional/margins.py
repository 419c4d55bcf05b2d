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
from collections.abc import Sequence

import numpy as np

# The tail is taken from this share of the episodes, within these numbers.
_TAIL_SHARE = 0.2
_FEWEST, _MOST = 3, 20


def outward_margins(
    values: np.ndarray,
    episodes: np.ndarray,
    families: Sequence[Sequence[int]],
    outside: float,
    discrete: Sequence[int] = (),
) -> np.ndarray:
    """Return how far each minimum and maximum moves out: (k, 2), 0 or more.

    The time beyond a bound is thought to fall off exponentially, as tails do: with the time spent
    beyond the tail's beginning, and with the mean excess of the episodes' extremes over it.

    Args:
        values: (n, k) samples.
        episodes: (n,) the episode of each.
        families: positions of features that share their bounds.
        outside: share of the time that a fresh episode may spend beyond any bound; each bound has
            an equal part.
        discrete: positions of features whose bounds stay.
    """
    names, of_row = np.unique(episodes, return_inverse=True)
    count, features = len(names), values.shape[1]
    margins = np.zeros((features, 2))
    if count < _FEWEST:
        return margins
    together = [list(family) for family in families]
    single = set(range(features)) - {member for family in together for member in family}
    groups = together + [[feature] for feature in sorted(single - set(discrete))]
    share = outside / (2 * max(1, len(groups)))
    for members in groups:
        for side, sign in ((0, -1.0), (1, 1.0)):
            column = (values[:, members[0]] * sign).astype(np.float64)
            for member in members[1:]:
                np.maximum(column, values[:, member] * sign, out=column)
            margins[members, side] = _margin(column, of_row, count, share)
    return margins


def _margin(column: np.ndarray, of_row: np.ndarray, count: int, share: float) -> float:
    """Return the margin of a maximum.

    Args:
        column: (n,) values.
        of_row: (n,) position of the episode.
        count: number of episodes.
        share: of the time that may be spent beyond the bound.
    """
    extremes = np.full(count, -np.inf)
    np.maximum.at(extremes, of_row, column)
    extremes = np.sort(extremes)[::-1]
    tail = min(count - 1, max(_FEWEST, math.ceil(_TAIL_SHARE * count)), _MOST)
    start = extremes[tail]
    scale = float(np.mean(extremes[:tail] - start))
    beyond = float(np.mean(column > start))
    if scale <= 0 or beyond <= share:
        return 0.0
    return max(0.0, scale * math.log(beyond / share) - float(extremes[0] - start))
