# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set of conditional rules as it is stored: the box, and a forest of small trees.

Rules are put in groups that share no feature, and each group has a tree. A sample is safe where it
lies in the box and in a leaf of every tree. A single tree would multiply the leaves of the groups.
A leaf bounds features, or the least or largest value of a family, so that the safe set is a union
of boxes; it is exactly where no rule is true.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, LearnedRules, Literal
from occ_constraints_pkg.rules.space import FeatureSpace


@dataclass(frozen=True, order=True)
class Quantity:
    """What a tree splits: a feature, or the least or largest value of a family.

    Attributes:
        columns: position of the feature, or those of the family's members.
        family: its name, empty for a feature.
        largest: of a family, whether its largest value counts, or its least.
    """

    columns: tuple[int, ...]
    family: str = ''
    largest: bool = True

    @classmethod
    def of(cls, literal: Literal) -> Quantity:
        """Return what decides whether a literal is true."""
        if not literal.family:
            return cls(literal.columns)
        return cls(literal.columns, literal.family, not literal.is_upper)

    def values(self, rows: np.ndarray) -> np.ndarray:
        """Return its (n,) values in (n, k) samples."""
        columns = rows[:, list(self.columns)]
        return columns.max(axis=1) if self.largest else columns.min(axis=1)

    def document(self, space: FeatureSpace) -> dict[str, str]:
        """Return its plain form: ``split: speed``, ``max: hazards`` or ``min: hazards``."""
        if not self.family:
            return {'split': space.names[self.columns[0]]}
        return {'max' if self.largest else 'min': self.family}

    @classmethod
    def parse(cls, document: Mapping[str, Any], space: FeatureSpace) -> Quantity:
        """Return what :meth:`document` gave."""
        if 'split' in document:
            return cls((space.names.index(document['split']),))
        largest = 'max' in document
        family = document['max' if largest else 'min']
        members = [place for place, item in enumerate(space.features) if item.family == family]
        return cls(tuple(members), family, largest)


@dataclass(frozen=True)
class Branch:
    """An interval of what is split, and what is below.

    Attributes:
        low: smallest value, included.
        high: largest value, included.
        below: the next split; ``None`` at a leaf.
    """

    low: float
    high: float
    below: Split | None


@dataclass(frozen=True)
class Split:
    """A node of a tree; values outside all branches are violations.

    Attributes:
        quantity: what is split.
        branches: disjoint intervals in ascending order.
    """

    quantity: Quantity
    branches: tuple[Branch, ...]

    def contains(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) finite samples whether it lies in a leaf: (n,) bool."""
        values = self.quantity.values(rows)
        inside = np.zeros(len(rows), dtype=bool)
        for branch in self.branches:
            own = (values >= branch.low) & (values <= branch.high)
            if branch.below is not None:
                own[own] = branch.below.contains(rows[own])
            inside |= own
        return inside

    def document(self, space: FeatureSpace) -> dict[str, Any]:
        """Return the tree as plain values; an infinite end is left out, as is a leaf."""
        branches = []
        for branch in self.branches:
            item: dict[str, Any] = {}
            if branch.low > -math.inf:
                item['from'] = branch.low
            if branch.high < math.inf:
                item['to'] = branch.high
            if branch.below is not None:
                item['below'] = branch.below.document(space)
            branches.append(item)
        return {**self.quantity.document(space), 'branches': branches}

    @classmethod
    def parse(cls, document: Mapping[str, Any], space: FeatureSpace) -> Split:
        """Return the tree that :meth:`document` gave."""
        branches = tuple(
            Branch(
                float(item.get('from', -math.inf)),
                float(item.get('to', math.inf)),
                cls.parse(item['below'], space) if 'below' in item else None,
            )
            for item in document['branches']
        )
        return cls(Quantity.parse(document, space), branches)


@dataclass(frozen=True, eq=False)
class SafeForest:
    """A box and trees; safe is what lies in all of them.

    Attributes:
        box: (k, 2) smallest and largest safe value of each feature, infinite where there is none.
        trees: one for each group of conditional rules.
    """

    box: np.ndarray
    trees: tuple[Split, ...]

    @classmethod
    def of(cls, learned: LearnedRules) -> SafeForest:
        """Return what rules leave of a box."""
        return cls(learned.box, tuple(map(safe_tree, group_rules(learned.rules))))

    def contains(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) finite samples whether it is safe: (n,) bool."""
        inside = ((rows >= self.box[:, 0]) & (rows <= self.box[:, 1])).all(axis=1)
        for tree in self.trees:
            inside &= tree.contains(rows)
        return np.asarray(inside)

    def document(self, space: FeatureSpace) -> dict[str, Any]:
        """Return the safe set as plain values; a feature without bounds is left out of the box."""
        box = {
            name: [value if math.isfinite(value) else None for value in bounds]
            for name, bounds in zip(space.names, self.box.tolist(), strict=True)
            if any(map(math.isfinite, bounds))
        }
        return {'box': box, 'trees': [tree.document(space) for tree in self.trees]}

    @classmethod
    def parse(cls, document: Mapping[str, Any], space: FeatureSpace) -> SafeForest:
        """Return the safe set that :meth:`document` gave."""
        box = np.full((len(space), 2), [-np.inf, np.inf])
        for name, bounds in document['box'].items():
            for end, value in enumerate(bounds):
                if value is not None:
                    box[space.names.index(name), end] = value
        return cls(box, tuple(Split.parse(item, space) for item in document['trees']))


