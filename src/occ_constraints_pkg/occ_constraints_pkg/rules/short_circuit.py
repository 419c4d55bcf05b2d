# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdict and margin of one sample, looking at no more rules than they take."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from occ_constraints_pkg.rules.formula import Disjunction, Group, safe_box
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

# The position of a feature, and the closed interval on which the literals about it are true.
_Condition = tuple[int, float, float]
# Conditions of which all must be true, and branches of which one must be, if there are any.
_Branch = tuple[tuple[_Condition, ...], tuple['_Branch', ...]]
# Feature, sign, signed bound and scale of a literal: its distance from becoming true.
_Distance = tuple[int, float, float, float]
# Of a disjunction: literals that are enough alone, and conjunctions of some with a disjunction.
_Distances = tuple[tuple[_Distance, ...], tuple[tuple[tuple[_Distance, ...], '_Distances'], ...]]


class ShortCircuit:
    """Judges a sample given as a list of k floats.

    NumPy needs about a microsecond for each call, whatever it computes; for a single sample,
    comparing Python floats is faster.

    Args:
        space: the features.
        formula: true where there is a violation.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, space: FeatureSpace, formula: Disjunction, scale: np.ndarray) -> None:
        self._bounds = list(zip(*space.finite_bounds.tolist(), strict=True))
        self._box = list(zip(*safe_box(space, formula).tolist(), strict=True))
        self._branches = _branches(Disjunction((), formula.parts))
        self._distances = _distances(formula, scale.tolist())

    def verdict(self, row: list[float]) -> Verdict:
        """Return the verdict on one sample."""
        for value, (low, high) in zip(row, self._box, strict=True):
            # Written so that NaN fails.
            if not low <= value <= high:
                return Verdict.VIOLATED if self.is_known(row) else Verdict.UNKNOWN
        return Verdict.VIOLATED if _is_true(self._branches, row) else Verdict.SAFE

    def is_known(self, row: list[float]) -> bool:
        """Whether all features of one sample are finite and within their physical bounds."""
        for value, (low, high) in zip(row, self._bounds, strict=True):
            if not low <= value <= high:
                return False
        return True

    def margin(self, row: list[float]) -> float:
        """Return the margin of one sample; what one that is not known gives has no meaning."""
        # Adding 0 leaves no minus zero.
        return _lowered(math.inf, self._distances, row, -math.inf) + 0.0


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


def _lowered(margin: float, formula: _Distances, row: list[float], least: float) -> float:
    """Return the smaller one of a margin and that of a formula, which is ``least`` or more.

    The margin of a conjunction is at least that of its first literals, so where these alone are
    no smaller, the rest needs no look.
    """
    ends, parts = formula
    for feature, sign, bound, scale in ends:
        distance = (bound - sign * row[feature]) / scale
        if distance < margin:
            margin = max(distance, least)
    for condition, inner in parts:
        outer = least
        for feature, sign, bound, scale in condition:
            distance = (bound - sign * row[feature]) / scale
            if distance > outer:
                outer = distance
                if outer >= margin:
                    break
        else:
            margin = _lowered(margin, inner, row, outer)
    return margin


def _distances(formula: Disjunction, scale: list[float]) -> _Distances:
    parts = (
        (_of_groups(groups, scale), _distances(inner, scale)) for groups, inner in formula.parts
    )
    return _of_groups(formula.ends, scale), tuple(parts)


def _of_groups(groups: Iterable[Group], scale: list[float]) -> tuple[_Distance, ...]:
    return tuple(
        (group.feature, literal.sign, literal.sign * literal.bound, scale[group.feature])
        for group in groups
        for literal in group.literals
    )


def _condition(group: Group) -> _Condition:
    low, high = -math.inf, math.inf
    for literal in group.literals:
        if literal.is_upper:
            high = literal.first
        else:
            low = literal.first
    return group.feature, low, high
