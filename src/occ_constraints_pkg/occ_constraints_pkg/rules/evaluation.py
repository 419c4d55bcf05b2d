# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a rule set: one sample, many samples, and rule by rule.

The formula with common literals factored out (:func:`factor`) is evaluated in two ways: on Python
floats for a single sample (:class:`ShortCircuit`) and on whole columns for many (:class:`Columns`).
:class:`RuleTable` tells which rule is true, and how far each is from it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.rules.rule import COMPARISONS, Literal, Rule, split_off_single
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

# Nesting of factored literals; what is left is evaluated rule by rule, so recursion stays shallow.
_DEEPEST = 20


class _Group(NamedTuple):
    """Literals of one feature, at most one lower and one upper.

    Attributes:
        feature: the feature's position.
        literals: one or two.
    """

    feature: int
    literals: tuple[Literal, ...]


class Disjunction(NamedTuple):
    """True when any literal of ``ends`` is, or any of ``parts``.

    The same structure gives the margin, with distances for literals, the minimum for *or* and the
    maximum for *and*.

    Attributes:
        ends: single literals, only the widest for each side of a feature.
        parts: each the conjunction of all literals of some groups and another disjunction.
    """

    ends: tuple[_Group, ...]
    parts: tuple[tuple[tuple[_Group, ...], Disjunction], ...]


def factor(rules: Iterable[Rule]) -> Disjunction:
    """Write the disjunction of some rules with common literals factored out.

    Rules learned from a tree repeat the conditions of their branch: ``(a and b) or (a and c)``
    becomes ``a and (b or c)``. A rule that implies a wider one is left out. Truth and margin stay
    the same, exactly: both are made of *min* and *max*, which distribute and absorb.
    """
    conjunctions = [rule.tightest_literals for rule in rules]
    uses = Counter(literal for literals in conjunctions for literal in literals)
    first_seen = {literal: place for place, literal in enumerate(uses)}
    # Most frequent first, so that rules share as long a prefix as possible.
    ordered = [
        tuple(sorted(literals, key=lambda item: (-uses[item], first_seen[item])))
        for literals in conjunctions
    ]
    return _factor(ordered, _DEEPEST)


def _safe_box(space: FeatureSpace, formula: Disjunction) -> np.ndarray:
    """Return (2, k): the physical bounds less where single literals hold."""
    box = space.finite_bounds.copy()
    for group in formula.ends:
        for literal in group.literals:
            end, pick = (0, max) if literal.is_upper else (1, min)
            box[end, literal.feature] = pick(box[end, literal.feature], literal.last)
    return box


def _factor(conjunctions: list[tuple[Literal, ...]], levels: int) -> Disjunction:
    single, left = split_off_single(conjunctions)
    shared: dict[object, list[tuple[Literal, ...]]] = {}
    for place, literals in enumerate(left):
        shared.setdefault(literals[0] if levels else place, []).append(literals)
    parts = []
    for together in shared.values():
        if len(together) == 1:
            *condition, last = together[0]
            inner = Disjunction(_groups([last]), ())
        else:
            condition = [together[0][0]]
            inner = _factor([literals[1:] for literals in together], levels - 1)
        if not inner.ends and len(inner.parts) == 1:
            groups, inner = inner.parts[0]
            condition += [literal for group in groups for literal in group.literals]
        parts.append((_groups(condition), inner))
    return Disjunction(_groups(single), tuple(parts))


def _groups(literals: Iterable[Literal]) -> tuple[_Group, ...]:
    by_feature = sorted(literals, key=attrgetter('feature'))
    return tuple(
        _Group(feature, tuple(same)) for feature, same in groupby(by_feature, attrgetter('feature'))
    )


# A feature, and the closed interval on which its literals are true.
_Condition = tuple[int, float, float]
# Conditions that must all be true, and branches, one of which must be true if there are any.
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
        self._box = list(zip(*_safe_box(space, formula).tolist(), strict=True))
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
        ((_condition(_Group(group.feature, (literal,))),), ())
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


def _of_groups(groups: Iterable[_Group], scale: list[float]) -> tuple[_Distance, ...]:
    return tuple(
        (group.feature, literal.sign, literal.sign * literal.bound, scale[group.feature])
        for group in groups
        for literal in group.literals
    )


def _condition(group: _Group) -> _Condition:
    low, high = -math.inf, math.inf
    for literal in group.literals:
        if literal.is_upper:
            high = literal.first
        else:
            low = literal.first
    return group.feature, low, high


# Numbers per block. Larger blocks leave the second-level cache; with smaller ones the calls
# themselves dominate.
_BLOCK = 2**18
_FEWEST_ROWS = 16


