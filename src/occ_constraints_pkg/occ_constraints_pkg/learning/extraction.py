# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From the tree to a formula: rules that are true exactly where no leaf's box is."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet, rule_ids
from occ_constraints_pkg.rules.space import FeatureSpace

# What a path has settled about one feature: lower and upper bound, each inclusive or absent.
_Range = tuple[float | None, float | None]


def extract_rules(root: Node, space: FeatureSpace, demonstrated: np.ndarray) -> RuleSet:
    """Return the complement of the tree's leaves within the demonstrations' bounding box.

    At each split: below the first branch, in each gap between branches, above the last one; and
    within each branch the same again under that branch's condition. (The paper's printed formula
    joins "outside branch 1" with "outside branch 2" by *or*, which for two branches is true
    everywhere.) Two rules per feature add the demonstrated minimum and maximum.

    Literals that the path or the physical bounds already imply are left out, and so are rules
    that can never be true or that a rule of one literal contains.

    Args:
        root: the tree.
        space: the features, with their physical bounds.
        demonstrated: (k, 2) smallest and largest demonstrated values.
    """
    conjunctions = [
        (Literal(feature, operator, float(bound)),)
        for feature, (low, high) in enumerate(demonstrated)
        for operator, bound in (('<', low), ('>', high))
    ]
    conjunctions += _outside(root, {}, space)
    conjunctions = [item for item in conjunctions if _is_satisfiable(item, space)]
    conjunctions = _without_contained(conjunctions)
    conjunctions.sort(key=len)
    ids = rule_ids(space, conjunctions)
    rules = tuple(Rule(name, item) for name, item in zip(ids, conjunctions, strict=True))
    return RuleSet(space, rules, np.asarray(demonstrated, dtype=np.float64))


def _outside(
    node: Node, path: dict[int, _Range], space: FeatureSpace
) -> list[tuple[Literal, ...]]:
    """Return the conjunctions that hold on ``path`` but in no leaf below ``node``."""
    if node.feature is None:
        return []
    feature, branches = node.feature, node.branches
    low, high = path.get(feature, (None, None))
    elsewhere = {key: value for key, value in path.items() if key != feature}
    given = _literals(elsewhere, space)
    found = []
    if low is None or branches[0].low > low:
        own = _literals({feature: (low, None)}, space)
        found.append((*given, *own, Literal(feature, '<', branches[0].low)))
    for left, right in zip(branches[:-1], branches[1:], strict=True):
        gap = (Literal(feature, '>', left.high), Literal(feature, '<', right.low))
        found.append((*given, *gap))
    if high is None or branches[-1].high < high:
        own = _literals({feature: (None, high)}, space)
        found.append((*given, Literal(feature, '>', branches[-1].high), *own))
    for branch in branches:
        found += _outside(branch.node, {**path, feature: (branch.low, branch.high)}, space)
    return found


def _literals(path: dict[int, _Range], space: FeatureSpace) -> tuple[Literal, ...]:
    """Write a path's ranges as literals, without those that the physical bounds imply."""
    literals = []
    for feature, (low, high) in path.items():
        if low is not None and low > space.lows[feature]:
            literals.append(Literal(feature, '>=', low))
        if high is not None and high < space.highs[feature]:
            literals.append(Literal(feature, '<=', high))
    return tuple(literals)


def _is_satisfiable(literals: tuple[Literal, ...], space: FeatureSpace) -> bool:
    """Tell whether any value within the physical bounds makes all strict literals true."""
    return all(
        literal.bound > space.lows[literal.feature]
        if literal.operator == '<'
        else literal.bound < space.highs[literal.feature]
        for literal in literals
        if literal.operator in ('<', '>')
    )


def _without_contained(conjunctions: list[tuple[Literal, ...]]) -> list[tuple[Literal, ...]]:
    """Drop conjunctions that imply a rule of one strict literal that is kept."""
    widest: dict[tuple[int, str], float] = {}
    for literals in conjunctions:
        if len(literals) == 1:
            key = literals[0].feature, literals[0].operator
            pick = max if literals[0].is_upper else min
            widest[key] = pick(widest.get(key, literals[0].bound), literals[0].bound)
    kept, alone = [], set()
    for literals in conjunctions:
        if len(literals) == 1:
            key = literals[0].feature, literals[0].operator
            if literals[0].bound == widest[key] and key not in alone:
                alone.add(key)
                kept.append(literals)
        elif not any(_implies(literal, widest) for literal in literals):
            kept.append(literals)
    return kept


def _implies(literal: Literal, widest: dict[tuple[int, str], float]) -> bool:
    strict = literal.operator[0]
    bound = widest.get((literal.feature, strict))
    if bound is None:
        return False
    beyond = literal.bound < bound if strict == '<' else literal.bound > bound
    return beyond or (literal.bound == bound and literal.operator == strict)
