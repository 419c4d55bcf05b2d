# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Runs without training: states to judge on, and rules learned from demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.files import ARCHIVE, replacing
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.worlds.registry import make_world

import occ_constraints_pkg as occ
from experiments.inverse_learning import Episodes
from experiments.states import demonstrate, driver_of, first_episodes, heedless_driver_name

RULES, DEMONSTRATIONS, STATES = 'rules.yaml', 'demonstrations.npz', 'states.npz'
TREES: dict[str, dict[str, Any]] = {
    'default': {},
    # That of the article, with the paper's limit of depth in place of the article's stop.
    'article': {'clip': 'density', 'alpha': 0.5, 'beta': 0.02, 'min_split': 0.0},
    'box': {'conditions': 'none'},
}
"""Settings of the learner by name."""

TRAINED = 'trained'
"""Driver of demonstrations: the policy of the run that is needed as ``expert``."""


def drive_heedlessly(
    folder: Path, needs: Mapping[str, Path], *, world: str, episodes: int
) -> dict[str, Any]:
    """Write the states of a driver that ignores what must not be, with their true cost.

    Args:
        folder: of the run.
        needs: nothing.
        world: its name.
        episodes: number of episodes.

    Returns:
        The name of the driver, and the share of the states that are truly costly.
    """
    simulated = make_world(world, episodes, processes=1)
    name = heedless_driver_name(world)
    driver = driver_of(simulated, name, np.random.default_rng(1))
    values, robots, costly = first_episodes(simulated, driver, load_feature_map(world), 10_000)
    simulated.close()
    save_arrays(folder / STATES, values=values, episodes=robots, costly=costly)
    return {'driver': name, 'states': len(values), 'costly': float(costly.mean())}


def learn_rules(
    folder: Path,
    needs: Mapping[str, Path],
    *,
    source: str,
    driver: str,
    demonstrations: int,
    seed: int,
    tree: str = 'default',
    depth: int | None = None,
    **_: Any,
) -> dict[str, Any]:
    """Let an expert demonstrate, learn, and judge the rules on other states.

    Args:
        folder: of the run; gets the demonstrations and the rules.
        needs: ``expert``, the training of the expert, if it is one; states of every world in which
            the rules are judged, by its name.
        source: world of the expert.
        driver: ``trained``, or the name of a driver.
        demonstrations: episodes.
        seed: of the demonstrations.
        tree: key of :data:`TREES`.
        depth: of the tree; None: not limited.
        **_: what else distinguishes the run.

    Returns:
        The rules in words, their coverage, and scores on the states of each world.
    """
    policy = str(needs['expert'] / 'training' / 'policy.npz') if driver == TRAINED else driver
    values, robots = demonstrate(source, policy, demonstrations, seed=20_000 + seed)
    feature_map = load_feature_map(source)
    table = folder / DEMONSTRATIONS
    save_arrays(table, features=values, names=np.array(feature_map.names), episode=robots)
    settings = TREES[tree] if depth is None else {**TREES[tree], 'max_depth': depth}
    constraints = occ.learn(table, feature_map, seed=seed, **settings)
    constraints.save(folder / RULES)
    rule_set = constraints.rule_set
    return {
        'rules': [rule.words(rule_set.space) for rule in rule_set.rules],
        'coverage': constraints.coverage,
        'scores': {
            world: rule_scores(rule_set, path) for world, path in needs.items() if world != 'expert'
        },
    }


def rule_scores(rule_set: RuleSet, states: Path) -> dict[str, float | None]:
    """Return precision, recall and F1 of rules on the states that a run has written.

    Args:
        rule_set: the rules.
        states: the run's folder.
    """
    found = load_arrays(states / STATES)
    flags = rule_set.verdicts(found['values'].astype(np.float64)) != Verdict.SAFE
    return ratios(flags, found['costly'])


def ratios(flags: np.ndarray, costly: np.ndarray) -> dict[str, float | None]:
    """Return precision, recall and F1 of (n,) flags; None where one is undefined."""
    return {
        name: None if np.isnan(value) else round(value, 4)
        for name, value in score_flags(flags, costly).ratios().items()
        if name != 'iou'
    }


def demonstrated(rules: Path) -> Episodes:
    """Return the demonstrations of a run of :func:`learn_rules`.

    Args:
        rules: the run's folder.
    """
    found = load_arrays(rules / DEMONSTRATIONS)
    return Episodes(found['features'].astype(np.float64), found['episode'])


def save_arrays(path: Path, **arrays: np.ndarray) -> None:
    """Write arrays to a file, atomically."""
    with replacing(path, ARCHIVE) as draft, draft.open('wb') as file:
        np.savez_compressed(file, **arrays)


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read what :func:`save_arrays` wrote."""
    with np.load(path, allow_pickle=False) as file:
        return dict(file)