class Columns:
    """Evaluates a formula on blocks of samples with whole columns as operands.

    Args:
        space: the features.
        formula: true where there is a violation.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, space: FeatureSpace, formula: Disjunction, scale: np.ndarray) -> None:
        self._formula, self._scale = formula, scale
        self._bounds = space.finite_bounds[:, :, None]
        self._box = _safe_box(space, formula)[:, :, None]

    @cached_property
    def _truth(self) -> _Program:
        """Truth of the parts; the single literals are in the box."""
        return _Program(Disjunction((), self._formula.parts), len(self._scale))

    @cached_property
    def _margin(self) -> _Program:
        return _Program(self._formula, len(self._scale), self._scale)

    def passed(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) whether samples are known and the formula is false, for (n, k) float64."""
        passed = np.empty(len(rows), dtype=bool)
        for block, columns in self._blocks(rows):
            # For truth values greater is "and not".
            np.greater(_within(columns, self._box), self._truth.run(columns), out=passed[block])
        return passed

    def margins(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) whether samples are known, and (n,) their margins, meaningless if not."""
        known, margin = np.empty(len(rows), dtype=bool), np.empty(len(rows))
        for block, columns in self._blocks(rows):
            known[block] = _within(columns, self._bounds)
            # Adding 0 leaves no minus zero.
            np.add(self._margin.run(columns), 0.0, out=margin[block])
        return known, margin

    def _blocks(self, rows: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield blocks of rows as (k, size) columns; the next block reuses the memory."""
        features = rows.shape[1]
        size = max(_BLOCK // features, _FEWEST_ROWS)
        memory = np.empty((features, min(size, len(rows))))
        for start in range(0, len(rows), size):
            block = slice(start, min(start + size, len(rows)))
            columns = memory[:, : block.stop - start]
            np.copyto(columns, rows[block].T)
            yield block, columns


def _within(columns: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return (n,) whether all features lie in a box (2, k, 1); NaN never does."""
    inside = columns >= bounds[0]
    np.logical_and(inside, columns <= bounds[1], out=inside)
    return np.logical_and.reduce(inside, axis=0)


class _Step(NamedTuple):
    """One call, with the positions of its operands and its result."""

    call: np.ufunc
    left: int
    right: int
    result: int


class _Program:
    """Evaluates a formula on a block of samples, whole columns at a time.

    Operands are the columns, then constants, then registers for intermediate results. There are
    few registers, so they stay in the cache; register r has position ~r, counted from the end.

    Args:
        formula: what to evaluate.
        features: number of columns.
        scale: (k,) the unit of distance of each feature, for the margin; ``None``: the truth.
    """

    def __init__(
        self, formula: Disjunction, features: int, scale: np.ndarray | None = None
    ) -> None:
        self._features, self._scale = features, scale
        self._constants: list[np.ndarray] = []
        self._places: dict[float, int] = {}
        self._steps: list[_Step] = []
        self._type: type
        self._either: np.ufunc
        self._both: np.ufunc
        if scale is None:
            self._type, self._either, self._both = bool, np.logical_or, np.logical_and
        else:
            self._type, self._either, self._both = np.float64, np.minimum, np.maximum
        self._emit_disjunction(formula, 0)
        self._registers = 1 + max((~step.result for step in self._steps), default=0)

    def run(self, columns: np.ndarray) -> np.ndarray:
        """Return (n,) truth or margin of n samples, given as (k, n) columns.

        The result is meaningless where a value is not finite.
        """
        registers: np.ndarray = np.empty((self._registers, columns.shape[1]), dtype=self._type)
        operands = [*columns, *self._constants, *registers[::-1]]
        if not self._steps:
            # Without rules nothing is true, and the margin is infinite.
            registers.fill(False if self._scale is None else np.inf)
        with np.errstate(invalid='ignore', over='ignore', under='ignore'):
            for call, left, right, result in self._steps:
                call(operands[left], operands[right], out=operands[result])
        return registers[0]

    def _emit(self, call: np.ufunc, left: int, right: int, register: int) -> None:
        self._steps.append(_Step(call, left, right, ~register))

    def _emit_disjunction(self, formula: Disjunction, register: int) -> None:
        """Append steps that compute a disjunction into a register; those after it are scratch."""
        free = register
        for group in formula.ends:
            self._emit_group(group, self._either, free)
            free = self._join(register, free)
        for condition, inner in formula.parts:
            self._emit_disjunction(inner, free)
            for group in condition:
                self._emit_group(group, self._both, free + 1)
                self._emit(self._both, ~free, ~(free + 1), free)
            free = self._join(register, free)

    def _join(self, register: int, free: int) -> int:
        """Append the step that joins ``free`` to a disjunction; return the next free register.

        The first value of a disjunction is in its register already.
        """
        if free != register:
            self._emit(self._either, ~register, ~free, register)
        return register + 1

    def _emit_group(self, group: _Group, combine: np.ufunc, register: int) -> None:
        first, *others = group.literals
        self._emit_literal(first, register)
        for literal in others:
            self._emit_literal(literal, register + 1)
            self._emit(combine, ~register, ~(register + 1), register)
        if self._scale is not None:
            # Once per group: dividing by a positive number keeps the order.
            scale = self._constant(self._scale[group.feature])
            self._emit(np.divide, ~register, scale, register)

    def _emit_literal(self, literal: Literal, register: int) -> None:
        feature, bound = literal.feature, self._constant(literal.bound)
        if self._scale is None:
            self._emit(COMPARISONS[literal.operator], feature, bound, register)
        elif literal.is_upper:
            self._emit(np.subtract, feature, bound, register)
        else:
            self._emit(np.subtract, bound, feature, register)

    def _constant(self, number: float) -> int:
        """Return the position of a constant; NumPy is fastest if it is an array."""
        if number not in self._places:
            self._places[number] = self._features + len(self._constants)
            self._constants.append(np.array(number, dtype=np.float64))
        return self._places[number]


# How many times as many members rules of unequal length may have to be evaluated as equally long.
_MOST_REPEATED = 4


class RuleTable:
    """The literals of some rules as arrays, each distinct literal once.

    Every literal is ``sign * x > threshold``, see :class:`~occ_constraints_pkg.rules.rule.Literal`;
    this is exact, bounds included.

    Attributes:
        feature: (m,) the feature of each literal.
        sign: (m, 1) 1.0 or -1.0; a column, for any number of samples.
        threshold: (m, 1) the largest signed value on which the literal is false.
        members: (all literals,) positions of the literals of one rule after another.
        starts: (rules,) where each rule begins in ``members``.

    Args:
        rules: which.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, rules: Sequence[Rule], scale: np.ndarray) -> None:
        literals = [literal for rule in rules for literal in rule.literals]
        unique = list(dict.fromkeys(literals))
        place = {literal: index for index, literal in enumerate(unique)}
        self.members = np.array([place[literal] for literal in literals], dtype=np.intp)
        self.starts = np.cumsum([0, *(len(rule.literals) for rule in rules)], dtype=np.intp)[:-1]
        self.feature = np.array([literal.feature for literal in unique], dtype=np.intp)
        self.sign = np.array([[literal.sign] for literal in unique]).reshape(-1, 1)
        bound = np.array([[literal.bound] for literal in unique]).reshape(-1, 1)
        last = np.array([[literal.last] for literal in unique]).reshape(-1, 1)
        self.threshold = self.sign * last
        self._signed_bound = self.sign * bound
        # Not its reciprocal, which overflows for a very small range.
        self._scale = scale[self.feature, None]

    def truth(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) bool: which rules are true on (n, k) samples."""
        holds = self._signed(rows) > self.threshold
        return self._join(np.logical_and, holds)

    def margins(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) float64: how far (n, k) samples are from making each rule true."""
        with np.errstate(invalid='ignore', over='ignore'):
            distances = (self._signed_bound - self._signed(rows)) / self._scale
        # Adding 0 leaves no minus zero.
        return self._join(np.maximum, distances) + 0.0

    def _signed(self, rows: np.ndarray) -> np.ndarray:
        # Taking is several times as fast as indexing.
        return self.sign * rows.T.take(self.feature, axis=0)

    @cached_property
    def _even(self) -> np.ndarray | None:
        """(longest, rules) ``members``, those of shorter rules repeated; None if far more."""
        lengths = np.diff(self.starts, append=len(self.members))
        place = np.arange(lengths.max(initial=1))[:, None]
        if place.size * lengths.size > _MOST_REPEATED * self.members.size:
            return None
        return self.members[self.starts + np.minimum(place, lengths - 1)]

    def _join(self, call: np.ufunc, values: np.ndarray) -> np.ndarray:
        """Return (rules, n) what a call makes of the (m, n) values of each rule's literals."""
        if self._even is None:
            return call.reduceat(values.take(self.members, axis=0), self.starts, axis=0)
        # Several times as fast: reduceat needs as long for each result as for some ten numbers.
        return call.reduce(values.take(self._even, axis=0), axis=0)
