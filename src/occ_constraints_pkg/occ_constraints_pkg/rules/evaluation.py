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
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.rules.rule import COMPARISONS, Literal, Rule, Subject, split_off_single
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

# Nesting of factored literals; what is left is evaluated rule by rule, so recursion stays shallow.
_DEEPEST = 20


class _Group(NamedTuple):
    """Literals of one feature, at most one lower and one upper; or one of a family.

    Attributes:
        literals: one or two.
    """

    literals: tuple[Literal, ...]

    @property
    def first(self) -> Literal:
        """Any of them, for what they have in common."""
        return self.literals[0]


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
            for member in literal.members:
                box[end, member] = pick(box[end, member], literal.last)
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
    by_subject = sorted(literals, key=attrgetter('subject'))
    return tuple(_Group(tuple(same)) for _, same in groupby(by_subject, attrgetter('subject')))


def _literals(formula: Disjunction) -> Iterator[Literal]:
    for group in formula.ends:
        yield from group.literals
    for groups, inner in formula.parts:
        for group in groups:
            yield from group.literals
        yield from _literals(inner)


_Pick = Callable[[list[float]], tuple[float, ...]]
_Decide = Callable[[tuple[float, ...]], float]


class _Extremes:
    """The smallest and the largest members of families, as columns behind the features.

    Args:
        features: number of features, k.
        literals: what has to be evaluated; only what they are about gets a column.
    """

    def __init__(self, features: int, literals: Iterable[Literal]) -> None:
        subjects: dict[Subject, None] = dict.fromkeys(
            literal.subject for literal in literals if literal.is_family
        )
        self._features = features
        self._places = {subject: features + place for place, subject in enumerate(subjects)}
        self._of_row: list[tuple[_Pick, _Decide]] = [
            (itemgetter(*members), min if end < 0 else max) for members, end in subjects
        ]
        self._of_columns = [
            (_as_slice(members), np.fmin if end < 0 else np.fmax) for members, end in subjects
        ]

    def __len__(self) -> int:
        return len(self._places)

    def column(self, literal: Literal) -> int:
        """Return where the values that decide are."""
        if isinstance(literal.feature, tuple):
            return self._places[literal.subject]
        return literal.feature

    def extend(self, row: list[float]) -> list[float]:
        """Return a sample of k finite numbers with the extremes appended."""
        if not self._of_row:
            return row
        return row + [decide(members(row)) for members, decide in self._of_row]

    def fill(self, columns: np.ndarray) -> None:
        """Compute the extremes in (k + extremes, n) columns, of which the first k are there."""
        for place, (members, decide) in enumerate(self._of_columns, self._features):
            decide.reduce(columns[members], axis=0, out=columns[place])

    def extended(self, rows: np.ndarray) -> np.ndarray:
        """Return (k + extremes, n) columns for (n, k) samples."""
        if not self._of_columns:
            return rows.T
        columns = np.empty((self._features + len(self), len(rows)))
        columns[: self._features] = rows.T
        self.fill(columns)
        return columns


def _as_slice(members: tuple[int, ...]) -> slice | list[int]:
    """Return an index of these members; one that copies nothing, if they are adjacent."""
    first, last = members[0], members[-1]
    return slice(first, last + 1) if members == tuple(range(first, last + 1)) else list(members)


# A column, and the closed interval on which its literals are true.
_Condition = tuple[int, float, float]
# Conditions that must all be true, and branches, one of which must be true if there are any.
_Branch = tuple[tuple[_Condition, ...], tuple['_Branch', ...]]
# Column, sign, signed bound and scale of a literal: its distance from becoming true.
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
        # Single literals are in the box, those of families as bounds of each member.
        several = Disjunction((), formula.parts)
        self._truth_extremes = _Extremes(len(space), _literals(several))
        self._branches = _branches(several, self._truth_extremes)
        self._extremes = _Extremes(len(space), _literals(formula))
        self._distances = _distances(formula, scale.tolist(), self._extremes)

    def verdict(self, row: list[float]) -> Verdict:
        """Return the verdict on one sample."""
        for value, (low, high) in zip(row, self._box, strict=True):
            # Written so that NaN fails.
            if not low <= value <= high:
                return Verdict.VIOLATED if self.is_known(row) else Verdict.UNKNOWN
        row = self._truth_extremes.extend(row)
        return Verdict.VIOLATED if _is_true(self._branches, row) else Verdict.SAFE

    def is_known(self, row: list[float]) -> bool:
        """Whether all features of one sample are finite and within their physical bounds."""
        for value, (low, high) in zip(row, self._bounds, strict=True):
            if not low <= value <= high:
                return False
        return True

    def margin(self, row: list[float]) -> float:
        """Return the margin of one sample; what one that is not known gives has no meaning."""
        row = self._extremes.extend(row)
        # Adding 0 leaves no minus zero.
        return _lowered(math.inf, self._distances, row, -math.inf) + 0.0


