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
from occ_constraints_pkg.learning.conditional.units import BELOW, EQUAL, Test

# Independent visits that were expected between a bound and the data.
_STRIP = 1.0
# A strip takes at most this share of what a literal is true of.
_WIDEST_STRIP = 0.5
_ROUNDS = 2
# Beyond these, rounding would lose more than it makes readable.
_MOST_DIGITS, _MOST_STEPS = 200, 1e15


def place(
    sample: Sample,
    rows: Rows,
    free: np.ndarray,
    tests: Sequence[Test],
    evidence: float,
    strip: float = _STRIP,
) -> tuple[Test, ...]:
    """Put each bound where the corner is worth most, then back by a strip.

    Each bound in turn, the others as they are, moves over the values of the rows that are in the
    corner but for it (excess mass on one feature). Then it steps back into the corner, away from
    the data, by a strip in which so many independent visits were expected: closer than that,
    nothing tells where the bound is.

    Args:
        sample: the searched rows, which say how values are distributed.
        rows: the rows that the bounds are placed on.
        free: (n,) bool, which of them are in no earlier rule.
        tests: the corner's literals.
        evidence: independent visits that were expected in the corner.
        strip: of them, as many lie in the strip.
    """
    bad = bad_density(sample, rows, tests)
    placed = list(tests)
    for _ in range(_ROUNDS):
        for position, test in enumerate(placed):
            if _is_movable(sample, test):
                others = [other for other in placed if other is not test]
                placed[position] = _best(sample, rows, free, test, others, bad)
    return tuple(_back(sample, test, strip / max(evidence, 1e-9)) for test in placed)


def bad_density(sample: Sample, rows: Rows, tests: Sequence[Test]) -> float:
    """Return the share of the rows, per volume, that lie half as deep in a corner.

    None of them is bad, so the density 0, unless they are isolated in time.
    """
    inner = [sample.half_as_deep(test) for test in tests]
    inside = rows.inside(inner)
    count = int(inside.sum())
    if not is_isolated(count, count - rows.stays(inner, inside)):
        return 0.0
    return float(bad_share(count, len(rows), sample.volume_of(inner)))


def _is_movable(sample: Sample, test: Test) -> bool:
    return test.side != EQUAL and not sample.units[test.unit].is_discrete


def _best(
    sample: Sample,
    rows: Rows,
    free: np.ndarray,
    test: Test,
    others: Sequence[Test],
    bad: float,
) -> Test:
    """Return a literal with its bound where the corner is worth most, the others as they are."""
    inside = rows.inside(others)
    # Mirrored if need be, so that the corner lies below.
    sign = 1.0 if test.side == BELOW else -1.0
    values, new = sign * rows.columns[test.unit][inside], free[inside]
    if not len(values):
        return test
    room = int(MOST_BAD * len(rows)) + 2
    order = np.argpartition(values, room - 1)[:room] if len(values) > room else slice(None)
    values, new = values[order], new[order]
    order = np.argsort(values)
    values, new = values[order], new[order]
    # At a value, only what lies below it is in the corner; equal values go together.
    first = np.searchsorted(values, values, side='left')
    ordered = sample.ordered[test.unit] if sign > 0 else -sample.ordered[test.unit][::-1]
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
    return test if np.isneginf(gain[best]) else test._replace(bound=float(sign * values[best]))


def _back(sample: Sample, test: Test, share: float) -> Test:
    """Return a literal whose bound has stepped back by a share of its mass, and is rounded.

    Rounded into the corner, to about a thousandth of the range.
    """
    if not _is_movable(sample, test):
        return test
    ordered, last = sample.ordered[test.unit], len(sample) - 1
    kept = 1 - min(_WIDEST_STRIP, share)
    if test.side == BELOW:
        mass = int(np.searchsorted(ordered, test.bound, side='left') * kept)
        bound = min(test.bound, float(ordered[min(mass, last)]))
    else:
        mass = int((len(sample) - np.searchsorted(ordered, test.bound, side='right')) * kept)
        bound = max(test.bound, float(ordered[max(last - mass, 0)]))
    rounded = _rounded(ordered, bound, test.side)
    return test._replace(bound=rounded if ordered[0] < rounded < ordered[-1] else bound)


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
