# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What goes in and what comes out: features, literals, conditional rules, the safe set."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError

_COMPARE = {'<': operator.lt, '<=': operator.le, '>': operator.gt, '>=': operator.ge}


@dataclass(frozen=True)
class Feature:
    """One column of the samples.

    Attributes:
        name: for people.
        low: physical lower bound.
        high: physical upper bound.
        family: features of the same family are also looked at as one: any of them below, any of
            them above. Empty for none.
        discrete: whether its values are labels, such as modes or lanes; ``None`` to tell by their
            number.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    family: str = ''
    discrete: bool | None = None


@dataclass(frozen=True)
class Literal:
    """``feature op bound``, or ``any FAMILY op bound``: true when any member's value is.

    Attributes:
        columns: position of the feature; of a family, those of all members.
        operator: ``<``, ``<=``, ``>`` or ``>=``.
        bound: finite number.
        family: name of the family; empty for a feature.

    Raises:
        ConfigurationError: the operator is unknown, the bound is not finite, or there is no column.
    """

    columns: tuple[int, ...]
    operator: str
    bound: float
    family: str = ''

    def __post_init__(self) -> None:
        if self.operator not in _COMPARE:
            raise ConfigurationError(
                f'operator {self.operator!r} is not known; allowed are {" ".join(_COMPARE)}'
            )
        if not math.isfinite(self.bound):
            raise ConfigurationError(f'bound: got {self.bound}; allowed is a finite number')
        if not self.columns or (len(self.columns) > 1 and not self.family):
            raise ConfigurationError(
                f'columns {self.columns} of a literal; allowed are one, or those of a family'
            )

    @property
    def is_upper(self) -> bool:
        """Whether small values make the literal true."""
        return self.operator in ('<', '<=')

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether the literal is true: (n,) bool."""
        compare = _COMPARE[self.operator]
        if len(self.columns) == 1:
            return compare(values[:, self.columns[0]], self.bound)
        return compare(values[:, list(self.columns)], self.bound).any(axis=1)

    def text(self, names: Sequence[str]) -> str:
        """Return the literal in symbols, its bound exact."""
        subject = f'any {self.family}' if self.family else names[self.columns[0]]
        return f'{subject} {self.operator} {float(self.bound)!r}'


@dataclass(frozen=True)
class ConditionalRule:
    """A conjunction that no demonstration enters, although many ought to.

    Attributes:
        literals: two or more. ``x >= v and x <= v`` says that a discrete feature is ``v``.
        expected: share of the time that would be spent there, were its parts independent.
        seen: share of the demonstrations on which it is true.
        evidence: minus the logarithm of the chance to see so little if nothing forbade it.
    """

    literals: tuple[Literal, ...]
    expected: float
    seen: float
    evidence: float

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether the rule is true: (n,) bool."""
        true = self.literals[0].holds(values)
        for literal in self.literals[1:]:
            true &= literal.holds(values)
        return true

    def text(self, names: Sequence[str]) -> str:
        """Return the rule in symbols."""
        return ' and '.join(literal.text(names) for literal in self.literals)


@dataclass(frozen=True, eq=False)
class LearnedRules:
    """The safe set: a box less what conditional rules forbid.

    Attributes:
        box: (k, 2) smallest and largest safe value of each feature; infinite where every value
            is safe.
        demonstrated: (k, 2) smallest and largest demonstrated value; a family shares them.
        rules: the conditional rules, in the order they were found.
        steps: by position of each discrete feature, the smallest distance of two of its values.
    """

    box: np.ndarray
    demonstrated: np.ndarray
    rules: tuple[ConditionalRule, ...]
    steps: Mapping[int, float] = field(default_factory=dict)

    def flagged_by_box(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether it lies outside the box: (n,) bool."""
        outside = (values < self.box[:, 0]) | (values > self.box[:, 1])
        return np.asarray(outside.any(axis=1))

    def flagged_by_rules(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether a conditional rule is true: (n,) bool."""
        true = np.zeros(len(values), dtype=bool)
        for rule in self.rules:
            true |= rule.holds(values)
        return true

    def flagged(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether it is outside the safe set: (n,) bool."""
        return self.flagged_by_box(values) | self.flagged_by_rules(values)
