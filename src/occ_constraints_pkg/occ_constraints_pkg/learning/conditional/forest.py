# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set of conditional rules as a forest: a small tree for each group of rules.

Rules of different groups share no feature, so a sample is safe where every tree says so. One tree
for all rules would multiply the groups' leaves. A tree's leaves are disjoint boxes, and their union
is exactly where no rule of the group is true.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, Literal


@dataclass(frozen=True)
class Branch:
    """An interval of the feature that is split, and what is below.

    Attributes:
        low: smallest value, included.
        high: largest value, included.
        below: the next split; ``None`` where every value is safe.
    """

    low: float
    high: float
    below: Split | None


@dataclass(frozen=True)
class Split:
    """A node: values of the feature outside all branches are violations.

    Attributes:
        feature: its position.
        branches: disjoint intervals in ascending order.
    """

    feature: int
    branches: tuple[Branch, ...]

    def contains(self, values: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether it lies in a leaf: (n,) bool."""
        column = values[:, self.feature]
        inside = np.zeros(len(values), dtype=bool)
        for branch in self.branches:
            rows = (column >= branch.low) & (column <= branch.high)
            if branch.below is not None:
                rows[rows] = branch.below.contains(values[rows])
            inside |= rows
        return inside

    def boxes(self) -> Iterator[dict[int, tuple[float, float]]]:
        """Return the leaves: by feature its smallest and largest value, both included."""
        for branch in self.branches:
            own = {self.feature: (branch.low, branch.high)}
            if branch.below is None:
                yield own
            else:
                yield from (own | deeper for deeper in branch.below.boxes())


def safe_forest(rules: Sequence[ConditionalRule]) -> tuple[Split, ...]:
    """Return a tree for each group of rules that share features, directly or through others."""
    return tuple(safe_tree(group) for group in group_rules(rules))


def group_rules(rules: Sequence[ConditionalRule]) -> list[list[ConditionalRule]]:
    """Return the rules in groups that share no feature, in the order of their first rules."""
    groups: list[tuple[frozenset[int], list[ConditionalRule]]] = []
    for rule in rules:
        columns, members, others = rule.columns, [rule], []
        for group in groups:
            if group[0] & columns:
                columns, members = columns | group[0], group[1] + members
            else:
                others.append(group)
        groups = [*others, (columns, members)]
    groups.sort(key=lambda group: rules.index(group[1][0]))
    return [members for _, members in groups]


def safe_tree(rules: Sequence[ConditionalRule]) -> Split:
    """Return the tree whose leaves are exactly where none of some rules is true."""
    halves = frozenset(frozenset(map(_Half.of, rule.literals)) for rule in rules)
    tree = _grow(halves)
    return tree if isinstance(tree, Split) else Split(_next_feature(halves), ())


@dataclass(frozen=True)
class _Half:
    """A literal: any of some columns is at most, or at least, a number."""

    columns: frozenset[int]
    is_upper: bool
    reach: float

    @classmethod
    def of(cls, literal: Literal) -> _Half:
        return cls(frozenset(literal.columns), literal.is_upper, literal.reach)

    @property
    def start(self) -> float:
        """The first value of the upper of the two parts that it divides the line into."""
        return math.nextafter(self.reach, math.inf) if self.is_upper else self.reach

    def is_true(self, value: float) -> bool:
        return value <= self.reach if self.is_upper else value >= self.reach

    def implies(self, other: _Half) -> bool:
        """Tell whether the other is true wherever this one is."""
        if self.is_upper != other.is_upper or not self.columns <= other.columns:
            return False
        return self.reach <= other.reach if self.is_upper else self.reach >= other.reach


_Conjunctions = frozenset[frozenset[_Half]]
_VIOLATED = 'violated'


def _grow(rules: _Conjunctions) -> Split | None | str:
    """Return the tree of what is left of the rules; ``None`` where nothing is."""
    if not rules:
        return None
    if frozenset() in rules:
        return _VIOLATED
    feature = _next_feature(rules)
    starts = sorted(
        {half.start for rule in rules for half in rule if feature in half.columns} - {-math.inf}
    )
    parts: list[tuple[float, _Conjunctions]] = []
    for start in (-math.inf, *starts):
        left = _given(rules, feature, start)
        if not parts or parts[-1][1] != left:
            parts.append((start, left))
    ends = [math.nextafter(start, -math.inf) for start, _ in parts[1:]] + [math.inf]
    branches = []
    for (low, left), high in zip(parts, ends, strict=True):
        below = _grow(left)
        if below != _VIOLATED:
            branches.append(Branch(low, high, below))
    return Split(feature, tuple(branches)) if branches else _VIOLATED


def _next_feature(rules: _Conjunctions) -> int:
    """Return what to split: families last, then what most rules speak of, with the fewest cuts."""
    halves = [half for rule in rules for half in rule]
    single = [half for half in halves if len(half.columns) == 1] or halves
    columns = {column for half in single for column in half.columns}

    def order(column: int) -> tuple[int, int, int]:
        concerned = sum(any(column in half.columns for half in rule) for rule in rules)
        cuts = len({half.start for half in halves if column in half.columns})
        return -concerned, cuts, column

    return min(columns, key=order)


def _given(rules: _Conjunctions, feature: int, value: float) -> _Conjunctions:
    """Return what is left of the rules where a feature has a value."""
    left: set[frozenset[_Half]] = set()
    for rule in rules:
        kept: set[_Half] = set()
        for half in rule:
            if feature not in half.columns:
                kept.add(half)
            elif not half.is_true(value):
                others = half.columns - {feature}
                if not others:
                    break
                kept.add(_Half(others, half.is_upper, half.reach))
        else:
            left.add(frozenset(kept))
    return frozenset(_without_contained(left))


def _without_contained(rules: set[frozenset[_Half]]) -> set[frozenset[_Half]]:
    """Return rules of the same union, without those that lie within another one."""
    kept = set(rules)
    for rule in sorted(rules, key=len, reverse=True):
        # Of two that contain each other, the second has nobody left to go for.
        if any(_contains(other, rule) for other in kept if other != rule):
            kept.remove(rule)
    return kept


def _contains(rule: frozenset[_Half], other: frozenset[_Half]) -> bool:
    """Tell whether a rule is true wherever another one is."""
    return all(any(half.implies(wanted) for half in other) for wanted in rule)
