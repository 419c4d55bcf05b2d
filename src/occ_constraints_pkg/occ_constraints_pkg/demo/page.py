# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page that the demo leaves behind."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from occ_constraints_pkg.agents.curves import draw_training
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.demo.pictures import draw_trajectories
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.files import PAGE, write_text
from occ_constraints_pkg.learning.rules_picture import draw_rules
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

    rule_set = constraints.rule_set
    template = resources.files(__package__).joinpath('page.html.j2').read_text('utf-8')
    page = output / 'index.html'
    text = (
        Environment(autoescape=True, undefined=StrictUndefined)
        .from_string(template)
        .render(
            world=_WORLD,
            coverage=constraints.coverage,
            watched=watched,
            scores=scores,
            limit=cost_limit,
            rules=[(rule.id, rule.words(rule_set.space)) for rule in rule_set.rules],
        )
    )
    write_text(page, PAGE, text)
    return page
