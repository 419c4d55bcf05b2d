# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The verdict on one sample, stopping at the first rule that is true."""

from __future__ import annotations

import math

from occ_constraints_pkg.rules.formula import Disjunction, Group, safe_box
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

# The position of a feature, and the closed interval on which the literals about it are true.
_Condition = tuple[int, float, float]
# Conditions of which all must be true, and branches of which one must be, if there are any.
_Branch = tuple[tuple[_Condition, ...], tuple['_Branch', ...]]


class ShortCircuit:
    """Judges a sample given as a list of k floats.

    NumPy needs about a microsecond for each call, whatever it computes; for a single sample,
    comparing Python floats is faster.

    Args:
        space: the features.
        formula: true where there is a violation.
    """

    def __init__(self, space: FeatureSpace, formula: Disjunction) -> None:
        self._bounds = list(zip(*space.finite_bounds.tolist(), strict=True))
        self._box = list(zip(*safe_box(space, formula).tolist(), strict=True))
        self._branches = _branches(Disjunction((), formula.parts))

    def verdict(self, row: list[float]) -> Verdict:
        """Return the verdict on one sample."""
        for value, (low, high) in zip(row, self._box, strict=True):
            # Written so that NaN fails.
            if not low <= value <= high:
                return Verdict.VIOLATED if self._is_known(row) else Verdict.UNKNOWN
        return Verdict.VIOLATED if _is_true(self._branches, row) else Verdict.SAFE

    def _is_known(self, row: list[float]) -> bool:
        return all(
            low <= value <= high for value, (low, high) in zip(row, self._bounds, strict=True)
        )


def _is_true(branches: tuple[_Branch, ...], row: list[float]) -> bool:
    for conditions, inner in branches:
        for feature, low, high in conditions:
            if not low <= row[feature] <= high:
                break
        else:
            if not inner or _is_true(inner, row):
                return True
    return False


def _branches(formula: Disjunction) -> tuple[_Branch, ...]:
    single = (
        ((_condition(Group(group.feature, (literal,))),), ())
        for group in formula.ends
        for literal in group.literals
    )
    return (
        *single,
        *((tuple(map(_condition, groups)), _branches(inner)) for groups, inner in formula.parts),
    )


def _condition(group: Group) -> _Condition:
    low, high = -math.inf, math.inf
    for literal in group.literals:
        if literal.is_upper:
            high = literal.first
        else:
            low = literal.first
    return group.feature, low, high