def group_rules(rules: Sequence[ConditionalRule]) -> list[list[ConditionalRule]]:
    """Return the rules in groups that share no feature, in the order of their first rules."""
    groups: list[tuple[set[int], list[ConditionalRule]]] = []
    for rule in rules:
        columns = {column for literal in rule.literals for column in literal.columns}
        joined = [group for group in groups if group[0] & columns]
        first = joined[0] if joined else (set(), [])
        for group in joined[1:]:
            first[0].update(group[0])
            first[1].extend(group[1])
            groups.remove(group)
        first[0].update(columns)
        first[1].append(rule)
        if not joined:
            groups.append(first)
    return [members for _, members in groups]


def safe_tree(rules: Sequence[ConditionalRule]) -> Split:
    """Return the tree whose leaves are exactly where none of some rules is true."""
    tree = _grow(frozenset(frozenset(map(_Half.of, rule.literals)) for rule in rules))
    assert isinstance(tree, Split), 'a rule has literals'
    return tree


@dataclass(frozen=True)
class _Half:
    """A literal: a quantity is below a number, or not.

    Attributes:
        quantity: what is compared.
        is_upper: whether small values make it true.
        start: the least value of the upper one of the two parts that it divides the line into.
    """

    quantity: Quantity
    is_upper: bool
    start: float

    @classmethod
    def of(cls, literal: Literal) -> _Half:
        beyond = literal.operator in ('<=', '>')
        start = math.nextafter(literal.bound, math.inf) if beyond else literal.bound
        return cls(Quantity.of(literal), literal.is_upper, start)

    def is_true(self, value: float) -> bool:
        return (value < self.start) == self.is_upper


_Conjunctions = frozenset[frozenset[_Half]]
_VIOLATED = 'violated'


def _grow(rules: _Conjunctions) -> Split | None | str:
    """Return the tree of what is left of the rules; ``None`` where nothing is."""
    if not rules:
        return None
    if frozenset() in rules:
        return _VIOLATED
    quantity = _next(rules)
    own = {half.start for rule in rules for half in rule if half.quantity == quantity}
    parts: list[tuple[float, _Conjunctions]] = []
    for start in (-math.inf, *sorted(own)):
        left = _given(rules, quantity, start)
        if not parts or parts[-1][1] != left:
            parts.append((start, left))
    ends = [math.nextafter(start, -math.inf) for start, _ in parts[1:]] + [math.inf]
    branches = []
    for (low, left), high in zip(parts, ends, strict=True):
        below = _grow(left)
        if not isinstance(below, str):
            branches.append(Branch(low, high, below))
    return Split(quantity, tuple(branches)) if branches else _VIOLATED


def _next(rules: _Conjunctions) -> Quantity:
    """Return what to split: what most rules speak of, of these what has the fewest cuts."""

    def order(quantity: Quantity) -> tuple[int, int, Quantity]:
        starts = {half.start for rule in rules for half in rule if half.quantity == quantity}
        concerned = sum(any(half.quantity == quantity for half in rule) for rule in rules)
        return -concerned, len(starts), quantity

    return min({half.quantity for rule in rules for half in rule}, key=order)


def _given(rules: _Conjunctions, quantity: Quantity, value: float) -> _Conjunctions:
    """Return what is left of the rules where a quantity has a value."""
    left = {
        frozenset(half for half in rule if half.quantity != quantity)
        for rule in rules
        if all(half.is_true(value) for half in rule if half.quantity == quantity)
    }
    # A rule that another one of fewer literals contains adds nothing.
    return frozenset(rule for rule in left if not any(other < rule for other in left))
