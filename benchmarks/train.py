# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Training as it is run: over topics, in one process with rules, and with the world's own cost."""

from __future__ import annotations

from typing import Any

from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.run import RunSettings
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.agents.training import TrueCost, train
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks import loop

# Of the measured time, what the peer gets in addition.
_PEER_SHARE = 0.25


def run(seconds: float = 60.0) -> dict[str, Any]:
    """Measure training with everything included: simulation, costs, learner and its updates.

    The comparison of three processes with one is that of :mod:`.loop`, over a longer time. Beside
    them is ``occ train`` with its defaults, the world's own cost and fewer robots.

    Args:
        seconds: training time of each of the two forms.
    """
    document = loop.run(seconds)
    figures = document['metrics']
    settings = RunSettings(document['settings']['world'])
    world = make_world(settings.world, settings.robots)
    learner = PPOLagrangian(
        PPOLagrangianConfig(), world.columns, world.action_columns, world.name, settings.seed
    )
    history = train(world, learner, TrueCost(), seed=settings.seed, seconds=_PEER_SHARE * seconds)
    world.close()
    lines = [metrics.as_dict() for metrics in history]
    return {
        **document,
        'metrics': {
            'train_three_processes_env_steps_per_s': figures['loop_env_steps_per_s'],
            'train_one_process_env_steps_per_s': figures['one_process_env_steps_per_s'],
            'train_three_per_one_process_ratio': figures['loop_per_one_process_ratio'],
        },
        'peers': {'train_true_cost_env_steps_per_s': loop.steps_per_second(lines)},
    }
