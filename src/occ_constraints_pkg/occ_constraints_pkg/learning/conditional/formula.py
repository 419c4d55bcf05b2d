# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set as ordinary rules: those of the box, and the conditional ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from occ_constraints_pkg.learning.conditional.learner import learn_conditional
from occ_constraints_pkg.learning.conditional.rules import (
    ConditionalRule,
    Feature,
    LearnedRules,
)
from occ_constraints_pkg.learning.conditional.rules import Literal as LearnedLiteral
from occ_constraints_pkg.learning.conditional.settings import ConditionalSettings
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.simplification import Simplification, simplify, size
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet, rule_ids
from occ_constraints_pkg.rules.space import FeatureSpace

_LARGEST = np.finfo(np.float64).max


@dataclass(frozen=True, eq=False)
class ConditionalFormula:
    """A box less some corners, as rules.

    Attributes:
        tree: the tree of the box, with its bounds where they were moved to.
        formula: the rules, simplified.
        origins: by the id of a rule the conditional rule that it stands for.
    """

    tree: Node
    formula: Simplification
    origins: Mapping[str, ConditionalRule]


def learn_rules(
    tree: Node,
    values: np.ndarray,
    episodes: np.ndarray,
    space: FeatureSpace,
    demonstrated: np.ndarray,
    settings: ConditionalSettings,
    independent: np.ndarray | None,
    *,
    cuts_stay: bool,
) -> LearnedRules:
    """Learn conditional rules within the box of a tree.

    Args:
        tree: without a split into several branches.
        values: (n, k) samples that it was learned from, those of an episode in the order of time.
        episodes: (n,) the episode of each.
        space: the features.
        demonstrated: (k, 2) smallest and largest values; families share them.
        settings: of the learner of conditional rules.
        independent: (n,) what evidence is counted by; ``None`` for episodes.
        cuts_stay: whether bounds within what was demonstrated stay where they are.

    Raises:
        ConfigurationError: ``apart`` has an unknown name.
    """
    (leaf,) = tree.leaf_boxes(len(space))
    return learn_conditional(
        values,
        episodes,
        [Feature(item.name, item.low, item.high, item.family) for item in space.features],
        settings,
        bounds=_within(leaf, demonstrated),
        recordings=independent,
        cuts_stay=cuts_stay,
    )


def write_formula(
    learned: LearnedRules,
    tree: Node,
    values: np.ndarray,
    space: FeatureSpace,
    demonstrated: np.ndarray,
) -> ConditionalFormula:
    """Write a box and conditional rules as rules.

    Args:
        learned: the safe set.
        tree: the one that it was learned within.
        values: (n, k) samples that it was learned from.
        space: the features.
        demonstrated: (k, 2) smallest and largest values, the scale of margins.
    """
    formula, origins = as_rules(learned, space, demonstrated)
    return ConditionalFormula(_moved(tree, learned.box, values), formula, origins)


def as_rules(
    learned: LearnedRules, space: FeatureSpace, demonstrated: np.ndarray
) -> tuple[Simplification, dict[str, ConditionalRule]]:
    """Return rules of which one is true exactly where a sample is outside the learned safe set.

    Args:
        learned: the safe set.
        space: the features.
        demonstrated: (k, 2) smallest and largest values, the scale of margins.

    Returns:
        The rules, and by its id what a rule stands for if it is not of the box.
    """
    box = np.clip(learned.box, -_LARGEST, _LARGEST)
    conjunctions = [rule.literals for rule in extract_rules(Node(), space, box).rules]
    origins: list[ConditionalRule | None] = [None] * len(conjunctions)
    for rule in learned.rules:
        conjunctions.append(tuple(map(_literal, rule.literals)))
        origins.append(rule)
    ids = rule_ids(space, conjunctions)
    rules = tuple(Rule(name, item) for name, item in zip(ids, conjunctions, strict=True))
    whole = RuleSet(space, rules, demonstrated)
    formula = replace(simplify(whole, renumber=True), before=size(whole))
    conditional = {name: rule for name, rule in zip(ids, origins, strict=True) if rule is not None}
    return formula, _origins(formula, whole, conditional)


def _within(box: np.ndarray, demonstrated: np.ndarray) -> np.ndarray:
    """Return the (k, 2) common part of two boxes."""
    low = np.maximum(box[:, 0], demonstrated[:, 0])
    return np.stack([low, np.minimum(box[:, 1], demonstrated[:, 1])], axis=1)


def _moved(tree: Node, box: np.ndarray, values: np.ndarray) -> Node:
    """Return a chain of splits with its bounds replaced by those of a box."""
    inside, splits = np.ones(len(values), dtype=bool), []
    while tree.feature is not None:
        low, high = box[tree.feature].tolist()
        column = values[:, tree.feature]
        inside &= (column >= low) & (column <= high)
        splits.append((tree.feature, Branch(low, high, int(inside.sum()), Node())))
        tree = tree.branches[0].node
    for feature, branch in reversed(splits):
        tree = Node(feature, (replace(branch, node=tree),))
    return tree


def _literal(learned: LearnedLiteral) -> Literal:
    """Return a literal as rules have it."""
    subject = learned.columns if learned.family else learned.columns[0]
    return Literal(subject, learned.operator, learned.bound)


def _origins(
    formula: Simplification, whole: RuleSet, conditional: Mapping[str, ConditionalRule]
) -> dict[str, ConditionalRule]:
    """Return the origins of simplified rules; where several were merged, the best proven one."""
    former = {rule.literals: rule.id for rule in whole.rules}
    found = {}
    for rule in formula.rule_set.rules:
        sources = formula.changed.get(rule.id) or (former[rule.literals],)
        own = [conditional[name] for name in sources if name in conditional]
        if own:
            found[rule.id] = max(own, key=lambda item: item.evidence)
    return found
