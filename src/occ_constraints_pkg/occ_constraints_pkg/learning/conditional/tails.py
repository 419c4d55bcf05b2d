# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tails made of bad samples: isolated in time and evenly spread.

Good samples come and go over several rows, and their tail thins out. Glitches jump in and out in a
single row and lie anywhere. Where a tail looks like that, it is cut off where the density jumps.
"""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.learning.conditional.price import MOST_BAD, is_isolated
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Test, Unit

_CELLS = 128
_NARROWEST, _WIDEST = 4, 64
# Bad samples in the inner half of a tail at least.
_FEWEST = 8
# The inner half is at least so dense as all of the tail, just inside the bound it is so many times
# denser, and all of it holds at most so many times what is spread evenly.
_FLAT, _JUMP, _EXCESS = 0.6, 4.0, 1.25
# Evenly over the whole range there would be at most this share of the rows.
_DENSEST = 1.2 * MOST_BAD


def flat_tail(unit: int, described: Unit, column: np.ndarray, episodes: np.ndarray) -> list[Test]:
    """Return the bounds, at most one on each side, beyond which a unit has only bad samples.

    Args:
        unit: its position.
        described: what it is.
        column: (n,) its values in the order of time.
        episodes: (n,) the episode of each.
    """
    if described.is_discrete:
        return []
    bounds = []
    for side in described.sides:
        sign = 1.0 if side == BELOW else -1.0
        bound = _flat_start(sign * column, episodes)
        if bound is not None:
            bounds.append(Test(unit, BELOW if side == BELOW else ABOVE, sign * bound))
    return bounds


def _flat_start(column: np.ndarray, episodes: np.ndarray) -> float | None:
    """Return where the tail at the small values ends, or ``None`` if it is not flat."""
    counts, edges = np.histogram(column, _CELLS)
    below = np.concatenate(([0], np.cumsum(counts))) / len(column)
    cut = np.arange(_NARROWEST, _WIDEST + 1)
    half, volume = cut // 2, cut / _CELLS
    density = below[half] / (half / _CELLS)
    beyond = np.minimum(cut + half, _CELLS)
    inside = (below[beyond] - below[cut]) / (half / _CELLS)
    is_flat = (
        (below[half] * len(column) >= _FEWEST)
        & (density >= _FLAT * below[cut] / volume)
        & (density <= _DENSEST)
        & (inside >= _JUMP * density)
        & (below[cut] <= _EXCESS * np.minimum(density, MOST_BAD) * volume)
    )
    if not is_flat.any():
        return None
    bound = float(edges[cut[is_flat][-1]])
    rows = column < bound
    goes_on = rows[1:] & rows[:-1] & (episodes[1:] == episodes[:-1])
    visits = int(rows.sum()) - int(goes_on.sum())
    return bound if is_isolated(int(rows.sum()), visits) else None