def _is_true(branches: tuple[_Branch, ...], row: list[float]) -> bool:
    for conditions, inner in branches:
        for column, low, high in conditions:
            if not low <= row[column] <= high:
                break
        else:
            if not inner or _is_true(inner, row):
                return True
    return False


def _branches(formula: Disjunction, extremes: _Extremes) -> tuple[_Branch, ...]:
    single = (
        ((_condition(_Group((literal,)), extremes),), ())
        for group in formula.ends
        for literal in group.literals
    )
    return (
        *single,
        *(
            (tuple(_condition(group, extremes) for group in groups), _branches(inner, extremes))
            for groups, inner in formula.parts
        ),
    )


def _lowered(margin: float, formula: _Distances, row: list[float], least: float) -> float:
    """Return the smaller one of a margin and that of a formula, which is ``least`` or more.

    The margin of a conjunction is at least that of its first literals, so where these alone are
    no smaller, the rest needs no look.
    """
    ends, parts = formula
    for column, sign, bound, scale in ends:
        distance = (bound - sign * row[column]) / scale
        if distance < margin:
            margin = max(distance, least)
    for condition, inner in parts:
        outer = least
        for column, sign, bound, scale in condition:
            distance = (bound - sign * row[column]) / scale
            if distance > outer:
                outer = distance
                if outer >= margin:
                    break
        else:
            margin = _lowered(margin, inner, row, outer)
    return margin


def _distances(formula: Disjunction, scale: list[float], extremes: _Extremes) -> _Distances:
    parts = (
        (_of_groups(groups, scale, extremes), _distances(inner, scale, extremes))
        for groups, inner in formula.parts
    )
    return _of_groups(formula.ends, scale, extremes), tuple(parts)


def _of_groups(
    groups: Iterable[_Group], scale: list[float], extremes: _Extremes
) -> tuple[_Distance, ...]:
    return tuple(
        (
            extremes.column(literal),
            literal.sign,
            literal.sign * literal.bound,
            scale[literal.members[0]],
        )
        for group in groups
        for literal in group.literals
    )


