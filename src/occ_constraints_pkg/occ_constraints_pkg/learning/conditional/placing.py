# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where exactly a rule's bounds lie."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.learning.conditional.grid import WIDEST
from occ_constraints_pkg.learning.conditional.price import (
    MOST_BAD,
    Seen,
    bad_share,
    is_isolated,
    worth,
)
from occ_constraints_pkg.learning.conditional.sample import Rows, Sample
from occ_constraints_pkg.learning.conditional.units import BELOW, EQUAL, Cut

# A strip takes at most this share of what a literal is true of.
_WIDEST_STRIP = 0.5
_ROUNDS = 2
# Beyond these, rounding would lose more than it makes readable.
_MOST_DIGITS, _MOST_STEPS = 200, 1e15


def place(
    sample: Sample, rows: Rows, free: np.ndarray, cuts: Sequence[Cut], visits: float
) -> tuple[Cut, ...]:
    """Put each bound where the corner is worth most, and then a step back.

    Args:
        sample: the searched rows, which say how values are distributed.
        rows: the rows that the bounds are placed on.
        free: (n,) bool, which of them are in no earlier rule.
        cuts: the corner's literals.
        visits: see :func:`step_back`.
    """
    return step_back(sample, fit_bounds(sample, rows, free, cuts), visits)


def fit_bounds(
    sample: Sample, rows: Rows, free: np.ndarray, cuts: Sequence[Cut]
) -> tuple[Cut, ...]:
    """Put each bound where the corner is worth most.

    Each bound in turn, the others as they are, moves over the values of the rows that are in the
    corner but for it (excess mass on one feature).

    Args:
        sample: the searched rows, which say how values are distributed.
        rows: the rows that the bounds are placed on.
        free: (n,) bool, which of them are in no earlier rule.
        cuts: the corner's literals.
    """
    bad = bad_density(sample, rows, cuts)
    placed = list(cuts)
    for _ in range(_ROUNDS):
        for position, cut in enumerate(placed):
            if _is_movable(sample, cut):
                others = [other for other in placed if other is not cut]
                placed[position] = _best(sample, rows, free, cut, others, bad)
    return tuple(placed)


def step_back(sample: Sample, cuts: Sequence[Cut], visits: float) -> tuple[Cut, ...]:
    """Move each bound into the corner, away from the data, and round it.

    By a strip in which one independent visit was expected: closer than that, nothing tells where
    the bound is.

    Args:
        sample: the searched rows, which say how values are distributed.
        cuts: the corner's literals.
        visits: independent ones that were expected in the corner, in strips.
    """
    return tuple(_back(sample, cut, 1 / max(visits, 1e-9)) for cut in cuts)


def bad_density(sample: Sample, rows: Rows, cuts: Sequence[Cut]) -> float:
    """Return the share of the rows, per volume, that lie half as deep in a corner.

    None of them is bad, so the density 0, unless they are isolated in time.
    """
    inner = [sample.half_as_deep(cut) for cut in cuts]
    inside = rows.inside(inner)
    count = int(inside.sum())
    if not is_isolated(count, count - rows.stays(inner, inside)):
        return 0.0
    return float(bad_share(count, len(rows), sample.volume_of(inner)))


def _is_movable(sample: Sample, cut: Cut) -> bool:
    return cut.side != EQUAL and not sample.units[cut.unit].is_discrete


def _best(
    sample: Sample,
    rows: Rows,
    free: np.ndarray,
    cut: Cut,
    others: Sequence[Cut],
    bad: float,
) -> Cut:
    """Return a literal with its bound where the corner is worth most, the others as they are."""
    inside = rows.inside(others)
    # Mirrored if need be, so that the corner lies below.
    sign = 1.0 if cut.side == BELOW else -1.0
    values, new = sign * rows.columns[cut.unit][inside], free[inside]
    if not len(values):
        return cut
    room = int(MOST_BAD * len(rows)) + 2
    order = np.argpartition(values, room - 1)[:room] if len(values) > room else slice(None)
    values, new = values[order], new[order]
    order = np.argsort(values)
    values, new = values[order], new[order]
    # At a value, only what lies below it is in the corner; equal values go together.
    first = np.searchsorted(values, values, side='left')
    ordered = sample.ordered[cut.unit] if sign > 0 else -sample.ordered[cut.unit][::-1]
    mass = np.searchsorted(ordered, values, side='left') / len(sample)
    depth = np.clip((values - ordered[0]) / (ordered[-1] - ordered[0]), 0.0, 1.0)
    gain = worth(
        inside.mean() * mass,
        Seen(first / len(rows), np.concatenate(([0], np.cumsum(new)))[first] / len(rows)),
        sample.volume_of(others) * depth,
        bad,
    )
    gain[mass > WIDEST] = -np.inf
    best = int(gain.argmax())
    return cut if np.isneginf(gain[best]) else cut._replace(bound=float(sign * values[best]))


def _back(sample: Sample, cut: Cut, share: float) -> Cut:
    """Return a literal whose bound has stepped back by a share of its mass, and is rounded.

    Rounded into the corner, to about a thousandth of the range.
    """
    if not _is_movable(sample, cut):
        return cut
    ordered, last = sample.ordered[cut.unit], len(sample) - 1
    kept = 1 - min(_WIDEST_STRIP, share)
    if cut.side == BELOW:
        mass = int(np.searchsorted(ordered, cut.bound, side='left') * kept)
        bound = min(cut.bound, float(ordered[min(mass, last)]))
    else:
        mass = int((len(sample) - np.searchsorted(ordered, cut.bound, side='right')) * kept)
        bound = max(cut.bound, float(ordered[max(last - mass, 0)]))
    rounded = _rounded(ordered, bound, cut.side)
    return cut._replace(bound=rounded if ordered[0] < rounded < ordered[-1] else bound)


def _rounded(ordered: np.ndarray, bound: float, side: int) -> float:
    low, high = ordered[int(0.01 * (len(ordered) - 1))], ordered[int(0.99 * (len(ordered) - 1))]
    if high <= low:
        return bound
    digits = 2 - math.floor(math.log10(high - low))
    if abs(digits) > _MOST_DIGITS or abs(bound) * 10.0**digits > _MOST_STEPS:
        return bound
    scale = 10.0**digits
    whole = math.floor(bound * scale) if side == BELOW else math.ceil(bound * scale)
    return float(whole / scale) if digits >= 0 else float(whole * 10 ** (-digits))
