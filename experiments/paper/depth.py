# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Trees of several depths in CarPush1 (the paper's fourth figure)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.depths import ablate_depth, depths_document
from occ_constraints_pkg.learning.settings import OCTreeSettings

from experiments.paper.demonstrations import STATES, TREES, load_arrays
from experiments.paper.jobs import Job
from experiments.paper.plan import Scale, rules_job, states_job, training_job
from experiments.paper.tables import Lines, acted, interval, results_of
from experiments.results import markdown_table
from experiments.states import demonstrate

WORLD = 'CarPush1'
COMPARED = {'article': "the article's tree", 'default': 'the default learner'}
_DEEPEST = 20


def compared_job(scale: Scale, tree: str, seed: int) -> Job:
    """Return the run that compares the depths of one kind of tree."""
    arguments = {'tree': tree, 'demonstrations': scale.demonstrations, 'seed': seed}
    return Job('depth', arguments, {'states': states_job(scale, WORLD)})


def _training_job(scale: Scale, tree: str, depth: int, seed: int) -> Job:
    rules = rules_job(scale, WORLD, 'expert', seed, tree=tree, depth=depth)
    return training_job(scale, WORLD, 'ours', seed, rules=rules, steps=scale.short_steps)


def jobs(scale: Scale) -> list[Job]:
    """Return the runs: every depth judged on states, and some of them obeyed in training."""
    seeds = range(scale.small_seeds)
    judged = [compared_job(scale, tree, seed) for seed in seeds for tree in COMPARED]
    return judged + [
        _training_job(scale, tree, depth, seed)
        for seed in seeds
        for tree in COMPARED
        for depth in scale.depths
    ]


def compare_depths(
    folder: Path, needs: Mapping[str, Path], *, tree: str, demonstrations: int, seed: int
) -> dict[str, Any]:
    """Learn with every depth, and judge on the states of a heedless driver.

    Args:
        folder: of the run.
        needs: ``states``.
        tree: key of :data:`COMPARED`.
        demonstrations: episodes of the expert.
        seed: of the demonstrations.

    Returns:
        For each depth coverage, size and scores.
    """
    values, robots = demonstrate(WORLD, 'expert', demonstrations, seed=20_000 + seed)
    states = load_arrays(needs['states'] / STATES)
    results = ablate_depth(
        values.astype(np.float64),
        robots,
        load_feature_map(WORLD).space,
        OCTreeSettings(**TREES[tree], max_depth=_DEEPEST),
        rng=np.random.default_rng(seed),
        truth=(states['values'].astype(np.float64), states['costly'].astype(float)),
    )
    return {'depths': depths_document(results)}


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the table of depths, and that of the trainings."""
    rows = []
    for tree, title in COMPARED.items():
        found = results_of(
            lines, [compared_job(scale, tree, seed) for seed in range(scale.small_seeds)]
        )
        if not found:
            continue
        for depth in range(max(len(item['depths']) for item in found)):
            # A tree that ended earlier is what it is at every larger depth.
            level = [item['depths'][min(depth, len(item['depths']) - 1)] for item in found]
            numbers = [
                interval([item[name] for item in level], 1) for name in ('rules', 'literals')
            ]
            numbers += [
                interval([item[name] for item in level], 3)
                for name in ('training', 'held_out', 'precision', 'recall', 'f1')
            ]
            rows.append((title, depth, *numbers))
    heads = ('tree', 'depth', 'rules', 'literals', 'coverage of the demonstrations')
    heads += ('coverage of held-out ones', 'precision', 'recall', 'F1')
    trained = []
    for tree, title in COMPARED.items():
        for depth in scale.depths:
            results = results_of(
                lines,
                [_training_job(scale, tree, depth, seed) for seed in range(scale.small_seeds)],
            )
            numbers = [acted(results, 'sampled', name) for name in ('return', 'cost')]
            trained.append((title, depth, len(results), *numbers))
    return {
        'depth': markdown_table(heads, rows),
        'depth_trainings': markdown_table(
            ('tree', 'depth', 'seeds', 'return', 'true cost'), trained
        ),
    }
