# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How large the runs are, and the runs that several experiments share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from experiments.paper.demonstrations import TRAINED
from experiments.paper.jobs import Job

TASKS = ('PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1')
"""The four tasks, in the order of the paper's tables."""


@dataclass(frozen=True)
class Scale:
    """The size of everything.

    Attributes:
        tasks: of :data:`TASKS`.
        goal_steps: robot steps of a training in a Goal task.
        push_steps: the same in a Push task.
        nav_steps: the same in simple_nav.
        highway_steps: the same on the highway.
        short_steps: the same where only counters are wanted, and to compare depths.
        robots: simulated at once.
        highway_robots: the same on the highway.
        demonstrations: episodes of an expert.
        episodes: fresh episodes over which a policy is judged.
        states: episodes of a heedless driver that rules are judged on.
        diagonal_seeds: trainings under rules that were learned in the same task.
        other_seeds: trainings under rules of another task.
        small_seeds: trainings of the smaller experiments.
        highway_seeds: trainings of each driver on each set.
        depths: of the trees under which CarPush1 is trained.
        sets: of highway scenarios.
    """

    tasks: tuple[str, ...] = TASKS
    goal_steps: int = 4_000_000
    push_steps: int = 6_000_000
    nav_steps: int = 400_000
    highway_steps: int = 600_000
    short_steps: int = 1_000_000
    robots: int = 64
    highway_robots: int = 256
    demonstrations: int = 50
    episodes: int = 200
    states: int = 60
    diagonal_seeds: int = 5
    other_seeds: int = 3
    small_seeds: int = 3
    highway_seeds: int = 5
    depths: tuple[int, ...] = (1, 3, 5, 10)
    sets: tuple[str, ...] = ('restricted', 'full')

    def steps(self, world: str) -> int:
        """Return the robot steps of a training in a world."""
        if world == 'simple_nav':
            return self.nav_steps
        return self.push_steps if 'Push' in world else self.goal_steps


QUICK = Scale(
    tasks=('PointGoal1', 'CarPush1'),
    goal_steps=5_000,
    push_steps=5_000,
    nav_steps=5_000,
    highway_steps=5_000,
    short_steps=5_000,
    robots=8,
    highway_robots=32,
    demonstrations=5,
    episodes=4,
    states=4,
    diagonal_seeds=1,
    other_seeds=1,
    small_seeds=1,
    highway_seeds=1,
    depths=(2,),
    sets=('restricted',),
)
"""Everything in under two minutes; the numbers mean nothing."""


def states_job(scale: Scale, world: str) -> Job:
    """Return the run that writes states to judge rules on."""
    return Job('states', {'world': world, 'episodes': scale.states})


def expert_job(scale: Scale, world: str, seed: int) -> Job:
    """Return the training of an expert: by the true cost, at most 25 per episode."""
    return training_job(scale, world, 'expert', seed, limit=25.0)


def rules_job(scale: Scale, source: str, driver: str, seed: int, **tree: Any) -> Job:
    """Return the run that learns rules from an expert.

    Args:
        scale: the size.
        source: world of the expert.
        driver: ``trained``, or the name of a driver.
        seed: of the expert and of its demonstrations.
        **tree: ``tree`` and ``depth``, where it is not the default learner.
    """
    needs = {'expert': expert_job(scale, source, seed)} if driver == TRAINED else {}
    judged = (source,) if source == 'simple_nav' else scale.tasks
    needs |= {world: states_job(scale, world) for world in judged}
    arguments = {'source': source, 'driver': driver, 'demonstrations': scale.demonstrations}
    if driver == TRAINED:
        arguments['expert_steps'] = scale.steps(source)
    return Job('rules', {**arguments, 'seed': seed, **tree}, needs)


def training_job(
    scale: Scale,
    target: str,
    method: str,
    seed: int,
    *,
    rules: Job | None = None,
    steps: int | None = None,
    **other: Any,
) -> Job:
    """Return the training of a policy.

    Args:
        scale: the size.
        target: world of the training.
        method: by which cost.
        seed: of the training.
        rules: the run whose rules or demonstrations it needs.
        steps: robot steps; None: those of the scale.
        **other: further arguments.
    """
    steps = scale.steps(target) if steps is None else steps
    arguments = {'target': target, 'method': method, 'seed': seed, 'steps': steps}
    arguments |= {'robots': scale.robots, 'episodes': scale.episodes, **other}
    if rules is None:
        return Job('training', arguments, size=steps)
    # With the seed of the rules and all else that they depend on.
    arguments['rules'] = rules.folder.partition('/')[2]
    return Job('training', arguments, {'rules': rules}, size=steps)


def own_rules_job(scale: Scale, task: str, seed: int) -> Job:
    """Return the training under the rules of a trained expert of the same task: the diagonal."""
    return transfer_job(scale, task, task, seed)


def transfer_job(scale: Scale, source: str, target: str, seed: int) -> Job:
    """Return the training in one task under the rules of a trained expert of another."""
    return training_job(scale, target, 'ours', seed, rules=rules_job(scale, source, TRAINED, seed))
