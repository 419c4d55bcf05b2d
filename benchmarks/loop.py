# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The loop of sim, monitor and learner beside the same training in one process."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.agents.training import train
from occ_constraints_pkg.demo.processes import nodes_running, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.registry import make_world

from experiments.transfer import demonstrated_constraints

_WORLD = 'PointGoal1'
_ROBOTS, _ROLLOUT_STEPS = 256, 128
_ROUNDS = 2
_DEMONSTRATION_ROBOTS = 20
_START_SECONDS = 60.0


def run(seconds: float = 20.0) -> dict[str, Any]:
    """Compare training over topics (three processes) with training in one process.

    Both run the same learner on PointGoal1 with costs from the same learned rules, by turns, so
    that a change of the machine's load meets both. Counted from the first update to the last.

    Args:
        seconds: training time of each form, split into rounds.
    """
    constraints = demonstrated_constraints(_WORLD, 'expert', _DEMONSTRATION_ROBOTS, explore=False)
    share = seconds / _ROUNDS
    alone, loop = [], []
    with tempfile.TemporaryDirectory() as directory:
        for number in range(_ROUNDS):
            alone.append(steps_per_second(_train_alone(constraints, share, number)))
            place = Path(directory) / str(number)
            loop.append(steps_per_second(_train_over_topics(constraints, share, number, place)))
    full, single = float(np.mean(loop)), float(np.mean(alone))
    return {
        'metrics': {
            'loop_env_steps_per_s': full,
            'one_process_env_steps_per_s': single,
            'loop_per_one_process_ratio': full / single,
        },
        'peers': {},
        'settings': {
            'world': _WORLD,
            'robots': _ROBOTS,
            'rollout_steps': _ROLLOUT_STEPS,
            'rules': len(constraints.rule_set.rules),
            'seconds': seconds,
            'rounds': _ROUNDS,
        },
    }


def _train_alone(constraints: Constraints, seconds: float, seed: int) -> list[dict[str, Any]]:
    world = make_world(_WORLD, _ROBOTS)
    learner = PPOLagrangian(
        PPOLagrangianConfig(rollout_steps=_ROLLOUT_STEPS),
        world.columns,
        world.action_columns,
        world.name,
        seed,
    )
    history = train(world, learner, RuleCost(constraints, world), seed=seed, seconds=seconds)
    world.close()
    return [metrics.as_dict() for metrics in history]


def _train_over_topics(
    constraints: Constraints, seconds: float, seed: int, directory: Path
) -> list[dict[str, Any]]:
    rules, output = directory / 'constraints.yaml', directory / 'training'
    constraints.save(rules)
    nodes: dict[str, Mapping[str, Any]] = {
        'monitor': {'constraints_file': rules},
        'constrained_learner': {
            'output': output,
            'seconds': seconds,
            'seed': seed,
            'rollout_steps': _ROLLOUT_STEPS,
        },
        'sim': {'world': _WORLD, 'num_robots': _ROBOTS, 'seed': seed, 'wait_for_subscribers': 2},
    }
    with private_domain() as domain, nodes_running(nodes, directory, domain) as running:
        running['constrained_learner'].wait(seconds + _START_SECONDS, *running.values())
    log = output / 'metrics.jsonl'
    lines = log.read_text(encoding='utf-8').splitlines() if log.exists() else []
    return [json.loads(line) for line in lines]


def steps_per_second(history: list[dict[str, Any]]) -> float:
    """Return transitions per second after the first update, updates included.

    Args:
        history: metrics of each update.

    Raises:
        OccError: there are fewer than two.
    """
    if len(history) < 2:
        raise OccError(
            f'the measured time was too short for two updates of the policy; got {len(history)}, '
            'allow more with --seconds'
        )
    steps = np.diff([item['steps'] for item in history])
    rates = np.array([item['steps_per_s'] for item in history[1:]])
    return float(steps.sum() / (steps / rates).sum())
