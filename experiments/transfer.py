# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From an expert to policies that obey the rules learned from it (paper, "Constraint transfer")."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.agents.evaluation import evaluate, half_width
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.seeds import seeds_summary, train_seeds
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.files import make_directory
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks.conditions import machine, versions
from experiments.results import markdown_table, write_results
from experiments.states import demonstrate

_EVALUATION_SEED = 10_000


@dataclass(frozen=True)
class TransferSettings:
    """What is learned from whom, and who obeys it.

    Attributes:
        source: world in which the expert demonstrates.
        target: world in which policies are trained with the rules.
        expert: a policy file of the source world, or the name of a driver.
        demonstrations: episodes of the expert.
        cost_limit: of the training, a number or ``demonstrations``.
        steps: robot steps of each training.
        robots: robots simulated at once.
        first_seed: of the trainings.
        seeds: number of trainings.
        episodes: fresh episodes over which each driver is judged.
    """

    source: str = 'PointGoal1'
    target: str = 'PointGoal1'
    expert: str = 'expert'
    demonstrations: int = 50
    cost_limit: float | str = 'demonstrations'
    steps: int = 4_000_000
    robots: int = 64
    first_seed: int = 0
    seeds: int = 3
    episodes: int = 200


def run_transfer(
    output: Path,
    settings: TransferSettings,
    *,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Demonstrate, learn rules, train with them, and compare the policies with the expert.

    A stopped run goes on where it was: rules that are there are not learned again, and trainings
    are resumed.

    Args:
        output: directory for ``constraints.yaml``, the trainings, ``transfer.json`` and
            ``transfer.md``.
        settings: what to run.
        progress: called with the robot steps made and to make.

    Returns:
        The document that ``transfer.json`` holds.

    Raises:
        OccError: a setting is wrong, or a training failed.
    """
    # Refused before the expert demonstrates.
    PPOLagrangianConfig().check_steps('steps', settings.steps, settings.robots)
    make_directory(output)
    rules = output / 'constraints.yaml'
    if not rules.exists():
        demonstrated_constraints(
            settings.source, settings.expert, settings.demonstrations, explore=True
        ).save(rules)
    constraints = load_constraints(rules)
    arguments = [settings.target, '--cost', str(rules), '--cost-limit', str(settings.cost_limit)]
    arguments += ['--steps', str(settings.steps), '--robots', str(settings.robots), '--resume']
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    directories = train_seeds(
        arguments,
        seeds,
        output / 'training',
        progress=lambda latest: progress(
            sum(line['steps'] for line in latest.values()), settings.steps * settings.seeds
        ),
    )
    policies = [path / 'policy.npz' for path in directories]
    summary, _ = seeds_summary(directories)
    expert = _judge(settings.source, settings.expert, constraints, settings.episodes)
    trained = [
        _judge(settings.target, str(policy), constraints, settings.episodes)
        for policy in policies
        if policy.exists()
    ]
    document = {
        'settings': asdict(settings),
        'rules': len(constraints.rule_set.order),
        'demonstrations': dict(constraints.coverage),
        'expert': expert,
        'trained': trained,
        'trained_mean': {name: _mean([line[name] for line in trained]) for name in expert},
        'during_training': summary['seeds'],
        'machine': machine(),
        'versions': versions(('numpy', 'torch', 'mujoco')),
    }
    write_results(output, 'transfer', document, _markdown(document))
    return document


def _markdown(document: dict[str, Any]) -> str:
    names = {'return': 'return', 'cost': 'true cost', 'learned_cost': 'learned cost'}
    rows = [
        (title, *('-' if line[name] is None else f'{line[name]:.2f}' for name in names))
        for title, line in (
            ('expert', document['expert']),
            ('mean of the trained', document['trained_mean']),
        )
    ]
    return markdown_table(('policy', *names.values()), rows) + '\n'


def demonstrated_constraints(
    world: str, driver: str, episodes: int, *, explore: bool, seed: int = 0
) -> Constraints:
    """Learn rules from one episode of each of several robots.

    Args:
        world: name of the world, which is that of its feature map too.
        driver: a policy file, or the name of a driver.
        episodes: number of robots.
        explore: sample the actions of a trained policy.
        seed: of world, driver and the choice of held-out episodes.
    """
    feature_map = load_feature_map(world)
    values, robots = demonstrate(world, driver, episodes, seed=seed, explore=explore)
    return learn(
        values,
        robots,
        feature_map.space,
        rng=np.random.default_rng(seed),
        feature_map=feature_map.to_document(),
    )


def _judge(world: str, driver: str, constraints: Constraints, episodes: int) -> dict[str, float]:
    """Return mean return, true cost and learned cost per episode, with 95 % half widths."""
    simulated = make_world(world, min(episodes, 64))
    numbers = {}
    for name, source in (('cost', None), ('learned_cost', RuleCost(constraints, simulated))):
        rng = np.random.default_rng(_EVALUATION_SEED)
        result = evaluate(
            simulated,
            find_driver(simulated, driver, rng, explore=True),
            episodes=episodes,
            seed=_EVALUATION_SEED,
            cost_source=source,
        )
        numbers['return'] = float(result.returns.mean())
        numbers['return_ci95'] = half_width(result.returns)
        numbers[name] = float(result.costs.mean())
        numbers[f'{name}_ci95'] = half_width(result.costs)
    simulated.close()
    return numbers


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
