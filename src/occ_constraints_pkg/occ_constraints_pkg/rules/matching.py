# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which rules of two constraints files stand for each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import rule_ids
from occ_constraints_pkg.rules.space import FeatureSpace

End = tuple[str, bool]
"""What a literal limits, by name, and whether from above."""


def matched_rules(first: Constraints, second: Constraints) -> list[tuple[int, int]]:
    """Return positions of the rules in both files that stand for each other.

    Rules are matched first by their formula, then by an id that a person gave, then by the features
    and sides of their literals, the closest bounds first, and at last by their id.
    """
    rules = first.rules, second.rules
    spaces = first.space, second.space
    free = [set(range(len(own))) for own in rules]
    pairs: list[tuple[int, int]] = []

    def match(key: Callable[[Rule, FeatureSpace], Any]) -> None:
        """Pair the rules that have the same key and no partner yet, the closest ones first."""
        groups: dict[Any, tuple[list[int], list[int]]] = {}
        for side in (0, 1):
            for place in sorted(free[side]):
                found = key(rules[side][place], spaces[side])
                if found is not None:
                    groups.setdefault(found, ([], []))[side].append(place)
        for olds, news in groups.values():
            candidates = sorted(
                (_distance(first, second, rules[0][old], rules[1][new]), old, new)
                for old in olds
                for new in news
            )
            for _, old, new in candidates:
                if old in free[0] and new in free[1]:
                    free[0].remove(old)
                    free[1].remove(new)
                    pairs.append((old, new))

    match(lambda rule, space: (rule.id, _formula(rule, space)))
    match(lambda rule, space: _formula(rule, space))
    match(
        lambda rule, space: (
            None if _has_derived_id(rule, space) else (rule.id, frozenset(rule_ends(rule, space)))
        )
    )
    match(lambda rule, space: frozenset(rule_ends(rule, space)))
    match(lambda rule, _: rule.id)
    return pairs


def _formula(rule: Rule, space: FeatureSpace) -> frozenset[str]:
    return frozenset(literal.text(space) for literal in rule.tightest_literals)


def rule_ends(rule: Rule, space: FeatureSpace) -> dict[End, Literal]:
    """Return the literals that matter by what they limit."""
    return {(item.name(space), item.is_upper): item for item in rule.tightest_literals}


def _has_derived_id(rule: Rule, space: FeatureSpace) -> bool:
    """Return whether a rule's id is that of its form, not a name that a person gave."""
    return rule.id.partition('-')[0] == rule_ids(space, [rule.literals])[0]


def _distance(first: Constraints, second: Constraints, old: Rule, new: Rule) -> tuple[float, bool]:
    """Return how far apart the bounds of two rules are; at equal distance, equal ids go first."""
    ends = rule_ends(new, second.space)
    scale = first.rule_set.scale
    away = 0.0
    for end, literal in rule_ends(old, first.space).items():
        if end in ends:
            # Halves, since the difference of two floats may be none.
            half = abs(literal.bound / 2 - ends[end].bound / 2)
            away += min(half / float(scale[literal.members[0]]), 1e300)
    return away, old.id != new.id
