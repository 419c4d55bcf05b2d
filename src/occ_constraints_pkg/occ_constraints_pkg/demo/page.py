# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page that the demo leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.agents.curves import draw_training
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.demo.pictures import draw_trajectories
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.learning.rules_picture import draw_rules
from occ_constraints_pkg.report.page import (
    Page,
    facts_section,
    picture_section,
    table_section,
    write_page,
)
from occ_constraints_pkg.report.rules import add_provenance, add_rules
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.registry import world_class

_WORLD = 'PointGoal1'
_DRAWN_STEPS = 800
# Surroundings in which the expert reaches its goals; in some it gets stuck.
_DRAWN_SEED = 3


def write_demo_page(
    output: Path,
    constraints: Constraints,
    watched: dict[str, Any],
    scores: dict[str, dict[str, float]],
    cost_limit: float,
) -> Path:
    """Write ``index.html`` and its pictures into the demo's directory.

    Args:
        output: the demo's directory, with ``demonstrations`` and ``training`` in it.
        constraints: the learned rules.
        watched: how the monitor's verdicts compare with the truth.
        scores: return and costs of each driver compared.
        cost_limit: of the training.

    Returns:
        The page's path.
    """
    kind = world_class(_WORLD)
    names = {
        'expert (demonstrates)': 'expert',
        'unconstrained driver': 'straightv',
        'trained with the learned rules': str(output / 'training' / 'policy.npz'),
    }
    drivers = [
        (title, find_driver(kind, name, np.random.default_rng(0)), RuleCost(constraints, kind))
        for title, name in names.items()
    ]
    draw_trajectories(output / 'drives.png', drivers, steps=_DRAWN_STEPS, seed=_DRAWN_SEED)
    feature_map = FeatureMap.from_document(constraints.feature_map, 'the constraints')
    data = extract([output / 'demonstrations'], feature_map)
    draw_rules(output / 'rules.png', constraints, data.values)
    history = read_metrics(output / 'training' / 'metrics.jsonl')
    draw_training(output / 'training.png', [history], cost_limit, cost_name='learned cost')

    page = demo_page(output, constraints, watched, scores, cost_limit, data.values)
    path = output / 'index.html'
    write_page(page, path)
    return path


def demo_page(
    output: Path,
    constraints: Constraints,
    watched: dict[str, Any],
    scores: dict[str, dict[str, float]],
    cost_limit: float,
    samples: np.ndarray,
) -> Page:
    """Return the page, with the pictures that are in the demo's directory.

    Args:
        output: the demo's directory, with ``drives.png`` and ``training.png`` in it.
        constraints: the learned rules.
        watched: how the monitor's verdicts compare with the truth.
        scores: return and costs of each driver compared.
        cost_limit: of the training.
        samples: (n, k) demonstrations, for their density in the picture of the rules.
    """
    page = Page(
        f'Rules learned from demonstrations on {_WORLD}',
        summary=f'Against the true cost, the monitor had a precision of '
        f'{watched["precision"]:.2f} and a recall of {watched["recall"]:.2f}',
    )
    page.add(
        picture_section(
            'Trajectories',
            (output / 'drives.png').read_bytes(),
            'Paths of the expert, the unconstrained driver and the trained policy, from above',
            id='trajectories',
        )
    )
    page.add(
        table_section(
            'The monitor against the truth',
            ['states judged', 'truly costly', 'flagged', 'precision', 'recall'],
            [
                [
                    watched['samples'],
                    watched['costly'],
                    watched['flagged'],
                    f'{watched["precision"]:.3f}',
                    f'{watched["recall"]:.3f}',
                ]
            ],
            id='monitor',
            intro="An expert's episodes were recorded to an MCAP bag, and rules were learned from "
            'that bag. Then a monitor node checked them on live topics while an unconstrained '
            'driver drove.',
            numbers=range(5),
        )
    )
    if watched['example']:
        page.add(facts_section('A violation on the topic', watched['example'], id='violation'))
    page.add(
        picture_section(
            'Training with the rules as cost',
            (output / 'training.png').read_bytes(),
            'Return, cost and multiplier during training',
            id='training',
        )
    )
    page.add(
        table_section(
            'The drivers compared',
            ['per episode', 'return', 'learned cost', 'true cost'],
            [
                [name, *(f'{score[key]:.1f}' for key in ('return', 'learned_cost', 'true_cost'))]
                for name, score in scores.items()
            ],
            id='drivers',
            intro=f'The learned cost is held to {cost_limit:.0f} per episode, the limit in '
            'published results on this task.',
            numbers=range(1, 4),
        )
    )
    add_rules(page, constraints, samples=samples)
    add_provenance(page, constraints)
    return page
