# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How soon, and for how long, the learner's policies are within their limit.

Policies are trained with the learner's defaults. Along the way and at the end each acts in fresh
episodes, with its mean actions, as policies are used, and with sampled ones, as it was trained.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.evaluation import Evaluation, evaluate, half_width
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.settings import TrainingMetrics, learner_settings
from occ_constraints_pkg.agents.training import CostSource, TrueCost, train
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks.conditions import machine, versions
from experiments.learner_picture import draw_learner
from experiments.results import earlier_results, markdown_table, write_results
from experiments.transfer import demonstrated_constraints

ROBOTS = 64
"""Robots simulated at once in a training."""

_FORMAT = 1
_EVALUATION_SEED = 20_000
_TESTED_ROBOTS = 64
_HEADS = (
    *('world', 'cost', 'limit', 'steps', 'core minutes', 'seeds', 'actions'),
    *('return', 'cost per episode', 'of the single seeds'),
)


@dataclass(frozen=True)
class Task:
    """One training.

    Attributes:
        world: name of the world.
        cost: ``true`` for that of the world, ``rules`` for rules of the world's expert.
        limit: allowed mean cost per episode.
        steps: robot steps.
        seed: of the training.
    """

    world: str
    cost: str
    limit: float
    steps: int
    seed: int

    @property
    def key(self) -> str:
        """Its name among the results."""
        return f'{self.world}, {self.cost}, {self.limit:g}, {self.steps}, {self.seed}'


def run_learner(
    output: Path,
    *,
    worlds: Sequence[str],
    costs: Sequence[str],
    limits: Sequence[float],
    steps: int,
    seeds: Sequence[int],
    points: int = 16,
    processes: int = 1,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Train what ``output/learner.json`` lacks yet; write that file, a page and a picture.

    The files are brought up to date after each training, so a stopped run can be continued.

    Args:
        output: directory of the results.
        worlds: names of the worlds.
        costs: ``true``, ``rules`` or both.
        limits: cost limits.
        steps: robot steps of each training.
        seeds: of the trainings.
        points: how often a policy is judged in 64 episodes along the way.
        processes: trainings at once; each takes one core.
        progress: called with (trainings done, trainings in all).

    Raises:
        OccError: the directory holds results of other settings.
    """
    settings = {'format': _FORMAT, 'points': points}
    lines = earlier_results(output / 'learner.json', settings).get('lines', {})
    wanted = [Task(*item) for item in product(worlds, costs, limits, (steps,), seeds)]
    todo = [task for task in wanted if task.key not in lines]
    done = len(wanted) - len(todo)
    document: dict[str, Any] = {}
    for task, line in _trained(todo, points, processes):
        lines[task.key] = {**asdict(task), **line}
        done += 1
        progress(done, len(wanted))
        document = {
            'settings': settings,
            'lines': dict(sorted(lines.items())),
            'machine': machine(),
            'versions': versions(('numpy', 'torch', 'mujoco')),
        }
        write_results(output, 'learner', document, table(lines))
        draw_learner(output / 'learner.png', lines)
    return document or {'settings': settings, 'lines': lines}


def _trained(
    tasks: Sequence[Task], points: int, processes: int
) -> Iterator[tuple[Task, dict[str, Any]]]:
    if processes <= 1:
        for task in tasks:
            yield task, train_one(task, points)
        return
    with ProcessPoolExecutor(processes) as pool:
        running = {pool.submit(train_one, task, points): task for task in tasks}
        for future in as_completed(running):
            yield running[future], future.result()


def train_one(task: Task, points: int) -> dict[str, Any]:
    """Train one policy and judge it.

    Args:
        task: what to train.
        points: how often it is judged along the way.

    Returns:
        ``curve``, a list of judgements with ``steps`` and ``core_s``; ``mean`` and ``sampled``,
        the last policy over 200 fresh episodes; ``core_s``, the processor time of the training.
    """
    world = make_world(task.world, ROBOTS, processes=1)
    test = make_world(task.world, _TESTED_ROBOTS, processes=1)
    rules = None
    if task.cost == 'rules':
        rules = demonstrated_constraints(task.world, 'expert', 50, explore=True)
    config = learner_settings({'cost_limit': task.limit, 'decay_steps': task.steps})
    learner = PPOLagrangian(config, world.columns, world.action_columns, world.name, task.seed)
    curve: list[dict[str, float]] = []
    start, judging = time.process_time(), 0.0

    def note(metrics: TrainingMetrics) -> None:
        nonlocal judging
        if metrics.steps < task.steps * (len(curve) + 1) / points:
            return
        now = time.process_time()
        point = {'steps': metrics.steps, 'core_s': round(now - start - judging, 1)}
        judged = _judged(test, learner.policy(), rules, _TESTED_ROBOTS)
        for name, evaluation in judged.items():
            point |= {
                f'{name}_return': round(float(evaluation.returns.mean()), 2),
                f'{name}_cost': round(float(evaluation.costs.mean()), 2),
            }
        curve.append({**point, 'multiplier': round(metrics.multiplier, 3)})
        judging += time.process_time() - now

    train(
        world,
        learner,
        _cost(rules, world),
        seed=task.seed,
        total_steps=task.steps,
        progress=note,
    )
    spent = time.process_time() - start - judging
    final = _judged(test, learner.policy(), rules, 200)
    return {
        'curve': curve,
        **{name: evaluation.as_dict() for name, evaluation in final.items()},
        'core_s': round(spent, 1),
    }


def _cost(rules: Constraints | None, world: World) -> CostSource:
    return TrueCost() if rules is None else RuleCost(rules, world)


def _judged(
    world: World, policy: GaussianPolicy, rules: Constraints | None, episodes: int
) -> dict[str, Evaluation]:
    """Return what a policy does with its mean actions and with sampled ones."""
    rng = np.random.default_rng(_EVALUATION_SEED)
    return {
        name: evaluate(
            world,
            lambda observation, noise=noise: policy.act(observation, noise),
            episodes=episodes,
            seed=_EVALUATION_SEED,
            cost_source=_cost(rules, world),
        )
        for name, noise in (('mean', None), ('sampled', rng))
    }


def table(lines: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the results of the last policies as a Markdown table.

    Args:
        lines: by their keys.
    """
    rows = []
    for group, members in grouped(lines).items():
        minutes = np.mean([line['core_s'] for line in members]) / 60
        for actions in ('mean', 'sampled'):
            values = [[line[actions][name] for line in members] for name in ('return', 'cost')]
            single = '; '.join(f'{r:.1f}, {c:.1f}' for r, c in zip(*values, strict=True))
            rows.append(
                (
                    *group[:2],
                    f'{group[2]:g}',
                    f'{group[3] / 1e6:g}e6',
                    f'{minutes:.1f}',
                    len(members),
                    actions,
                    *(_with_interval(np.array(numbers)) for numbers in values),
                    single,
                )
            )
    return markdown_table(_HEADS, rows) + '\n'


def grouped(
    lines: Mapping[str, Mapping[str, Any]],
) -> dict[tuple[Any, ...], list[Mapping[str, Any]]]:
    """Return the lines by world, cost, limit and steps: those of one group differ by their seed."""
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for _, line in sorted(lines.items()):
        group = tuple(line[name] for name in ('world', 'cost', 'limit', 'steps'))
        groups.setdefault(group, []).append(line)
    return groups


def _with_interval(values: np.ndarray) -> str:
    mean = f'{values.mean():.1f}'
    return mean if len(values) < 2 else f'{mean} ± {half_width(values):.1f}'
