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

# What literals of one range are about, see Literal.subject.
Subject = tuple[tuple[int, ...], int]
# A feature or a family, and whether its upper end.
Side = tuple[int | tuple[int, ...], bool]


def subject_label(subject: Subject, space: FeatureSpace) -> str:
    """Return the words beside an axis of a picture: what, and its unit.

    Args:
        subject: of the literals drawn.
        space: of the features.
    """
    members, which = subject
    feature = space.features[members[0]]
    extreme = {-1: f'smallest {feature.family}', 1: f'largest {feature.family}'}
    unit = '' if feature.unit == '1' else f' [{feature.unit}]'
    return printable(extreme.get(which, feature.name) + unit)


@dataclass(frozen=True)
class Literal:
    """A comparison of one feature, or of any member of a family, with a bound.

    It is true on a half-line. Everything else about this half-line is derived here, exactly:
    ``first`` and ``last`` are the adjacent floats on both sides of its end, and the signed form is
    ``sign * x > sign * last``. Of a family, x is the member that makes the literal true if any
    does: the smallest for ``<`` and ``<=``, else the largest.

    Attributes:
        feature: position of the feature in its space; or of all members of a family, one of
            :attr:`FeatureSpace.families`, of which any makes the literal true.
        operator: ``<``, ``<=``, ``>`` or ``>=``.
        bound: finite number in the feature's unit.

    Raises:
        ConfigurationError: the operator is unknown, or the bound not finite.

    Example:
        >>> occ.Literal(0, '>', 1.5).holds(np.array([1.5, 1.6]))
        array([False,  True])
        >>> sectors = [occ.Feature(f'd_{i}', 'm', family='d') for i in range(3)]
        >>> occ.Literal((0, 1, 2), '<', 0.3).text(occ.FeatureSpace(tuple(sectors)))
        'any d < 0.3'
    """

    feature: int | tuple[int, ...]
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
    def is_family(self) -> bool:
        """Whether the literal is about any member of a family."""
        return isinstance(self.feature, tuple)

    @property
    def members(self) -> tuple[int, ...]:
        """Positions of the features of which any makes the literal true."""
        return self.feature if isinstance(self.feature, tuple) else (self.feature,)

    @property
    def subject(self) -> Subject:
        """What is compared with the bound: the same for two literals that limit one number.

        The members, and which of them: 0 for the only one, -1 for the smallest, 1 for the largest.
        """
        return self.members, (-1 if self.is_upper else 1) if self.is_family else 0

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
        """Return whether this holds wherever ``other`` does.

        Args:
            other: a literal on the same side of the feature, or of a member of the family.
        """
        if self.bound == other.bound:
            return other.is_strict or not self.is_strict
        return (self.bound > other.bound) == self.is_upper

    def name(self, space: FeatureSpace) -> str:
        """Return what the literal is about, for example ``v_x`` or ``any hazards``."""
        first = space.features[self.members[0]]
        return f'any {first.family}' if self.is_family else first.name

    def text(self, space: FeatureSpace) -> str:
        """Return the literal in symbols with the exact bound, for example ``v_x > 1.46``."""
        return f'{self.name(space)} {self.operator} {float(self.bound)!r}'

    def is_always_true(self, space: FeatureSpace) -> bool:
        """Return whether every value within the physical bounds makes the literal true."""
        low, high = space.finite_bounds[:, self.members[0]]
        return bool(self.first >= high if self.is_upper else self.first <= low)

    def is_never_true(self, space: FeatureSpace) -> bool:
        """Return whether no value within the physical bounds makes the literal true."""
        low, high = space.finite_bounds[:, self.members[0]]
        return bool(self.first < low if self.is_upper else self.first > high)

    def values(self, rows: np.ndarray) -> np.ndarray:
        """Return the (n,) values in (n, k) samples that decide whether the literal is true."""
        if not self.is_family:
            return rows[:, self.feature]
        decide = np.fmin if self.is_upper else np.fmax
        return decide.reduce(rows[:, list(self.members)], axis=1)

    def deciding(self, sample: np.ndarray) -> int:
        """Return the feature whose value decides in one sample (k,) of finite numbers."""
        own = self.sign * sample[list(self.members)]
        return self.members[int(own.argmax())]

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Tell for each value (n,) that decides whether it makes the literal true: (n,) bool."""
        return COMPARISONS[self.operator](values, self.bound)

    def distances(self, values: np.ndarray, scale: float = 1.0) -> np.ndarray:
        """Return how far values that decide are from making the literal true.

        Args:
            values: (n,) values of the feature; of a family, those that decide.
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
            [literal.holds(literal.values(rows)) for literal in self.literals]
        )

    def margins(self, rows: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Return how far samples are from making the rule true.

        Args:
            rows: (n, k) samples.
            scale: (k,) the unit of distance of each feature, one for all members of a family.

        Returns:
            (n,) float64, the largest distance of a literal: at most 0 where the rule is true.
        """
        distances = [
            literal.distances(literal.values(rows), scale[literal.members[0]])
            for literal in self.literals
        ]
        return np.maximum.reduce(distances) + 0.0

    def formula(self, space: FeatureSpace) -> str:
        """Return the conjunction in symbols, bounds exact."""
        return ' and '.join(literal.text(space) for literal in self.literals)

    def words(self, space: FeatureSpace, sample: np.ndarray | None = None) -> str:
        """Return the rule in words, with units and bounds to four digits.

        Two literals that enclose one feature become a range, with more digits where four would not
        distinguish its ends; of several on one side the tightest is used. Control characters of
        names and units are escaped.

        Args:
            space: the features.
            sample: (k,) finite values, of which the member of a family that decides is named, as in
                ``any hazards above 0.926 (hazards_3 at 0.953)``; ``None`` names none.
        """
        lower, upper = self._tightest()
        parts = []
        for literal in self.literals:
            low, high = lower.pop(literal.subject, None), upper.pop(literal.subject, None)
            if low is None and high is None:
                continue
            name, unit = literal.name(space), space.features[literal.members[0]].unit
            name, unit = printable(name), printable(unit)
            suffix = '' if unit == '1' else f' {unit}'
            if sample is not None and literal.is_family:
                member = literal.deciding(sample)
                suffix += f' ({printable(space.names[member])} at {_short(sample[member])})'
            if low and high and low.bound == high.bound:
                parts.append(f'{name} equal to {_short(low.bound)}{suffix}')
            elif low and high:
                inside = 'from {} to {}' if low.operator == '>=' else 'between {} and {}'
                parts.append(f'{name} {inside.format(*apart(low.bound, high.bound))}{suffix}')
            elif low:
                word = 'above' if low.operator == '>' else 'at least'
                parts.append(f'{name} {word} {_short(low.bound)}{suffix}')
            elif high:
                word = 'below' if high.operator == '<' else 'at most'
                parts.append(f'{name} {word} {_short(high.bound)}{suffix}')
        return ' and '.join(parts)

    def deciding(self, sample: np.ndarray) -> tuple[int, ...]:
        """Return the features whose values decide in one sample (k,) of finite numbers, once each.

        Those of its literals; of a family, the smallest or the largest member.
        """
        return tuple(dict.fromkeys(literal.deciding(sample) for literal in self.literals))

    def fired(self, sample: np.ndarray) -> tuple[int, ...]:
        """Return the features that make a literal true in one sample (k,), once each."""
        members = ((member, literal) for literal in self.literals for member in literal.members)
        return tuple(
            dict.fromkeys(member for member, literal in members if literal.holds(sample[member]))
        )

    @property
    def tightest_literals(self) -> tuple[Literal, ...]:
        """The literals that matter: of several on one side of a feature only the tightest."""
        lower, upper = self._tightest()
        return tuple(
            literal
            for subject in dict.fromkeys(item.subject for item in self.literals)
            for literal in (lower.get(subject), upper.get(subject))
            if literal is not None
        )

    @property
    def is_contradictory(self) -> bool:
        """Whether two literals exclude each other, so that the rule can never be true."""
        lower, upper = self._tightest()
        for subject in lower.keys() & upper.keys():
            # Not by `first`: between adjacent floats there is a real number, though no float.
            low, high = lower[subject], upper[subject]
            is_open = low.is_strict or high.is_strict
            if low.bound > high.bound or (low.bound == high.bound and is_open):
                return True
        return False

    def _tightest(self) -> tuple[dict[Subject, Literal], dict[Subject, Literal]]:
        """Return the tightest lower and the tightest upper literal of each subject."""
        # The tightest comes last and wins; at equal bounds, the strict one.
        lower = sorted(
            (item for item in self.literals if not item.is_upper),
            key=lambda item: (item.bound, item.is_strict),
        )
        upper = sorted(
            (item for item in self.literals if item.is_upper),
            key=lambda item: (-item.bound, item.is_strict),
        )
        return {item.subject: item for item in lower}, {item.subject: item for item in upper}


def split_off_single(
    conjunctions: Iterable[tuple[Literal, ...]],
) -> tuple[list[Literal], list[tuple[Literal, ...]]]:
    """Split conjunctions into single literals and those longer ones that no single one implies.

    Returns:
        For each side of a feature or family the widest of the conjunctions of one literal, in the
        order of their first appearance, unless that of its family is as wide; and the longer
        conjunctions of which no literal implies one of these: whatever is left out is true only
        where something kept is true.
    """
    conjunctions = list(conjunctions)
    widest: dict[Side, Literal] = {}
    for literals in conjunctions:
        if len(literals) == 1:
            _widen(widest, literals[0].feature, literals[0])
    # What a family's literal is for each member.
    shared: dict[Side, Literal] = {}
    for literal in widest.values():
        for member in literal.members if literal.is_family else ():
            _widen(shared, member, literal)
    single = [literal for literal in widest.values() if not _is_implied(literal, shared)]
    longer = [
        literals
        for literals in conjunctions
        if len(literals) > 1
        and not any(_is_implied(one, widest) or _is_implied(one, shared) for one in literals)
    ]
    return single, longer


def _widen(widest: dict[Side, Literal], feature: int | tuple[int, ...], literal: Literal) -> None:
    side = feature, literal.is_upper
    if side not in widest or not widest[side].contains(literal):
        widest[side] = literal


def _is_implied(literal: Literal, widest: dict[Side, Literal]) -> bool:
    other = widest.get((literal.feature, literal.is_upper))
    return other is not None and other.contains(literal)


def _short(number: float) -> str:
    return f'{number:.4g}'


def apart(low: float, high: float) -> tuple[str, str]:
    """Format two different numbers with as many digits, at least four, as distinguish them."""
    texts = ((f'{low:.{digits}g}', f'{high:.{digits}g}') for digits in range(4, 18))
    return next(pair for pair in texts if pair[0] != pair[1])
