# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a literal may be about: a feature, a discrete feature, the least or largest of a family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.conditional.rules import Feature, Literal

MOST_KINDS = 8
"""A feature with more distinct values than this is continuous unless its user says otherwise."""

MOST_COMBINED = 100
"""Of more, the members of families are looked at together only; of still more, none is."""

BELOW, EQUAL, ABOVE = -1, 0, 1
_SOME = 4096


class Cut(NamedTuple):
    """A literal during the search.

    Attributes:
        unit: position of the unit.
        side: :data:`BELOW`, :data:`EQUAL` or :data:`ABOVE`; of discrete values the bound is
            included, of others not.
        bound: what is compared with.
    """

    unit: int
    side: int
    bound: float


@dataclass(frozen=True, eq=False)
class Unit:
    """What is looked at as one.

    Attributes:
        name: of the feature or the family.
        columns: position of the feature, or those of a family's members.
        sides: which sides its literals may have.
        kinds: the distinct values, ascending, if it is discrete.
    """

    name: str
    columns: tuple[int, ...]
    sides: tuple[int, ...]
    kinds: np.ndarray | None = None

    @property
    def is_discrete(self) -> bool:
        """Whether its values are labels."""
        return self.kinds is not None

    @property
    def is_family(self) -> bool:
        """Whether it stands for several features."""
        return len(self.columns) > 1

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return its (n,) values in (n, k) samples: of a family, those that decide."""
        first = np.ascontiguousarray(values[:, self.columns[0]])
        if not self.is_family:
            return first
        decide = np.minimum if self.sides == (BELOW,) else np.maximum
        out = first.copy()
        for column in self.columns[1:]:
            decide(out, values[:, column], out=out)
        return out

    def is_true(self, values: np.ndarray, side: int, bound: float) -> np.ndarray:
        """Tell for (n,) values whether they make a literal true."""
        if side == EQUAL:
            return values == bound
        if self.is_discrete:
            return values <= bound if side == BELOW else values >= bound
        return values < bound if side == BELOW else values > bound

    def literals(self, side: int, bound: float) -> tuple[Literal, ...]:
        """Return what a cut says as literals: two if a discrete feature equals a value."""
        family = self.name if self.is_family else ''
        if side == EQUAL:
            return Literal(self.columns, '>=', bound), Literal(self.columns, '<=', bound)
        operator = '<' if side == BELOW else '>'
        return (Literal(self.columns, operator + '=' * self.is_discrete, bound, family),)


def families_of(features: Sequence[Feature]) -> dict[str, tuple[int, ...]]:
    """Return the positions of the members of each family of two or more."""
    members: dict[str, list[int]] = {}
    for position, feature in enumerate(features):
        if feature.family:
            members.setdefault(feature.family, []).append(position)
    return {name: tuple(found) for name, found in members.items() if len(found) > 1}


def make_units(values: np.ndarray, features: Sequence[Feature]) -> list[Unit]:
    """Return all units that vary: features in their order, then families.

    Args:
        values: (n, k) finite samples.
        features: k descriptions.
    """
    units = []
    for position, feature in enumerate(features):
        column = values[:, position]
        kinds = distinct(column, MOST_KINDS if feature.discrete is None else len(column))
        if kinds is not None and len(kinds) < 2:
            continue
        if kinds is None or feature.discrete is False:
            units.append(Unit(feature.name, (position,), (BELOW, ABOVE)))
        else:
            units.append(Unit(feature.name, (position,), (EQUAL, BELOW, ABOVE), kinds))
    for name, members in families_of(features).items():
        for side in (BELOW, ABOVE):
            unit = Unit(name, members, (side,))
            decisive = unit.of(values)
            if decisive.min() < decisive.max():
                units.append(unit)
    return units


def distinct(column: np.ndarray, most: int) -> np.ndarray | None:
    """Return the distinct values of (n,), ascending, or ``None`` if there are more than ``most``.

    A few samples tell in nearly every case, so that hardly any column has to be sorted.
    """
    kinds = np.unique(column[:: max(1, len(column) // _SOME)])
    if len(kinds) > most:
        return None
    known = np.zeros(len(column), dtype=bool)
    for kind in kinds if len(kinds) <= MOST_KINDS else ():
        known |= column == kind
    if not known.all():
        kinds = np.unique(np.concatenate([kinds, column[~known]]))
    return kinds if len(kinds) <= most else None


def units_to_combine(units: Sequence[Unit]) -> list[int]:
    """Return the positions of the units that are combined, at most :data:`MOST_COMBINED`."""
    if len(units) <= MOST_COMBINED:
        return list(range(len(units)))
    members = {column for unit in units if unit.is_family for column in unit.columns}
    chosen = [
        position
        for position, unit in enumerate(units)
        if unit.is_family or unit.columns[0] not in members
    ]
    return chosen if len(chosen) <= MOST_COMBINED else []


def pairs_of(
    units: Sequence[Unit], features: Sequence[Feature], apart: Sequence[tuple[str, ...]]
) -> list[tuple[int, int]]:
    """Return the pairs of units that may be combined.

    Not a feature with itself, nor members of one family, nor what is to be kept apart; and see
    :func:`units_to_combine`.

    Args:
        units: what there is.
        features: k descriptions.
        apart: pairs of names, of features or families.

    Raises:
        ConfigurationError: a name is neither a feature nor a family.
    """
    families = families_of(features)
    positions = {feature.name: {number} for number, feature in enumerate(features)}
    positions |= {name: set(members) for name, members in families.items()}
    barred = []
    for pair in apart:
        for name in pair:
            if name not in positions:
                raise ConfigurationError(
                    f'apart names {name!r}; allowed are the features and families '
                    f'{", ".join(positions)}'
                )
        barred.append((positions[pair[0]], positions[pair[1]]))

    def may_combine(one: Unit, other: Unit) -> bool:
        left, right = set(one.columns), set(other.columns)
        if left & right or any(
            left <= set(members) and right <= set(members) for members in families.values()
        ):
            return False
        return not any(
            (left & first and right & second) or (left & second and right & first)
            for first, second in barred
        )

    return [
        (i, j)
        for i, j in combinations(units_to_combine(units), 2)
        if may_combine(units[i], units[j])
    ]
