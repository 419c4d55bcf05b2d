# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Bad samples: they jump in and out in a single row, and lie anywhere.

Good samples come and go over several rows, or at least no faster than they ever move, and their
tails thin out. A tail that has none of this is made of bad samples.
"""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.learning.conditional.price import MOST_BAD
from occ_constraints_pkg.learning.conditional.units import BELOW, Cut, Unit

_CELLS = 128
_NARROWEST, _WIDEST = 4, 64
# A glitch differs from the samples before and after it by so many times the usual step.
_JUMP = 8.0
_SOME = 10_000
# Of many glitches, no more than this share lie in one of the parts of a feature's range. Those that
# belong to it, such as impacts, jump to certain values.
_MANY, _PARTS, _MOST_IN_PART = 20, 8, 0.35
# A tail of bad samples has so many in its inner half, and at most this share that are no glitches:
# bad samples may follow each other, or be close to good ones.
_FEWEST, _OTHERS = 4, 0.3
# The inner half is at least so dense as all of it, just inside the bound it is so many times
# denser, and evenly over the whole range there would be at most this share of the rows. A feature
# with more glitches than that jumps of its own accord.
_FLAT, _DENSER, _DENSEST = 0.6, 4.0, 1.2 * MOST_BAD


def find_glitches(column: np.ndarray, goes_on: np.ndarray) -> np.ndarray:
    """Tell for each row whether its value jumps away from those before and after it.

    Args:
        column: (n,) values in the order of time.
        goes_on: (n,) bool, whether the next row is the next sample of the same episode.

    Returns:
        (n,) bool. Where an episode begins or ends, the one neighbour decides. Where jumps belong to
        the feature, none is a glitch.
    """
    glitches = np.zeros(len(column), dtype=bool)
    joined = goes_on[:-1]
    steps = np.abs(np.diff(column))
    some = steps[:: max(1, len(steps) // _SOME)][joined[:: max(1, len(steps) // _SOME)]]
    usual = float(np.median(some)) if len(some) else 0.0
    if usual == 0.0:
        return glitches
    is_jump = steps > _JUMP * usual
    glitches[:-1] = is_jump & joined
    # After a jump in, the next step has to be a jump out, unless there is none.
    glitches[1:] = np.where(joined, is_jump & (glitches[1:] | ~goes_on[1:]), glitches[1:])
    return glitches if _are_bad(column, glitches) else np.zeros_like(glitches)


def _are_bad(column: np.ndarray, glitches: np.ndarray) -> bool:
    """Tell whether glitches are few, and anywhere in the range, as far as that can be told."""
    values = column[glitches]
    if len(values) > _DENSEST * len(column):
        return False
    if len(values) < _MANY:
        return True
    counts, _ = np.histogram(values, _PARTS, (column.min(), column.max()))
    return counts.max() <= _MOST_IN_PART * len(values)


def flat_tails(unit: int, described: Unit, column: np.ndarray, is_glitch: np.ndarray) -> list[Cut]:
    """Return the bounds, at most one on each side, beyond which a unit has only bad samples.

    Args:
        unit: its position.
        described: what it is.
        column: (n,) its values.
        is_glitch: (n,) bool, see :func:`find_glitches`.
    """
    bounds = []
    if np.count_nonzero(is_glitch) >= _FEWEST:
        for side in described.sides:
            sign = 1.0 if side == BELOW else -1.0
            bound = _start(sign * column, is_glitch)
            if bound is not None:
                bounds.append(Cut(unit, side, sign * bound))
    return bounds


def _start(column: np.ndarray, is_glitch: np.ndarray) -> float | None:
    """Return where the tail at the small values ends, or ``None`` if it is not of bad samples."""
    extent = float(column.min()), float(column.max())
    bad, edges = np.histogram(column[is_glitch], _CELLS, extent)
    cut = np.arange(_NARROWEST, _WIDEST + 1)
    half = cut // 2
    # There are few glitches, and mostly none in a tail, so that all rows need not be counted.
    bad = np.cumsum(bad)[cut - 1]
    if bad[-1] < _FEWEST:
        return None
    below = np.concatenate(([0], np.cumsum(np.histogram(column, _CELLS, extent)[0])))
    whole, core = below[cut], below[half]
    inside = below[np.minimum(cut + half, _CELLS)] - whole
    is_flat = (
        (core >= _FEWEST)
        & (core * cut >= _FLAT * whole * half)
        & (core * _CELLS <= _DENSEST * len(column) * half)
        & (inside >= _DENSER * core)
        & (bad >= (1 - _OTHERS) * whole)
    )
    return float(edges[cut[is_flat][-1]]) if is_flat.any() else None
