# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learning as a whole: samples in, a constraints file's content out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

import occ_constraints_pkg
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.octree import fit_tree
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.simplification import extract_and_simplify
from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

# With fewer episodes than this, none is held out: too few would be left to learn from.
_LEAST_EPISODES_TO_HOLD_OUT = 5


def learn(
    values: np.ndarray,
    episodes: np.ndarray,
    space: FeatureSpace,
    settings: OCTreeSettings | None = None,
    *,
    rng: np.random.Generator,
    held_out_share: float = 0.2,
    feature_map: Mapping[str, Any] | None = None,
    bags: Sequence[Mapping[str, Any]] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Constraints:
    """Learn constraints from demonstrations.

    Samples with a value that is not finite or outside its physical bounds are left out; they
    could only be UNKNOWN at run time. A share of whole episodes is held out and only used to
    state the coverage on episodes never seen.

    Args:
        values: (n, k) samples.
        episodes: (n,) the episode each sample belongs to.
        space: the features.
        settings: the tree learner's parameters; ``None`` for the defaults.
        rng: chooses the held-out episodes.
        held_out_share: share of episodes to hold out when there are five or more.
        feature_map: document of the feature map, kept in the file.
        bags: name, sha256 and messages of each recording, kept in the file.
        progress: called with (level, leaves so far) after each level of the tree.

    Raises:
        OccError: there is no usable sample, or the share is not within 0 to 1.
    """
    if not 0.0 <= held_out_share < 1.0:
        raise OccError(f'held_out_share is {held_out_share}; allowed is 0 <= held_out_share < 1')
    settings = settings if settings is not None else OCTreeSettings()
    rows = space.check_rows(values)
    if not len(rows):
        raise OccError('there are no samples to learn from; allowed are one or more')
    usable = (
        np.isfinite(rows).all(axis=1)
        & (rows >= space.lows).all(axis=1)
        & (rows <= space.highs).all(axis=1)
    )
    if not usable.any():
        raise OccError(
            f'none of the {len(rows)} samples is usable: each has a value that is missing, not '
            f'finite or outside the physical bounds{_worst_feature(rows, space)}'
        )
    rows, episodes = rows[usable], np.asarray(episodes)[usable]
    held_out = np.zeros(len(rows), dtype=bool)
    names = np.unique(episodes)
    chosen = names[:0]
    if len(names) >= _LEAST_EPISODES_TO_HOLD_OUT:
        count = min(round(held_out_share * len(names)), len(names) - 1)
        chosen = rng.choice(names, size=count, replace=False)
        held_out = np.isin(episodes, chosen)
    training = rows[~held_out]
    tree = fit_tree(training, settings, families=space.families, progress=progress)
    demonstrated = np.stack([training.min(axis=0), training.max(axis=0)], axis=1)
    if settings.clip == 'mass':
        for family in map(list, space.families):
            demonstrated[family] = demonstrated[family, 0].min(), demonstrated[family, 1].max()
    formula = extract_and_simplify(
        tree, space, demonstrated, full_conditions=settings.full_conditions
    )
    rule_set = formula.rule_set
    coverage = {
        'training_samples': len(training),
        'training': _covered(rule_set, training),
        'held_out_episodes': len(chosen),
        'held_out_samples': int(held_out.sum()),
        'held_out': _covered(rule_set, rows[held_out]) if held_out.any() else None,
    }
    provenance = {
        'created': datetime.now(UTC).isoformat(timespec='seconds'),
        'package_version': occ_constraints_pkg.__version__,
        'learned_formula': rule_set.fingerprint,
        'bags': [dict(bag) for bag in bags],
    }
    return Constraints(
        rule_set,
        feature_map,
        tree_document(tree, space),
        {
            **asdict(settings),
            'unusable_samples': int((~usable).sum()),
            'extracted_rules': formula.before[0],
            'extracted_literals': formula.before[1],
        },
        coverage,
        provenance,
    )


def tree_document(node: Node, space: FeatureSpace) -> dict[str, Any]:
    """Return the tree as nested plain values; a leaf is empty."""
    if node.feature is None:
        return {}
    branches = []
    for branch in node.branches:
        item = {'from': branch.low, 'to': branch.high, 'samples': branch.samples}
        below = tree_document(branch.node, space)
        branches.append({**item, 'below': below} if below else item)
    return {'split': space.names[node.feature], 'branches': branches}


def _covered(rule_set: RuleSet, rows: np.ndarray) -> float:
    return float(np.mean(rule_set.judge(rows).verdict == Verdict.SAFE))


def _worst_feature(rows: np.ndarray, space: FeatureSpace) -> str:
    bad = ~(np.isfinite(rows) & (rows >= space.lows) & (rows <= space.highs))
    worst = int(bad.mean(axis=0).argmax())
    return f'; worst is {space.names[worst]!r}, unusable in {bad[:, worst].mean():.0%} of them'
