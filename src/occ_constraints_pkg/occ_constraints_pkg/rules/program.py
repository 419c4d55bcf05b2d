# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A factored formula as a list of NumPy calls on columns, for its truth or for its margin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.rules.formula import Disjunction, Group
from occ_constraints_pkg.rules.rule import COMPARISONS, Literal


class _Step(NamedTuple):
    """One call, with the places of two operands and of the result."""

    call: np.ufunc
    left: int
    right: int
    result: int


class Program:
    """Evaluates a formula on a block of samples, whole columns at a time.

    Operands are the columns, then constants, then registers for what is computed. The registers
    are few, so they stay in the cache; they are counted from the end, register r at place ~r.

    Args:
        formula: what to evaluate.
        features: number of columns.
        scale: (k,) the unit of distance of each feature, to get the margin; none: the truth.
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
        self._write_disjunction(formula, 0)
        self._registers = 1 + max((~step.result for step in self._steps), default=0)

    def run(self, columns: np.ndarray) -> np.ndarray:
        """Return (n,) truth or margin of n samples, given as (k, n) columns.

        What numbers that are not finite give has no meaning.
        """
        registers: np.ndarray = np.empty((self._registers, columns.shape[1]), dtype=self._type)
        operands = [*columns, *self._constants, *registers[::-1]]
        if not self._steps:
            # No rule is never true, and infinitely far.
            registers.fill(False if self._scale is None else np.inf)
        with np.errstate(invalid='ignore', over='ignore', under='ignore'):
            for call, left, right, result in self._steps:
                call(operands[left], operands[right], out=operands[result])
        return registers[0]

    def _write(self, call: np.ufunc, left: int, right: int, register: int) -> None:
        self._steps.append(_Step(call, left, right, ~register))

    def _write_disjunction(self, formula: Disjunction, register: int) -> None:
        """Write what leaves the value of a disjunction in a register; uses those after it."""
        free = register
        for group in formula.ends:
            self._write_group(group, self._either, free)
            free = self._join(register, free)
        for condition, inner in formula.parts:
            self._write_disjunction(inner, free)
            for group in condition:
                self._write_group(group, self._both, free + 1)
                self._write(self._both, ~free, ~(free + 1), free)
            free = self._join(register, free)

    def _join(self, register: int, free: int) -> int:
        """Write what adds the value in ``free`` to a disjunction; return the next free register.

        The disjunction's first value is in its register already.
        """
        if free != register:
            self._write(self._either, ~register, ~free, register)
        return register + 1

    def _write_group(self, group: Group, combine: np.ufunc, register: int) -> None:
        first, *others = group.literals
        self._write_literal(first, register)
        for literal in others:
            self._write_literal(literal, register + 1)
            self._write(combine, ~register, ~(register + 1), register)
        if self._scale is not None:
            # Once per group: dividing by a positive number keeps smallest and largest.
            scale = self._constant(self._scale[group.feature])
            self._write(np.divide, ~register, scale, register)

    def _write_literal(self, literal: Literal, register: int) -> None:
        feature, bound = literal.feature, self._constant(literal.bound)
        if self._scale is None:
            self._write(COMPARISONS[literal.operator], feature, bound, register)
        elif literal.is_upper:
            self._write(np.subtract, feature, bound, register)
        else:
            self._write(np.subtract, bound, feature, register)

    def _constant(self, number: float) -> int:
        """Return the place of a constant; as an array, for NumPy takes those fastest."""
        if number not in self._places:
            self._places[number] = self._features + len(self._constants)
            self._constants.append(np.array(number, dtype=np.float64))
        return self._places[number]