def _condition(group: _Group, extremes: _Extremes) -> _Condition:
    low, high = -math.inf, math.inf
    for literal in group.literals:
        if literal.is_upper:
            high = literal.first
        else:
            low = literal.first
    return extremes.column(group.first), low, high


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
        for block, columns in self._blocks(rows, self._truth):
            # For truth values greater is "and not".
            np.greater(self._within(columns, self._box), self._truth.run(columns), passed[block])
        return passed

    def margins(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) whether samples are known, and (n,) their margins, meaningless if not."""
        known, margin = np.empty(len(rows), dtype=bool), np.empty(len(rows))
        for block, columns in self._blocks(rows, self._margin):
            known[block] = self._within(columns, self._bounds)
            # Adding 0 leaves no minus zero.
            np.add(self._margin.run(columns), 0.0, out=margin[block])
        return known, margin

    def _blocks(self, rows: np.ndarray, program: _Program) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield blocks of rows as columns for a program; the next block reuses the memory."""
        features, extremes = rows.shape[1], program.extremes
        size = max(_BLOCK // (features + len(extremes)), _FEWEST_ROWS)
        memory = np.empty((features + len(extremes), min(size, len(rows))))
        for start in range(0, len(rows), size):
            block = slice(start, min(start + size, len(rows)))
            columns = memory[:, : block.stop - start]
            np.copyto(columns[:features], rows[block].T)
            extremes.fill(columns)
            yield block, columns

    def _within(self, columns: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        """Return (n,) whether all features lie in a box (2, k, 1); NaN never does."""
        features = columns[: len(self._scale)]
        inside = features >= bounds[0]
        np.logical_and(inside, features <= bounds[1], out=inside)
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

    Attributes:
        extremes: columns that it needs besides the features.

    Args:
        formula: what to evaluate.
        features: number of features.
        scale: (k,) the unit of distance of each feature, for the margin; ``None``: the truth.
    """

    def __init__(
        self, formula: Disjunction, features: int, scale: np.ndarray | None = None
    ) -> None:
        self.extremes = _Extremes(features, _literals(formula))
        self._columns, self._scale = features + len(self.extremes), scale
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
        """Return (n,) truth or margin of n samples, given as (k + extremes, n) columns.

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
            scale = self._constant(self._scale[group.first.members[0]])
            self._emit(np.divide, ~register, scale, register)

    def _emit_literal(self, literal: Literal, register: int) -> None:
        column, bound = self.extremes.column(literal), self._constant(literal.bound)
        if self._scale is None:
            self._emit(COMPARISONS[literal.operator], column, bound, register)
        elif literal.is_upper:
            self._emit(np.subtract, column, bound, register)
        else:
            self._emit(np.subtract, bound, column, register)

    def _constant(self, number: float) -> int:
        """Return the position of a constant; NumPy is fastest if it is an array."""
        if number not in self._places:
            self._places[number] = self._columns + len(self._constants)
            self._constants.append(np.array(number, dtype=np.float64))
        return self._places[number]


# How many times as many members rules of unequal length may have to be evaluated as equally long.
_MOST_REPEATED = 4


class RuleTable:
    """The literals of some rules as arrays, each distinct literal once.

    Every literal is ``sign * x > threshold``, see :class:`~occ_constraints_pkg.rules.rule.Literal`;
    this is exact, bounds included.

    Attributes:
        literals: the m literals.
        sign: (m, 1) 1.0 or -1.0; a column, for any number of samples.
        threshold: (m, 1) the largest signed value on which the literal is false.
        places: (all literals,) positions of the literals of one rule after another.
        starts: (rules,) where each rule begins in ``places``.

    Args:
        rules: which.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, rules: Sequence[Rule], scale: np.ndarray) -> None:
        literals = [literal for rule in rules for literal in rule.literals]
        self.literals = tuple(dict.fromkeys(literals))
        place = {literal: index for index, literal in enumerate(self.literals)}
        self.places = np.array([place[literal] for literal in literals], dtype=np.intp)
        self.starts = np.cumsum([0, *(len(rule.literals) for rule in rules)], dtype=np.intp)[:-1]
        self.sign = np.array([[item.sign] for item in self.literals]).reshape(-1, 1)
        bound = np.array([[item.bound] for item in self.literals]).reshape(-1, 1)
        last = np.array([[item.last] for item in self.literals]).reshape(-1, 1)
        self.threshold = self.sign * last
        self._signed_bound = self.sign * bound
        self._extremes = _Extremes(len(scale), self.literals)
        self._column = np.array([self._extremes.column(item) for item in self.literals], np.intp)
        # Not its reciprocal, which overflows for a very small range.
        first = np.array([item.members[0] for item in self.literals], dtype=np.intp)
        self._scale = scale[first, None]

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
        return self.sign * self._extremes.extended(rows).take(self._column, axis=0)

    @cached_property
    def _even(self) -> np.ndarray | None:
        """(longest, rules) ``places``, those of shorter rules repeated; None if far more."""
        lengths = np.diff(self.starts, append=len(self.places))
        place = np.arange(lengths.max(initial=1))[:, None]
        if place.size * lengths.size > _MOST_REPEATED * self.places.size:
            return None
        return self.places[self.starts + np.minimum(place, lengths - 1)]

    def _join(self, call: np.ufunc, values: np.ndarray) -> np.ndarray:
        """Return (rules, n) what a call makes of the (m, n) values of each rule's literals."""
        if self._even is None:
            return call.reduceat(values.take(self.places, axis=0), self.starts, axis=0)
        # Several times as fast: reduceat needs as long for each result as for some ten numbers.
        return call.reduce(values.take(self._even, axis=0), axis=0)
