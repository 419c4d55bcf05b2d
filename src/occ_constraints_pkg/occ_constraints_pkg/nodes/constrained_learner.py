# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``constrained_learner``: trains a policy on observations and the monitor's costs."""

from __future__ import annotations

import math
import time

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_constraints_pkg.agents.networks import torch_device
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.agents.training import TrainingDirectory
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.ros.lockstep import Pairing
from occ_constraints_pkg.ros.messages import table_message, to_nanoseconds
from occ_constraints_pkg.ros.process import OccNode, run_node
from occ_constraints_pkg.ros.qos import STEPS, VERDICTS, overridable
from occ_constraints_pkg.ros.tables import action_table, step_batch
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import world_class


class ConstrainedLearner(OccNode):
    """Acts when it holds observation and costs of one stamp; updates when its rollout is full."""

    def __init__(self) -> None:
        super().__init__('constrained_learner')
        output = self.parameter('output', 'training', 'directory for policy, metrics, checkpoint')
        self._total = self.parameter(
            'total_steps', 1_000_000, 'robot steps after which training ends', low=1
        )
        self._seconds = self.parameter(
            'seconds',
            0.0,
            'wall time from the first step after which it ends; 0: no limit',
            low=0.0,
        )
        self._seed = self.parameter('seed', 0, 'seed of weights and exploration', low=0)
        defaults = PPOLagrangianConfig()
        self._config = PPOLagrangianConfig(
            cost_limit=self.parameter(
                'cost_limit', defaults.cost_limit, 'mean cost per episode to stay under', low=0.0
            ),
            rollout_steps=self.parameter(
                'rollout_steps', defaults.rollout_steps, 'steps per robot and update', low=2
            ),
            device=self.parameter('device', defaults.device, 'torch device, cpu or cuda'),
        )
        # Refused now, not when the first observation comes.
        torch_device(self._config.device)
        self._directory = TrainingDirectory(output)
        self._learner: PPOLagrangian | None = None
        self._kind: type[World] | None = None
        self._step_ns = 0
        self._began = 0.0
        self._answered: int | None = None
        self._answer: PointCloud2 | None = None

        self._action = self.create_publisher(
            PointCloud2, 'action', STEPS, qos_overriding_options=overridable()
        )
        self._training = self.create_publisher(
            PointCloud2, 'training', VERDICTS, qos_overriding_options=overridable()
        )
        pairing = Pairing(self._on_step)
        for topic, callback in (('observation', pairing.on_first), ('costs', pairing.on_second)):
            self.create_subscription(
                PointCloud2, topic, callback, STEPS, qos_overriding_options=overridable()
            )

    def _on_step(self, observation: PointCloud2, costs: PointCloud2) -> None:
        stamp = to_nanoseconds(observation.header.stamp)
        if stamp == self._answered:
            # A repeat: the answer was lost or crossed with it. Nothing is learned twice.
            self._action.publish(self._answer)
            return
        verdicts = Table.from_message(costs)
        if (verdicts.column('verdict') == Verdict.UNKNOWN).any():
            self.get_logger().warning(
                'the monitor says UNKNOWN, which costs as much as a violation',
                throttle_duration_sec=5.0,
            )
        batch = step_batch(Table.from_message(observation))
        world = observation.header.frame_id
        learner = self._learner or self._start(world)
        if self._answered is not None and stamp != self._answered + self._step_ns:
            # Not the successor of the step answered last: the simulation was started anew.
            learner.interrupt(new_episodes=not batch.episode.any())
        updates = learner.updates
        action = learner.act(batch, verdicts.column('cost'))
        answer = action_table(self._kind.action_columns, action)
        self._answer, self._answered = table_message(answer, stamp, world), stamp
        self._action.publish(self._answer)
        if learner.updates > updates:
            self._report(stamp)
        limit = self._seconds or math.inf
        if learner.steps >= self._total or time.monotonic() - self._began >= limit:
            self.finish()

    def _start(self, world: str) -> PPOLagrangian:
        kind = self._kind = world_class(world)
        self._step_ns = round(kind.step_seconds * 1e9)
        self._learner = PPOLagrangian(
            self._config, kind.columns, kind.action_columns, world, self._seed
        )
        earlier = self._directory.begin()
        if earlier:
            self.get_logger().info(f'an earlier training is now in {earlier}')
        self._began = time.monotonic()
        self.get_logger().info(f'training on {world}')
        return self._learner

    def _report(self, stamp: int) -> None:
        metrics = self._learner.metrics
        numbers = metrics.as_dict()
        self._directory.add(self._learner)
        values = np.array([list(numbers.values())], dtype=np.float64)
        self._training.publish(table_message(Table(tuple(numbers), values), stamp))
        self.get_logger().info(
            f'{metrics.steps} steps: return {metrics.mean_return:.2f}, '
            f'cost {metrics.mean_cost:.1f}, multiplier {metrics.multiplier:.3f}'
        )

    def close(self) -> None:
        """Save policy and checkpoint, so that a stopped training is not lost."""
        if self._learner is not None and self._learner.updates:
            self._directory.save(self._learner)
            self.get_logger().info(f'policy and checkpoint saved in {self._directory.path}')


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(ConstrainedLearner, argv)
