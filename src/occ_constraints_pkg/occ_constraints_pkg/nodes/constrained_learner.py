# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``constrained_learner``: trains a policy on observations and the monitor's costs."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian, torch_device
from occ_constraints_pkg.agents.settings import (
    AFTER_CLONING,
    PPOLagrangianConfig,
    learner_settings,
)
from occ_constraints_pkg.agents.training import TrainingDirectory
from occ_constraints_pkg.datasets.driven import read_driven
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.nodes.lockstep import (
    CompetingPublishers,
    Pairing,
    action_table,
    step_batch,
)
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import STEPS, VERDICTS, overridable
from occ_constraints_pkg.ros.tables import subscribe_to_tables, table_bytes, table_message
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import world_class
from occ_constraints_pkg.worlds.stream import StepBatch

# How often the node checks whether it gets what it needs, and how long it waits in silence.
_CHECK_SECONDS, _SILENT_SECONDS = 0.5, 2.0


class ConstrainedLearner(OccNode):
    """Acts when it holds observation and costs of one stamp; updates when its rollout is full."""

    def __init__(self) -> None:
        super().__init__('constrained_learner')
        output = self.parameter('output', 'training', 'directory for policy, metrics, checkpoint')
        self._resume = self.parameter(
            'resume', False, 'go on from the checkpoint in output, if there is one'
        )
        self._total = self.parameter(
            'total_steps', 1_000_000, 'robot steps after which training ends', low=1
        )
        limit = 'wall time from the first step after which it ends; 0: no limit'
        self._seconds = self.parameter('seconds', 0.0, limit, low=0.0) or math.inf
        self._seed = self.parameter('seed', 0, 'seed of weights and exploration', low=0)
        self._demonstrations = self.parameter(
            'demonstrations',
            [],
            'bags with observations and actions from which a new policy is cloned first; none: '
            'begin with a random policy',
        )
        defaults = PPOLagrangianConfig()
        self._config = replace(
            learner_settings(AFTER_CLONING if self._demonstrations else {}),
            cost_limit=self.parameter(
                'cost_limit', defaults.cost_limit, 'mean cost per episode to stay under', low=0.0
            ),
            rollout_steps=self.parameter(
                'rollout_steps', defaults.rollout_steps, 'steps per robot and update', low=2
            ),
            decay_steps=self._total,
            device=self.parameter('device', defaults.device, 'torch device, cpu or cuda'),
        )
        self.declared()
        # Refused now, not when the first observation comes, as far as one robot shows it.
        torch_device(self._config.device)
        self._config.check_steps('total_steps', self._total, 1)
        fixed = {'cost_limit': self._config.cost_limit, 'rollout_steps': self._config.rollout_steps}
        self._directory = TrainingDirectory(output, {**fixed, 'seed': self._seed})
        self._learner: PPOLagrangian | None = None
        self._kind: type[World] | None = None
        self._step_ns = 0
        self._began = 0.0
        self._answered: int | None = None
        self._answer: bytes | None = None
        # The stamp that was due when another one came instead.
        self._due_before: int | None = None
        # That of the costs learned from last.
        self._rule_set = ''
        # The newest observation, with its stamp, for which an action has been chosen.
        self._seen: int | None = None
        self._batch: StepBatch | None = None
        # When the last step came, why the newest is no step, and whether waiting has been reported.
        self._paired = self.steady_seconds()
        self._problem = ''
        self._is_waiting = False

        self._action = self.create_publisher(
            PointCloud2, 'action', STEPS, qos_overriding_options=overridable()
        )
        self._training = self.create_publisher(
            PointCloud2, 'training', VERDICTS, qos_overriding_options=overridable()
        )
        self._competing = CompetingPublishers(self, self._action)
        self._pairing = Pairing(self._on_step)
        topics = {'observation': self._on_observation, 'costs': self._pairing.on_second}
        self._observation, self._costs = (
            subscribe_to_tables(self, *item).topic_name for item in topics.items()
        )
        self.steady_timer(_CHECK_SECONDS, self._check_input)
        self.get_logger().info(f'waiting for {self._observation} and {self._costs}')

    def _on_observation(self, message: TableMessage) -> None:
        # While the monitor judges, the action is chosen: it does not depend on the cost.
        stamp = message.stamp_ns
        if self._learner is not None and stamp not in (self._answered, self._seen):
            self._directory.check_world(self._learner, message.frame_id)
            self._seen, self._batch = stamp, step_batch(message.table)
            self._learner.choose(self._batch)
        if stamp != self._answered:
            self._competing.expect(stamp, None)
        self._pairing.on_first(message)

    def _on_step(self, observation: TableMessage, costs: TableMessage) -> None:
        stamp = observation.stamp_ns
        if self._competing.found:
            # Whose action led on from the step answered last is not known.
            self._answered = None
            self._problem = f'another node publishes other actions on {self._action.topic_name}'
            return
        if stamp == self._answered:
            # A repeat: the answer was lost or crossed with it. Nothing is learned twice.
            self._action.publish(self._answer)
            return
        verdicts = costs.table
        unknown = verdicts.column('verdict') == Verdict.UNKNOWN
        if unknown.all():
            # No cost at all: the step is left open until the monitor knows.
            self._problem = 'the monitor reports UNKNOWN for every robot'
            return
        if unknown.any():
            self.get_logger().warning(
                f'the monitor reports UNKNOWN for {unknown.sum()} robot(s), which costs as much as '
                'a violation',
                throttle_duration_sec=5.0,
            )
        self._end_waiting()
        if costs.frame_id != self._rule_set:
            if self._rule_set:
                self.get_logger().warning(
                    f'costs are now those of rule set {costs.frame_id}, before of {self._rule_set}',
                    throttle_duration_sec=5.0,
                )
            self._rule_set = costs.frame_id
        seen = self._batch if stamp == self._seen else None
        batch = seen or step_batch(observation.table)
        world = observation.frame_id
        learner = self._learner or self._start(world, len(batch.reward))
        due = None if self._answered is None else self._answered + self._step_ns
        if stamp != due:
            if stamp == self._due_before:
                self.get_logger().warning(
                    f'two simulations take turns on {self._observation}; allowed is one',
                    throttle_duration_sec=5.0,
                )
            self._due_before = due
            # First states are those of episode 0 to which no step led, hence without reward.
            self._interrupt(learner, is_start=not (batch.episode.any() or batch.reward.any()))
        updates = learner.updates
        learner.time_share = (time.monotonic() - self._began) / self._seconds
        action = learner.act(batch, verdicts.column('cost'))
        answer = action_table(self._kind.action_columns, action)
        self._answer, self._answered = table_bytes(answer, stamp, world), stamp
        self._competing.expect(stamp, answer)
        self._action.publish(self._answer)
        # An update may have taken long, which is no waiting.
        self._paired = self.steady_seconds()
        if learner.updates > updates:
            self._report(stamp)
        if learner.steps >= self._total or time.monotonic() - self._began >= self._seconds:
            self.finish()

    def _start(self, world: str, robots: int) -> PPOLagrangian:
        self._config.check_steps('total_steps', self._total, robots)
        kind = self._kind = world_class(world)
        self._step_ns = round(kind.step_seconds * 1e9)
        if self._resume and self._directory.has_checkpoint:
            learner, _ = self._directory.resume(device=self._config.device, decay_steps=self._total)
            self._directory.check_world(learner, world)
            self.get_logger().info(
                f'training on {world} goes on from {learner.steps} steps, {learner.updates} updates'
            )
        else:
            learner = PPOLagrangian(
                self._config, kind.columns, kind.action_columns, world, self._seed
            )
            earlier = self._directory.begin()
            if earlier:
                self.get_logger().info(f'an earlier training is now in {earlier}')
            self.get_logger().info(f'training on {world}')
            if self._demonstrations:
                self._clone(learner, kind)
        self._learner = learner
        self._began = time.monotonic()
        return learner

    def _clone(self, learner: PPOLagrangian, kind: type[World]) -> None:
        driven = read_driven(
            self._demonstrations, learner.columns, learner.action_columns, kind.name
        )
        error = learner.clone(driven.observations, driven.actions)
        self.get_logger().info(
            f'the policy is cloned from {len(driven.actions)} demonstrated actions, mean squared '
            f'error {error:.3f}'
        )

    def _interrupt(self, learner: PPOLagrangian, *, is_start: bool) -> None:
        """Begin with a state that is not the successor of the one answered last."""
        if not is_start:
            self.get_logger().warning(
                'the simulation is under way; its episodes up to here do not count in the means',
                throttle_duration_sec=5.0,
            )
        elif self._answered is not None:
            self.get_logger().warning(
                'the simulation has started anew; the step under way is dropped'
            )
        learner.interrupt(new_episodes=is_start)

    def _check_input(self) -> None:
        """Report what is missing while no step comes; runs on the steady clock."""
        self._competing.check_publishers()
        waited = self.steady_seconds() - self._paired
        if waited < _SILENT_SECONDS:
            return
        first = self._pairing.first
        is_answered = first is None or first.stamp_ns == self._answered
        if not self.count_publishers(self._observation):
            problem = f'nobody publishes {self._observation}: there is no simulation'
        elif not self.count_publishers(self._costs):
            problem = f'nobody publishes {self._costs}: there is no monitor'
        else:
            silent = self._observation if is_answered else self._costs
            problem = self._problem or f'nothing new comes on {silent}'
        self._is_waiting = True
        self.get_logger().warning(
            f'training has been waiting for {waited:.0f} s: {problem}', throttle_duration_sec=5.0
        )

    def _end_waiting(self) -> None:
        """Note that a step came."""
        if self._is_waiting:
            waited = self.steady_seconds() - self._paired
            self.get_logger().info(f'training goes on after {waited:.1f} s')
        self._paired, self._problem, self._is_waiting = self.steady_seconds(), '', False

    def _report(self, stamp: int) -> None:
        metrics = self._learner.metrics
        self._directory.add(self._learner)
        if self._directory.is_due:
            self._directory.save(self._learner)
        self._training.publish(table_message(training_table(metrics.as_dict()), stamp))
        self.get_logger().info(
            f'{metrics.steps} steps: return {metrics.mean_return:.2f}, '
            f'cost {metrics.mean_cost:.1f}, multiplier {metrics.multiplier:.3f}'
        )

    def close(self) -> None:
        """Save policy and checkpoint, so that a stopped training is not lost."""
        if self._learner is not None and self._learner.updates:
            self._directory.save(self._learner)
            self.get_logger().info(f'policy and checkpoint saved in {self._directory.path}')


def training_table(metrics: Mapping[str, float]) -> Table:
    """Return the metrics of an update as the table that ``training`` carries: float64, one row."""
    return Table(tuple(metrics), np.array([list(metrics.values())], dtype=np.float64))


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(ConstrainedLearner, argv)
