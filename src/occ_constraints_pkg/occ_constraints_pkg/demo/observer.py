# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""An observer that listens to a monitor and compares its verdicts with the simulation's truth."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.ros.messages import to_nanoseconds

_LOOK_SECONDS = 0.05
# An observer holds nobody up: while it waits for a process to end, the others go on. Where none of
# their messages may be missed, their publishers must keep as many (``qos_overrides``).
ALL = QoSProfile(depth=20_000, reliability=ReliabilityPolicy.RELIABLE)


@dataclass
class Heard:
    """What came in, by the stamp of the step.

    Attributes:
        true_cost: stamp to (N,) the simulation's own cost.
        costs: stamp to the (N,) columns cost, verdict, margin, rule.
        violations: stamp to the first violation message with that stamp.
        cost_messages: number of messages on ``cost``.
        duplicates: messages on ``costs`` whose stamp had been heard before.
    """

    true_cost: dict[int, np.ndarray] = field(default_factory=dict)
    costs: dict[int, Table] = field(default_factory=dict)
    violations: dict[int, DiagnosticArray] = field(default_factory=dict)
    cost_messages: int = 0
    duplicates: int = 0

    def agreement(self) -> dict[str, float]:
        """Compare flagged states with truly costly ones, over all robots and steps.

        Returns:
            ``samples``, ``flagged``, ``costly``, and the ratios of :class:`Score`.
        """
        stamps = sorted(self.costs.keys() & self.true_cost.keys())
        if not stamps:
            raise ConfigurationError('no costs were received, so nothing can be compared')
        flagged = np.concatenate([self.costs[stamp].column('cost') for stamp in stamps]) > 0
        costly = np.concatenate([self.true_cost[stamp] for stamp in stamps]) > 0
        score = score_flags(flagged, costly)
        return {
            'samples': score.samples,
            'flagged': score.flagged,
            'costly': score.costly,
            **score.ratios(),
        }


class Observer:
    """Subscribes to observation, costs, cost and violation in a ROS context of its own.

    Attributes:
        heard: what came in so far.
        node: the node that listens, for whoever wants to talk as well.

    Args:
        domain: ROS domain id.
        namespace: of the monitor and the simulation.
    """

    def __init__(self, domain: int, namespace: str = '/') -> None:
        self.heard = Heard()
        self._judging = f'{namespace}/monitor: judging'.lstrip('/')
        self._monitor_ready = 0
        self._context = Context()
        # Read when the context is made: the nodes it listens to are on this machine.
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node('observer', namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        for kind, topic, callback in (
            (PointCloud2, 'observation', self._on_observation),
            (PointCloud2, 'costs', self._on_costs),
            (Float64, 'cost', self._on_cost),
            (DiagnosticArray, 'violation', self._on_violation),
            (DiagnosticArray, '/diagnostics', self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, callback, ALL)

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        # First, for it keeps the node's threads alive.
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def spin_until(self, condition: Callable[[], bool], seconds: float) -> None:
        """Listen until ``condition`` holds.

        Raises:
            OccError: it does not within ``seconds``.
        """
        self.spin(seconds, condition)
        if not condition():
            raise ConfigurationError(f'nothing came of waiting {seconds:g} s for the nodes')

    def spin(self, seconds: float, condition: Callable[[], bool] = lambda: False) -> None:
        """Listen for a while, or until ``condition`` holds if that is sooner."""
        end = time.monotonic() + seconds
        while not condition() and (now := time.monotonic()) < end:
            look = min(now + _LOOK_SECONDS, end)
            # One callback at a time: longer spins do not end while messages come faster than they
            # are handled, whatever their timeout.
            while (left := look - time.monotonic()) > 0:
                self._executor.spin_once(left)

    def wait_for_monitor(self, subscribers: int, seconds: float = 30.0) -> None:
        """Wait until a monitor knows as many subscribers of its costs and violations.

        Raises:
            OccError: it does not within ``seconds``.
        """
        self.spin_until(lambda: self._monitor_ready >= subscribers, seconds)

    def _on_observation(self, message: PointCloud2) -> None:
        try:
            true_cost = Table.from_message(message).column('true_cost')
        except OccError:
            # A robot without a true cost may be observed as well.
            return
        self.heard.true_cost[to_nanoseconds(message.header.stamp)] = true_cost

    def _on_costs(self, message: PointCloud2) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        self.heard.duplicates += stamp in self.heard.costs
        self.heard.costs[stamp] = Table.from_message(message)

    def _on_cost(self, _message: Float64) -> None:
        self.heard.cost_messages += 1

    def _on_violation(self, message: DiagnosticArray) -> None:
        self.heard.violations.setdefault(to_nanoseconds(message.header.stamp), message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._judging:
                values = {item.key: item.value for item in status.values}
                self._monitor_ready = int(values['subscribers'])
