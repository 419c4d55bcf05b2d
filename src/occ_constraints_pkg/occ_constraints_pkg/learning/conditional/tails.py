# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tails made of bad samples: they jump in and out in a single row, and lie anywhere.

Good samples come and go over several rows, or at least no faster than they ever move, and their
tail thins out. Where a tail has none of this, it is cut off where the density jumps.
"""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.learning.conditional.price import MOST_BAD
from occ_constraints_pkg.learning.conditional.units import BELOW, Test, Unit

_CELLS = 128
_NARROWEST, _WIDEST = 4, 64
# A glitch differs from the samples before and after it by so many times the usual step.
_JUMP = 8.0
# A tail of bad samples has so many in its inner half, and at most this share that are no glitches:
# bad samples may follow each other, or be close to good ones.
_FEWEST, _OTHERS = 4, 0.3
# The inner half is at least so dense as all of it, just inside the bound it is so many times
# denser, and evenly over the whole range there would be at most this share of the rows.
_FLAT, _DENSER, _DENSEST = 0.6, 4.0, 1.2 * MOST_BAD


def flat_tails(unit: int, described: Unit, column: np.ndarray, goes_on: np.ndarray) -> list[Test]:
    """Return the bounds, at most one on each side, beyond which a unit has only bad samples.

    Args:
        unit: its position.
        described: what it is.
        column: (n,) its values in the order of time.
        goes_on: (n,) bool, whether the next row is the next sample of the same episode.
    """
    if described.is_discrete:
        return []
    is_glitch = _glitches(column, goes_on)
    bounds = []
    for side in described.sides:
        sign = 1.0 if side == BELOW else -1.0
        bound = _start(sign * column, is_glitch)
        if bound is not None:
            bounds.append(Test(unit, side, sign * bound))
    return bounds


def _glitches(column: np.ndarray, goes_on: np.ndarray) -> np.ndarray:
    """Tell for each row whether its value jumps away from those before and after it: (n,) bool."""
    steps = np.abs(np.diff(column))
    joined = goes_on[:-1]
    if not joined.any():
        return np.zeros(len(column), dtype=bool)
    is_jump = steps > _JUMP * np.median(steps[joined])
    out = np.ones(len(column), dtype=bool)
    # Where an episode begins or ends, one of the two has to do.
    out[:-1] &= is_jump | ~joined
    out[1:] &= is_jump | ~joined
    alone = ~goes_on
    alone[1:] &= ~joined
    return out & ~alone


def _start(column: np.ndarray, is_glitch: np.ndarray) -> float | None:
    """Return where the tail at the small values ends, or ``None`` if it is not of bad samples."""
    counts, edges = np.histogram(column, _CELLS)
    below = np.concatenate(([0], np.cumsum(counts)))
    others, _ = np.histogram(column[~is_glitch], edges)
    cut = np.arange(_NARROWEST, _WIDEST + 1)
    half = cut // 2
    whole, core = below[cut], below[half]
    inside = below[np.minimum(cut + half, _CELLS)] - whole
    is_flat = (
        (core >= _FEWEST)
        & (core * cut >= _FLAT * whole * half)
        & (core * _CELLS <= _DENSEST * len(column) * half)
        & (inside >= _DENSER * core)
        & (np.cumsum(others)[cut - 1] <= _OTHERS * whole)
    )
    return float(edges[cut[is_flat][-1]]) if is_flat.any() else None
