# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Finds monitors and gates, and brings what they publish to the model.

Nothing is woken by a message: a few times a second all topics are looked at. Of most only the
newest message is read; of verdicts each, for a violation may last a single input.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.serialized_tables import TableReader
from occ_constraints_pkg.fleet.calls import Calls
from occ_constraints_pkg.fleet.events import read_event
from occ_constraints_pkg.fleet.messages import JUDGING, read_gate, read_monitors, read_report
from occ_constraints_pkg.fleet.model import LOST_SECONDS, Fleet, Robot
from occ_constraints_pkg.ros.node import refusal_of
from occ_constraints_pkg.ros.qos import LATCHED, VERDICTS, no_events
from occ_constraints_pkg.ros.rclpy_internals import RCLError, take

_DISCOVERY_SECONDS = 1.0
_DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
# Topics of one monitor are found by the end of their names, whatever they are remapped to.
_VERDICTS, _GATE, _EVENTS = '/violation', '/state', '/events'
_TEXT = 'std_msgs/msg/String'
_TABLE = 'sensor_msgs/msg/PointCloud2'
_PARTS = {'rules': _TEXT, 'features': _TABLE, 'rule_stats': _TABLE}
# What a node offers that judges: its verdicts are found under any name.
_MONITOR_SERVICES = ('/prune', '/reset_stats', '/enable')
# Only the newest message counts, and none is sent again for us.
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# Several monitors may publish their latched rules on one topic.
_RULES = QoSProfile(
    depth=10,
    reliability=LATCHED.reliability,
    durability=LATCHED.durability,
)
# More than what is sent between two looks, also from many nodes at once.
_DIAGNOSTICS = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
_decode_table = partial(deserialize_message, message_type=PointCloud2)


@dataclass
class _Topics:
    """The subscriptions to what is published about one robot."""

    violation: Subscription
    parts: dict[str, Subscription] = field(default_factory=dict)
    readers: dict[str, TableReader] = field(
        default_factory=lambda: {part: TableReader(_decode_table) for part in _PARTS}
    )


