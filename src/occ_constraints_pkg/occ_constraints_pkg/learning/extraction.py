# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From the tree to a formula: rules that are true exactly where no leaf's box is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.rule import Literal, Rule, split_off_single
from occ_constraints_pkg.rules.ruleset import RuleSet, rule_ids
from occ_constraints_pkg.rules.space import FeatureSpace


class _Range(NamedTuple):
    """What a path through the tree implies for one feature.

    Attributes:
        low: left bound of the path's interval.
        high: right bound.
        floor: lower bound that a rule under this path has to state: what lies between ``low`` and
            ``floor`` belongs to no leaf, so the rule may as well be true there.
        ceiling: upper bound that a rule has to state.
    """

    low: float = -np.inf
    high: float = np.inf
    floor: float = -np.inf
    ceiling: float = np.inf


def extract_rules(
    root: Node, space: FeatureSpace, demonstrated: np.ndarray, *, full_conditions: bool = False
) -> RuleSet:
    """Return the complement of the tree's leaves within the demonstrations' bounding box.

    At each split: below the first branch, in each gap between branches, above the last one; and
    within each branch the same again under that branch's condition. (The paper's printed formula
    joins "outside branch 1" with "outside branch 2" by *or*, which for two branches is true
    everywhere.) Two rules per feature add the demonstrated minimum and maximum.

    The condition of a branch has only the bounds that distinguish it from its siblings. Below the
    first branch and above the last one every sample is a violation anyway, so a deeper rule need
    not exclude it: ``x > 2 or (x <= 2 and y > 3)`` is ``x > 2 or y > 3``. A chain of splits with
    one branch each thus gives rules of one literal, which can be disabled independently.

    Rules that can never be true within the physical bounds, or that a rule of one literal
    contains, are left out.

    Args:
        root: the tree.
        space: the features, with their physical bounds.
        demonstrated: (k, 2) smallest and largest demonstrated values.
        full_conditions: state both bounds of every branch, as the paper prints its rules;
            equivalent as long as no rule is disabled.

    Returns:
        The rules in ascending number of literals.
    """
    conjunctions: list[tuple[Literal, ...]] = [
        (Literal(feature, operator, float(bound)),)
        for feature, (low, high) in enumerate(demonstrated)
        for operator, bound in (('<', low), ('>', high))
    ]
    conjunctions += [
        tuple(literal for literal in item if not literal.is_always_true(space))
        for item in _outside(root, {}, full_conditions)
    ]
    # Non-strict literals hold at bounds of a branch, which are values of samples.
    single, longer = split_off_single(
        item
        for item in conjunctions
        if not any(literal.is_strict and literal.is_never_true(space) for literal in item)
    )
    conjunctions = [*((literal,) for literal in single), *sorted(longer, key=len)]
    ids = rule_ids(space, conjunctions)
    rules = tuple(Rule(name, item) for name, item in zip(ids, conjunctions, strict=True))
    return RuleSet(space, rules, np.asarray(demonstrated, dtype=np.float64))


def _outside(node: Node, path: dict[int, _Range], full: bool) -> list[tuple[Literal, ...]]:
    """Return conjunctions that together hold wherever on ``path`` there is no leaf."""
    if node.feature is None:
        return []
    feature, branches = node.feature, node.branches
    own = path.get(feature, _Range())
    given = [
        literal
        for other, item in path.items()
        if other != feature
        for literal in (*_at_least(other, item.floor), *_at_most(other, item.ceiling))
    ]
    first, last = branches[0], branches[-1]
    found = []
    if first.low > own.low:
        found.append((*given, *_at_least(feature, own.floor), Literal(feature, '<', first.low)))
    for left, right in zip(branches[:-1], branches[1:], strict=True):
        # Half-open neighbours may be adjacent floats.
        if np.nextafter(left.high, np.inf) < right.low:
            gap = (Literal(feature, '>', left.high), Literal(feature, '<', right.low))
            found.append((*given, *gap))
    if last.high < own.high:
        found.append((*given, Literal(feature, '>', last.high), *_at_most(feature, own.ceiling)))
    for branch in branches:
        inner = _Range(
            branch.low,
            branch.high,
            own.floor if branch is first and not full else branch.low,
            own.ceiling if branch is last and not full else branch.high,
        )
        found += _outside(branch.node, {**path, feature: inner}, full)
    return found


def _at_least(feature: int, bound: float) -> tuple[Literal, ...]:
    return (Literal(feature, '>=', bound),) if bound > -np.inf else ()


def _at_most(feature: int, bound: float) -> tuple[Literal, ...]:
    return (Literal(feature, '<=', bound),) if bound < np.inf else ()
