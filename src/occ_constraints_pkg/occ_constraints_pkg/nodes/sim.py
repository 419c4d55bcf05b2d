# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``sim``: a simulated task as topics, in lock-step with whoever acts, or at a fixed rate."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.nodes.lockstep import observation_table
from occ_constraints_pkg.nodes.robot_sensors import RobotSensors, twist_command
from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import SENSORS, SETTLED_CHECKS, STEPS, overridable
from occ_constraints_pkg.ros.tables import subscribe_to_tables, table_bytes
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream, StepBatch
from occ_constraints_pkg.worlds.worker_pool import WorkerError

# How often the node checks whether the subscribers it waits for have come.
_CHECK_SECONDS = 0.05


class Sim(OccNode):
    """Publishes observations and steps on the action that carries the observation's stamp."""

    def __init__(self) -> None:
        super().__init__('sim')
        name = self.parameter('world', 'PointGoal1', 'name of the simulated task')
        robots = self.parameter('num_robots', 1, 'robots simulated at once', low=1)
        processes = self.parameter(
            'processes', 0, 'processes that step them, this one included; 0: one per core', low=0
        )
        seed = self.parameter('seed', 0, 'seed of the simulation', low=0)
        rate = self.parameter(
            'rate', 0.0, 'steps per second; 0: step as soon as the action is there', low=0.0
        )
        repeat_after = self.parameter(
            'repeat_after', 0.5, 'seconds without an action until a repeat', low=0.01
        )
        self._wanted = self.parameter(
            'wait_for_subscribers', 1, 'subscriptions to observation before the start', low=0
        )
        self._episodes = self.parameter(
            'episodes', 0, 'end when every robot has finished as many episodes; 0: never', low=0
        )
        with_clock = self.parameter('publish_clock', False, 'publish simulated time on /clock')
        by_velocity = self.parameter(
            'drive_by_cmd_vel',
            False,
            'drive the only robot by cmd_vel, not by action; in real time unless rate is set',
        )
        self._velocity_timeout = self.parameter(
            'cmd_vel_timeout', 0.5, 'seconds without cmd_vel until the robot stops', low=0.01
        )
        self.declared()

        self._world = make_world(name, robots, processes=processes)
        self._stream = EpisodeStream(self._world, seed=seed)
        self._action_names = tuple(column.name for column in self._world.action_columns)
        # Stamps are identities of steps; a start at wall time keeps them unique over restarts.
        self._stamp = time.time_ns()
        self._step_ns = round(self._world.step_seconds * 1e9)
        self._waiting: np.ndarray | None = None
        self._message: bytes | None = None
        if by_velocity and (robots > 1 or self._world.view_kinds is None):
            raise ConfigurationError(
                f'parameter drive_by_cmd_vel drives one robot of a Safety-Gym task; '
                f'got {robots} of {name}'
            )
        if by_velocity and rate == 0.0:
            rate = 1.0 / self._world.step_seconds
        self._in_step = rate == 0.0
        self._command = (0.0, 0.0)
        self._finished = np.zeros(robots, dtype=np.int64)

        self._observation = self.create_publisher(
            PointCloud2, 'observation', STEPS, qos_overriding_options=overridable()
        )
        self._clock_publisher = self.create_publisher(Clock, '/clock', 10) if with_clock else None
        self._sensors = RobotSensors(self, self._world)
        if by_velocity:
            self.create_subscription(Twist, 'cmd_vel', self._on_velocity, SENSORS)
            self._stop_timer = self.steady_timer(self._velocity_timeout, self._stop)
        else:
            subscribe_to_tables(self, 'action', self._on_action)
        self._settled_checks = 0
        self._start_timer = self.steady_timer(_CHECK_SECONDS, self._start)
        self._repeat_timer = self.steady_timer(repeat_after, self._repeat)
        if not self._in_step:
            self.steady_timer(1.0 / rate, self._tick_by_velocity if by_velocity else self._tick)
        self.get_logger().info(
            f'{name} with {robots} robot(s), waiting for {self._wanted} subscriber(s)'
        )

    def close(self) -> None:
        """Let the last observation leave and release the world."""
        self.flush(self._observation)
        self._world.close()

    def _start(self) -> None:
        if self._observation.get_subscription_count() < self._wanted:
            self._settled_checks = 0
            return
        self._settled_checks += 1
        if self._wanted and self._settled_checks < SETTLED_CHECKS:
            return
        self._start_timer.cancel()
        self._publish(self._stream.reset())

    def _on_action(self, message: TableMessage) -> None:
        # The answer to an earlier step: a repeat crossed with it on the way.
        if self._message is None or message.stamp_ns != self._stamp:
            return
        with self._ignoring_mistakes():
            table = message.table
            if table.names != self._action_names:
                raise ConfigurationError(
                    f'an action has the columns {", ".join(table.names)}; '
                    f'this world has {", ".join(self._action_names)}'
                )
            if self._in_step:
                self._step(table.values)
            else:
                self._waiting = table.values

    def _tick(self) -> None:
        action, self._waiting = self._waiting, None
        if action is not None:
            with self._ignoring_mistakes():
                self._step(action)

    @contextmanager
    def _ignoring_mistakes(self) -> Iterator[None]:
        """Within the block, a mistake in the action is reported, and the action is ignored."""
        try:
            yield
        except WorkerError:
            raise
        except OccError as error:
            self.get_logger().error(f'action ignored: {error}', throttle_duration_sec=1.0)

    def _on_velocity(self, message: Twist) -> None:
        try:
            self._command = twist_command(message)
            self._stop_timer.reset()
        except OccError as error:
            self.get_logger().error(f'cmd_vel ignored: {error}', throttle_duration_sec=1.0)

    def _stop(self) -> None:
        self._command = (0.0, 0.0)

    def _tick_by_velocity(self) -> None:
        if self._message is not None:
            self._step(self._world.action_for(0, *self._command)[None])

    def _step(self, action: np.ndarray) -> None:
        batch = self._stream.step(action)
        self._stamp += self._step_ns
        self._publish(batch)
        if self._episodes:
            self._finished += batch.done
            if self._finished.min() >= self._episodes:
                self.get_logger().info(f'{self._episodes} episode(s) of every robot are over')
                self.finish()

    def _publish(self, batch: StepBatch) -> None:
        table = observation_table(self._world.columns, batch)
        self._message = table_bytes(table, self._stamp, self._world.name)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=to_time(self._stamp)))
        # Stamps of steps run at the pace of the simulation, which only /clock can tell others;
        # without it, sensors are stamped as those of a real robot.
        has_clock = self._clock_publisher is not None
        self._sensors.publish(self._stamp if has_clock else time.time_ns())
        self._observation.publish(self._message)
        self._repeat_timer.reset()

    def _repeat(self) -> None:
        if self._message is not None:
            self._observation.publish(self._message)


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Sim, argv)