class Network:
    """Listens to all monitors and gates in the ROS domain, and calls their services.

    Attributes:
        calls: of services, under way.

    Args:
        fleet: gets what is heard.
        context: of ROS, initialised; None for one of its own, which costs another participant.

    Raises:
        OccError: ROS refuses to start.
    """

    def __init__(self, fleet: Fleet, context: Context | None = None) -> None:
        self._fleet = fleet
        self._context, self._owns_context = context or Context(), context is None
        try:
            self._join()
        except RCLError as error:
            self._leave()
            raise refusal_of(error) from error

    def _join(self) -> None:
        context = self._context
        if self._owns_context:
            rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        # Not spun, so that no executor takes a message. By its name, tools do not list it.
        self._node = Node(
            f'_occ_fleet_{time.time_ns() % 10**9}',
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._topics: dict[str, _Topics] = {}
        self._gates: dict[str, Subscription] = {}
        self._events: dict[str, Subscription] = {}
        self._diagnostics = self._subscribe(DiagnosticArray, '/diagnostics', _DIAGNOSTICS)
        self._discover_at, self._polled = 0.0, time.monotonic()
        self.calls = Calls(context, self._fleet)

    def close(self) -> None:
        """Leave the ROS domain."""
        self.calls.close()
        self._node.destroy_node()
        self._leave()

    def _leave(self) -> None:
        if self._owns_context:
            self._context.try_shutdown()

    def poll(self) -> None:
        """Look at all topics once, and bring the model up to date.

        Raises:
            OccError: ROS refuses.
        """
        try:
            self._poll()
        except RCLError as error:
            raise refusal_of(error) from error

    def _poll(self) -> None:
        now = time.monotonic()
        # After a pause of this process all that waited is old, however recently it was received.
        latest = self._polled if now - self._polled > LOST_SECONDS else math.inf
        self._polled = now
        if now >= self._discover_at:
            self._discover_at = now + _DISCOVERY_SECONDS
            self._discover(now)
        for topic, topics in self._topics.items():
            self._hear_robot(self._fleet.robot(topic, now), topics, latest)
        for name, subscription in self._gates.items():
            for data, when, _ in _messages(subscription, latest):
                report = _read(data, DiagnosticArray, read_gate)
                if report is not None:
                    self._fleet.hear_gate(name, report, when)
        for topic, subscription in self._events.items():
            for data, _, _ in _messages(subscription, latest):
                text = _read(data, String, lambda message: message.data)
                event = read_event(text, topic) if text is not None else None
                if event is not None:
                    self._fleet.events.hear(event)
        self._hear_diagnostics(latest)
        self.calls.spin()
        self._fleet.tick(time.monotonic())

    def forget_lost(self) -> None:
        """Drop robots and gates that are lost; who publishes again is found again."""
        for topic in self._fleet.forget_lost(time.monotonic()):
            topics = self._topics.pop(topic)
            for subscription in (topics.violation, *topics.parts.values()):
                self._node.destroy_subscription(subscription)
        for name in self._gates.keys() - self._fleet.gates.keys():
            self._node.destroy_subscription(self._gates.pop(name))

    def learners(self, robot: Robot) -> list[str]:
        """Return the nodes that learn rules in a robot's namespace, by full name."""
        names = [name for name, _ in self._node.get_service_names_and_types()]
        nodes = [name.removesuffix('/learn') for name in names if name.endswith('/learn')]
        namespace = (robot.monitor or robot.topic).rpartition('/')[0]
        return [name for name in nodes if name.rpartition('/')[0] == namespace]

    def _discover(self, now: float) -> None:
        """Subscribe to the topics of monitors and gates that have come."""
        topics = dict(self._node.get_topic_names_and_types())
        arrays = {name for name, kinds in topics.items() if kinds == [_DIAGNOSTIC_ARRAY]}
        for topic in {name for name in arrays if name.endswith(_VERDICTS)} | self._remapped():
            if topic in self._topics or not self._node.count_publishers(topic):
                continue
            subscription = self._subscribe(DiagnosticArray, topic, VERDICTS)
            self._topics[topic] = _Topics(subscription)
            self._fleet.robot(topic, now)
        for topic, own in self._topics.items():
            self._find_parts(self._fleet.robot(topic, now), own)
        for topic in arrays:
            name = topic.removesuffix(_GATE)
            if name != topic and name not in self._gates:
                self._gates[name] = self._subscribe(DiagnosticArray, topic, LATCHED)
        for topic, kinds in topics.items():
            if topic.endswith(_EVENTS) and kinds == [_TEXT] and topic not in self._events:
                self._events[topic] = self._subscribe(String, topic, VERDICTS)
        self._fleet.events.find(
            topic for topic in self._events if self._node.count_publishers(topic)
        )

    def _remapped(self) -> set[str]:
        """Return the topics of verdicts of the nodes that offer what a monitor does."""
        services = {name for name, _ in self._node.get_service_names_and_types()}
        ends = _MONITOR_SERVICES
        nodes = [name.removesuffix(ends[0]) for name in services if name.endswith(ends[0])]
        return {
            topic
            for name in nodes
            if all(f'{name}{end}' in services for end in ends)
            for topic, kinds in self._published_by(name)
            if kinds == [_DIAGNOSTIC_ARRAY] and topic != '/diagnostics'
        }

    def _published_by(self, name: str) -> list[tuple[str, list[str]]]:
        namespace, _, short = name.rpartition('/')
        try:
            return self._node.get_publisher_names_and_types_by_node(short, namespace or '/')
        # It has gone since it was listed.
        except NodeNameNonExistentError:
            return []

    def _find_parts(self, robot: Robot, topics: _Topics) -> None:
        """Find who publishes the verdicts on a robot, and what else that node publishes."""
        publishers = self._node.get_publishers_info_by_topic(robot.topic)
        robot.publishers = len(publishers)
        # This one is not counted.
        robot.health.subscribers = max(0, self._node.count_subscribers(robot.topic) - 1)
        # Endpoints are known a moment before the names of their nodes.
        known = [item for item in publishers if item.node_namespace.startswith('/')]
        if not known:
            return
        one = known[0]
        name = f'{one.node_namespace.rstrip("/")}/{one.node_name}'
        if robot.monitor != name:
            robot.monitor = name
        elif len(topics.parts) == len(_PARTS):
            return
        for topic, kinds in self._published_by(name):
            part = topic.rpartition('/')[2]
            if kinds != [_PARTS.get(part)]:
                continue
            before = topics.parts.get(part)
            if before is not None:
                if before.topic_name == topic:
                    continue
                self._node.destroy_subscription(before)
            kind, qos = (String, _RULES) if part == 'rules' else (PointCloud2, _NEWEST)
            topics.parts[part] = self._subscribe(kind, topic, qos)

    def _hear_robot(self, robot: Robot, topics: _Topics, latest: float) -> None:
        waited = 0
        for data, when, sent_ns in _messages(topics.violation, latest):
            waited += 1
            report = _read(data, DiagnosticArray, read_report)
            if report is not None:
                robot.hear(report, when, sent_ns)
        robot.health.queue = waited, topics.violation.qos_profile.depth
        for part, subscription in topics.parts.items():
            for data, when, _ in _messages(subscription, latest):
                if part == 'rules':
                    text = _read(data, String, lambda message: message.data)
                    if text is not None:
                        robot.hear_rules(text, when)
                else:
                    self._hear_table(robot, part, topics.readers[part], data, when)

    @staticmethod
    def _hear_table(robot: Robot, part: str, reader: TableReader, data: bytes, when: float) -> None:
        try:
            message = reader.read(data)
            table = message.table
        # Anybody may publish anything there; RuntimeError is a message that is cut off.
        except (OccError, RuntimeError) as error:
            robot.problem = f'a message on {part} cannot be read: {error}'
            return
        if part == 'features':
            robot.hear_features(table.values, message.frame_id, when)
        elif set(table.names) >= {'evaluated', 'violated'}:
            columns = [table.column(name) for name in ('evaluated', 'violated')]
            robot.hear_counts(np.stack(columns, axis=1))

    def _hear_diagnostics(self, latest: float) -> None:
        # The topic is everybody's: only messages of monitors are read.
        mark = JUDGING.encode()
        monitors = {robot.monitor: robot for robot in self._fleet.robots.values()}
        for data, when, _ in _messages(self._diagnostics, latest):
            if mark not in data:
                continue
            for name, report in (_read(data, DiagnosticArray, read_monitors) or {}).items():
                if name in monitors:
                    monitors[name].hear_monitor(report, when)

    def _subscribe(self, kind: Any, topic: str, qos: QoSProfile) -> Subscription:
        return self._node.create_subscription(
            kind, topic, _never, qos, raw=True, event_callbacks=no_events()
        )


def _never(_message: bytes) -> None:
    """Stand for a callback: the node is not spun."""


def _messages(subscription: Subscription, latest: float) -> Iterator[tuple[bytes, float, int]]:
    """Yield what waits on a subscription: data, when it came (steady), when it was sent (ns).

    None counts as having come after ``latest``.
    """
    # More may come all the time.
    for _ in range(subscription.qos_profile.depth):
        taken = take(subscription)
        if taken is None:
            return
        data, info = taken
        age = time.time_ns() - info['received_timestamp'] if info['received_timestamp'] else 0
        # When the clock was set back in between, it came just now.
        when = time.monotonic() - max(0, age) / 1e9
        yield data, min(when, latest), info['source_timestamp']


def _read(data: bytes, kind: Any, read: Callable[[Any], Any]) -> Any:
    """Return what a message says; None for one that is damaged."""
    try:
        message = deserialize_message(data, kind)
    except RuntimeError:
        # The middleware drops such a message where an executor takes it, as it does here.
        return None
    return read(message)
