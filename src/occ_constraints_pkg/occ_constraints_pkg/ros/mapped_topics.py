# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to the topics that a feature map names, whatever their types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.fields import FieldReader
from occ_constraints_pkg.ros.clocks import with_source_time
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.node import OccNode, one_line
from occ_constraints_pkg.ros.qos import SENSORS, STEPS, no_events, overridable
from occ_constraints_pkg.ros.tables import table_callback

# How often the publishers of the topics are inspected, and once all are subscribed to.
_INSPECT_SECONDS, _SETTLED_SECONDS = 0.2, 1.0
_BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
_TABLE = 'sensor_msgs/msg/PointCloud2'


class MappedTopics:
    """Subscribes to each topic of a feature map.

    A topic read by column is a table and is subscribed to at once, reliably. The type of any
    other topic is that of its publishers, so the subscription comes when there is a publisher of
    a type that has the fields of the map, and changes when there is only one of another such type.

    Args:
        node: subscribes.
        feature_map: names the topics.
        callback: called with the topic as the map writes it, the message, or the
            :class:`TableMessage` of a table, and when it was published by the publisher's clock in
            ns, 0 if that is not known; not after :meth:`close`, though messages may still be under
            way.

    Raises:
        OccError: a topic's name is not valid, is that of a topic of this node's own, or one that
            it reads as another type.
    """

    def __init__(
        self, node: OccNode, feature_map: FeatureMap, callback: Callable[[str, Any, int], None]
    ) -> None:
        self._node = node
        self._callback = callback
        self._closed = False
        self._full_names = {topic: node.full_name(topic) for topic in feature_map.topics}
        own = {publisher.topic_name for publisher in node.publishers}
        for topic, full_name in self._full_names.items():
            if full_name in own:
                raise ConfigurationError(
                    f'topic {topic!r} is one that node {node.get_name()!r} publishes itself; '
                    'allowed are topics of others'
                )
        self._tables = feature_map.table_topics
        self._fields = {
            topic: [
                FieldReader(name, item)
                for name, item in feature_map.readings
                if topic_key(item.topic) == topic_key(topic)
            ]
            for topic in feature_map.topics
            if topic not in self._tables
        }
        # Of each topic, its subscription with its type.
        self._subscriptions: dict[str, tuple[str, Subscription]] = {}
        # Why messages of a type cannot be read on a topic; empty if they can.
        self._reasons: dict[tuple[str, str], str] = {}
        self._faults: dict[str, str] = {}
        self._reported: set[str] = set()
        self._is_settled = False
        self._timer: Timer | None = None
        try:
            for topic in self._tables:
                self._subscribe(topic, _TABLE, STEPS)
        except OccError:
            self.close()
            raise
        self._timer = node.steady_timer(_INSPECT_SECONDS, self._inspect_publishers)

    def close(self) -> None:
        """Drop all subscriptions."""
        self._closed = True
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        for _, subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)

    @property
    def fault(self) -> str:
        """Which topics are published with a wrong type only; empty if none is."""
        return '; '.join(self._faults.values())

    def problem(self) -> str:
        """Return which topics cannot be received: unpublished, of a wrong type, too weak QoS."""
        problems = []
        for topic in self._full_names:
            publishers = self._publishers(topic)
            if not publishers:
                problems.append(f'nobody publishes {topic}')
            elif fault := self._fault(topic, {item.topic_type for item in publishers}):
                problems.append(fault)
            elif topic in self._tables and all(
                item.qos_profile.reliability == _BEST_EFFORT for item in publishers
            ):
                problems.append(
                    f'{topic} is published best-effort; set the parameter '
                    f'qos_overrides.{self._full_names[topic]}.subscription.reliability to '
                    'best_effort'
                )
        return '; '.join(problems)

    def _publishers(self, topic: str) -> list[TopicEndpointInfo]:
        return self._node.get_publishers_info_by_topic(self._full_names[topic])

    def _inspect_publishers(self) -> None:
        """Subscribe where that is possible now, and report what is wrong with the others."""
        for topic in self._full_names:
            types = {publisher.topic_type for publisher in self._publishers(topic)}
            try:
                self._subscribe_to_readable(topic, types)
                fault = self._fault(topic, types)
            except OccError as error:
                fault = str(error)
            if not fault:
                self._faults.pop(topic, None)
                continue
            self._faults[topic] = fault
            if fault not in self._reported:
                self._reported.add(fault)
                self._node.get_logger().error(fault)
        is_settled = len(self._subscriptions) == len(self._full_names) and not self._faults
        if is_settled != self._is_settled:
            self._is_settled = is_settled
            self._node.destroy_timer(self._timer)
            seconds = _SETTLED_SECONDS if is_settled else _INSPECT_SECONDS
            self._timer = self._node.steady_timer(seconds, self._inspect_publishers)

    def _subscribe_to_readable(self, topic: str, types: set[str]) -> None:
        """Subscribe to a type of the topic that can be read, unless that is so."""
        if topic in self._tables:
            return
        known, subscription = self._subscriptions.get(topic, ('', None))
        readable = sorted(item for item in types if not self._reason(topic, item))
        if not readable or known in readable:
            return
        if subscription is None:
            self._subscribe(topic, readable[0], SENSORS)
        else:
            # The middleware accepts the other type only once this subscription is gone: next time.
            del self._subscriptions[topic]
            self._node.destroy_subscription(subscription)

    def _fault(self, topic: str, types: set[str]) -> str:
        """Return that a topic has publishers, but none of a type that can be read; else nothing."""
        if not types or any(not self._reason(topic, item) for item in types):
            return ''
        first = min(types)
        return f'{topic} is published as {first}; {self._reason(topic, first)}'

    def _reason(self, topic: str, msgtype: str) -> str:
        """Return why messages of this type cannot be read, or nothing."""
        if topic in self._tables:
            return '' if msgtype == _TABLE else f'allowed is {_TABLE}'
        key = topic, msgtype
        if key not in self._reasons:
            self._reasons[key] = ''
            try:
                message = message_class(msgtype)()
                for field in self._fields[topic]:
                    field.check_type(message)
            except OccError as error:
                self._reasons[key] = str(error)
        return self._reasons[key]

    def _subscribe(self, topic: str, msgtype: str, qos: QoSProfile) -> None:
        def on_message(message: Any, published_ns: int = 0) -> None:
            if not self._closed:
                self._callback(topic, message, published_ns)

        is_table, message_type = topic in self._tables, message_class(msgtype)
        for other in self._node.subscriptions:
            if other.topic_name == self._full_names[topic] and other.msg_type is not message_type:
                raise ConfigurationError(
                    f'topic {topic!r} is to be read as {msgtype}, but this node reads it as '
                    f'{other.msg_type.__module__.partition(".")[0]}/msg/{other.msg_type.__name__}; '
                    'allowed is one type at a time'
                )
        try:
            subscription = self._node.create_subscription(
                message_type,
                topic,
                table_callback(self._node, topic, on_message)
                if is_table
                else with_source_time(on_message),
                qos,
                raw=is_table,
                event_callbacks=no_events(),
                qos_overriding_options=overridable(),
            )
        # What the layers below rclpy refuse has no common type.
        except (RuntimeError, TypeError, ValueError) as error:
            raise ConfigurationError(
                f'cannot subscribe to {topic!r} as {msgtype}: {one_line(error)}'
            ) from error
        self._subscriptions[topic] = msgtype, subscription
