# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Literals and rules: the parts of a formula in disjunctive normal form."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable

COMPARISONS = {'<': np.less, '<=': np.less_equal, '>': np.greater, '>=': np.greater_equal}
OPERATORS = tuple(COMPARISONS)


@dataclass(frozen=True)
class Literal:
    """A comparison of one feature with a bound, true on a half-line.

    Everything else about this half-line is derived here, exactly: ``first`` and ``last`` are the
    adjacent floats on both sides of its end, and the signed form is ``sign * x > sign * last``.

    Attributes:
        feature: position of the feature in its space.
        operator: ``<``, ``<=``, ``>`` or ``>=``.
        bound: finite number in the feature's unit.

    Raises:
        ConfigurationError: the operator is unknown, or the bound not finite.

    Example:
        >>> occ.Literal(0, '>', 1.5).holds(np.array([1.5, 1.6]))
        array([False,  True])
    """

    feature: int
    operator: str
    bound: float

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise ConfigurationError(
                f'operator {self.operator!r} is not known; allowed are {" ".join(OPERATORS)}'
            )
        if not math.isfinite(self.bound):
            raise ConfigurationError(f'bound: got {self.bound}; allowed is a finite number')

    @property
    def is_upper(self) -> bool:
        """Whether the literal is true for small values, so it bounds the feature from above."""
        return self.operator in ('<', '<=')

    @property
    def is_strict(self) -> bool:
        """Whether the literal is false at the bound itself."""
        return self.operator in ('<', '>')

    @property
    def sign(self) -> float:
        """1.0 where large values make the literal true, -1.0 where small ones do."""
        return -1.0 if self.is_upper else 1.0

    @property
    def first(self) -> float:
        """The true value closest to the bound; infinite if there is none."""
        return math.nextafter(self.bound, self.sign * math.inf) if self.is_strict else self.bound

    @property
    def last(self) -> float:
        """The false value closest to the bound; infinite if there is none."""
        return self.bound if self.is_strict else math.nextafter(self.bound, -self.sign * math.inf)

    def contains(self, other: Literal) -> bool:
        """Return whether this holds wherever ``other``, on the same side of the feature, does."""
        if self.bound == other.bound:
            return other.is_strict or not self.is_strict
        return (self.bound > other.bound) == self.is_upper

    def text(self, space: FeatureSpace) -> str:
        """Return the literal in symbols with the exact bound, for example ``v_x > 1.46``."""
        return f'{space.names[self.feature]} {self.operator} {float(self.bound)!r}'

    def is_always_true(self, space: FeatureSpace) -> bool:
        """Return whether every value within the physical bounds makes the literal true."""
        low, high = space.finite_bounds[:, self.feature]
        return bool(self.first >= high if self.is_upper else self.first <= low)

    def is_never_true(self, space: FeatureSpace) -> bool:
        """Return whether no value within the physical bounds makes the literal true."""
        low, high = space.finite_bounds[:, self.feature]
        return bool(self.first < low if self.is_upper else self.first > high)

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Tell for each value (n,) of the feature whether it makes the literal true: (n,) bool."""
        return COMPARISONS[self.operator](values, self.bound)

    def distances(self, values: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """Return how far values of the feature are from making the literal true.

        Args:
            values: (n,) values of the feature.
            scale: the unit of distance.

        Returns:
            (n,) float64: at most 0 where the literal is true. At the bound the distance is 0, and
            strictness decides.
        """
        with np.errstate(over='ignore'):
            away = values - self.bound if self.is_upper else self.bound - values
            return away / scale


@dataclass(frozen=True)
class Rule:
    """A conjunction of literals that, when true, is a violation.

    Attributes:
        id: stable identifier, unique in its rule set.
        literals: at least one.
        enabled: a disabled rule is kept in the file but never evaluated.
        note: free text of a person, or why the rule was disabled.
        evaluated: number of samples that the rule was evaluated on.
        violated: number of those on which it was true.

    Raises:
        ConfigurationError: there is no literal.

    Example:
        >>> space = occ.FeatureSpace((occ.Feature('speed', 'm/s'), occ.Feature('clearance', 'm')))
        >>> rule = occ.Rule('close', (occ.Literal(0, '>', 0.5), occ.Literal(1, '<', 0.8)))
        >>> rule.words(space)
        'speed above 0.5 m/s and clearance below 0.8 m'
        >>> rule.holds(np.array([[0.6, 0.7], [0.4, 0.7]]))
        array([ True, False])
    """

    id: str
    literals: tuple[Literal, ...]
    enabled: bool = True
    note: str = ''
    evaluated: int = 0
    violated: int = 0

    def __post_init__(self) -> None:
        if not self.literals:
            raise ConfigurationError(f'rule {self.id!r} has no literal; it would flag everything')

    def holds(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether the rule is true: (n,) bool."""
        return np.logical_and.reduce(
            [literal.holds(rows[:, literal.feature]) for literal in self.literals]
        )

    def margins(self, rows: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Return how far samples are from making the rule true.

        Args:
            rows: (n, k) samples.
            scale: (k,) the unit of distance of each feature.

        Returns:
            (n,) float64, the largest distance of a literal: at most 0 where the rule is true.
        """
        distances = [
            literal.distances(rows[:, literal.feature], scale[literal.feature])
            for literal in self.literals
        ]
        return np.maximum.reduce(distances) + 0.0

    def formula(self, space: FeatureSpace) -> str:
        """Return the conjunction in symbols, bounds exact."""
        return ' and '.join(literal.text(space) for literal in self.literals)

    def words(self, space: FeatureSpace) -> str:
        """Return the rule in words, with units and bounds to four digits.

        Two literals that enclose one feature become a range, with more digits where four would not
        distinguish its ends; of several on one side the tightest is used. Control characters of
        names and units are escaped.
        """
        lower, upper = self._tightest()
        parts = []
        for feature in dict.fromkeys(literal.feature for literal in self.literals):
            name, unit = space.names[feature], space.features[feature].unit
            name, unit = printable(name), printable(unit)
            suffix = '' if unit == '1' else f' {unit}'
            low, high = lower.get(feature), upper.get(feature)
            if low and high and low.bound == high.bound:
                parts.append(f'{name} equal to {_short(low.bound)}{suffix}')
            elif low and high:
                inside = 'from {} to {}' if low.operator == '>=' else 'between {} and {}'
                parts.append(f'{name} {inside.format(*_apart(low.bound, high.bound))}{suffix}')
            elif low:
                word = 'above' if low.operator == '>' else 'at least'
                parts.append(f'{name} {word} {_short(low.bound)}{suffix}')
            elif high:
                word = 'below' if high.operator == '<' else 'at most'
                parts.append(f'{name} {word} {_short(high.bound)}{suffix}')
        return ' and '.join(parts)

    @property
    def tightest_literals(self) -> tuple[Literal, ...]:
        """The literals that matter: of several on one side of a feature only the tightest."""
        lower, upper = self._tightest()
        return tuple(
            literal
            for feature in dict.fromkeys(item.feature for item in self.literals)
            for literal in (lower.get(feature), upper.get(feature))
            if literal is not None
        )

    @property
    def is_contradictory(self) -> bool:
        """Whether two literals exclude each other, so that the rule can never be true."""
        lower, upper = self._tightest()
        for feature in lower.keys() & upper.keys():
            # Not by `first`: between adjacent floats there is a real number, though no float.
            low, high = lower[feature], upper[feature]
            is_open = low.is_strict or high.is_strict
            if low.bound > high.bound or (low.bound == high.bound and is_open):
                return True
        return False

    def _tightest(self) -> tuple[dict[int, Literal], dict[int, Literal]]:
        """Return the tightest lower and the tightest upper literal of each feature."""
        # The tightest comes last and wins; at equal bounds, the strict one.
        lower = sorted(
            (item for item in self.literals if not item.is_upper),
            key=lambda item: (item.bound, item.is_strict),
        )
        upper = sorted(
            (item for item in self.literals if item.is_upper),
            key=lambda item: (-item.bound, item.is_strict),
        )
        return {item.feature: item for item in lower}, {item.feature: item for item in upper}


def split_off_single(
    conjunctions: Iterable[tuple[Literal, ...]],
) -> tuple[list[Literal], list[tuple[Literal, ...]]]:
    """Split conjunctions into single literals and those longer ones that no single one implies.

    Returns:
        For each side of a feature the widest of the conjunctions of one literal, in the order of
        their first appearance; and the longer conjunctions of which no literal implies one of
        these: whatever is left out is true only where something kept is true.
    """
    conjunctions = list(conjunctions)
    widest: dict[tuple[int, bool], Literal] = {}
    for literals in conjunctions:
        if len(literals) == 1 and not _is_implied(literals[0], widest):
            widest[literals[0].feature, literals[0].is_upper] = literals[0]
    longer = [
        literals
        for literals in conjunctions
        if len(literals) > 1 and not any(_is_implied(literal, widest) for literal in literals)
    ]
    return list(widest.values()), longer


def _is_implied(literal: Literal, widest: dict[tuple[int, bool], Literal]) -> bool:
    other = widest.get((literal.feature, literal.is_upper))
    return other is not None and other.contains(literal)


def _short(number: float) -> str:
    return f'{number:.4g}'


def _apart(low: float, high: float) -> tuple[str, str]:
    """Format two different numbers with as many digits, at least four, as distinguish them."""
    texts = ((f'{low:.{digits}g}', f'{high:.{digits}g}') for digits in range(4, 18))
    return next(pair for pair in texts if pair[0] != pair[1])
