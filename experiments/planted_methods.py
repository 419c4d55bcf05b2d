# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The learners that planted problems are put to: ours, and what else one might take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from occ_constraints_pkg.learning.conditional import Feature, LearnedRules
from occ_constraints_pkg.learning.conditional.learner import learn_conditional
from occ_constraints_pkg.learning.octree import fit_tree
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.tree import Node

from experiments import baselines
from experiments.planted_problems import Problem

# Trees against permuted columns: rows, depth, least share of the rows in a leaf, and by how much
# demonstrations have to be rarer there than permuted ones.
_CART_ROWS, _CART_DEPTH, _CART_LEAF, _CART_RARER = 100_000, 6, 0.005, 20


@dataclass(frozen=True, eq=False)
class Learned:
    """What a learner found.

    Attributes:
        flags: (n, k) samples to (n,) bool, which of them it flags.
        rules: how many rules that are, as far as it has any.
        conditional: how many of them have several conditions.
        conditional_flags: as ``flags``, for these alone.
    """

    flags: Callable[[np.ndarray], np.ndarray]
    rules: int = 0
    conditional: int = 0
    conditional_flags: Callable[[np.ndarray], np.ndarray] | None = None


def features_of(problem: Problem) -> list[Feature]:
    """Return the descriptions of a problem's features."""
    family = {
        member: f'family{number}'
        for number, members in enumerate(problem.families)
        for member in members
    }
    limits = problem.limits
    if limits is None:
        limits = np.tile([-np.inf, np.inf], (len(problem.names), 1))
    return [
        Feature(name, float(limits[number, 0]), float(limits[number, 1]), family.get(number, ''))
        for number, name in enumerate(problem.names)
    ]


def box_of(problem: Problem) -> np.ndarray:
    """Return the (k, 2) box that the tree learner finds."""
    box = np.stack([problem.values.min(axis=0), problem.values.max(axis=0)], axis=1)
    for family in map(list, problem.families):
        box[family] = box[family, 0].min(), box[family, 1].max()
    node = _tree(problem, OCTreeSettings())
    while node.feature is not None:
        box[node.feature] = node.branches[0].low, node.branches[0].high
        node = node.branches[0].node
    return box


def _tree(problem: Problem, settings: OCTreeSettings) -> Node:
    return fit_tree(problem.values, settings, families=problem.families, limits=problem.limits)


def ours(problem: Problem) -> Learned:
    """Box and conditional rules, with the defaults."""
    learned = learn_conditional(
        problem.values, problem.episodes, features_of(problem), bounds=box_of(problem)
    )
    return _learned(learned)


def _learned(learned: LearnedRules) -> Learned:
    bounds = int(np.isfinite(learned.box).sum())
    count = len(learned.rules)
    return Learned(learned.flagged, bounds + count, count, learned.flagged_by_rules)


def box(problem: Problem) -> Learned:
    """The box alone."""
    low, high = box_of(problem).T
    return Learned(lambda rows: ((rows < low) | (rows > high)).any(axis=1), 2 * len(low))


def split_tree(problem: Problem) -> Learned:
    """The tree that is split where the density has a minimum, alpha 0.5."""
    leaves = _tree(problem, OCTreeSettings(alpha=0.5, max_depth=5)).leaf_boxes(len(problem.names))
    low, high = problem.values.min(axis=0), problem.values.max(axis=0)

    def flags(rows: np.ndarray) -> np.ndarray:
        inside = np.zeros(len(rows), dtype=bool)
        for leaf in leaves:
            inside |= ((rows >= leaf[:, 0]) & (rows <= leaf[:, 1])).all(axis=1)
        return ~inside | ((rows < low) | (rows > high)).any(axis=1)

    return Learned(flags, len(leaves))


def isolation_forest(problem: Problem) -> Learned:
    """scikit-learn's IsolationForest."""
    return Learned(baselines.isolation_forest(problem.values))


def one_class_svm(problem: Problem) -> Learned:
    """scikit-learn's OneClassSVM on standardised features."""
    return Learned(baselines.one_class_svm(problem.values))


def permuted_cart(problem: Problem) -> Learned:
    """A decision tree that tells demonstrations from permuted columns, inside the box.

    Hastie, Tibshirani and Friedman, The Elements of Statistical Learning, section 14.2.4.
    """
    from sklearn.tree import DecisionTreeClassifier

    within = box(problem)
    rng = np.random.default_rng(0)
    rows = problem.values[~within.flags(problem.values)]
    if len(rows) > _CART_ROWS:
        rows = rows[rng.choice(len(rows), _CART_ROWS, replace=False)]
    permuted = np.column_stack([rng.permutation(column) for column in rows.T])
    leaf = max(20, int(_CART_LEAF * len(rows)))
    model = DecisionTreeClassifier(
        max_depth=_CART_DEPTH, min_samples_leaf=leaf, random_state=0
    ).fit(np.concatenate([rows, permuted]), np.repeat([0, 1], len(rows)))
    shares = model.tree_.value[:, 0]
    empty = (model.tree_.children_left < 0) & (shares[:, 0] < shares[:, 1] / _CART_RARER)

    def conditional(rows: np.ndarray) -> np.ndarray:
        return empty[model.apply(rows)]

    return Learned(
        lambda rows: within.flags(rows) | conditional(rows),
        within.rules + int(empty.sum()),
        int(empty.sum()),
        conditional,
    )


METHODS: dict[str, Callable[[Problem], Learned]] = {
    'ours': ours,
    'box': box,
    'alpha 0.5': split_tree,
    'IsolationForest': isolation_forest,
    'OneClassSVM': one_class_svm,
    'CART': permuted_cart,
}
"""Every method by its name."""
