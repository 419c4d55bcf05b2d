# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to the topics that a feature map names, whatever their types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from occ_constraints_pkg.bags.feature_map import FeatureMap
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.qos import SENSORS, STEPS, no_events, overridable
from occ_constraints_pkg.ros.table_topics import reading

_LOOK_SECONDS = 0.2
_BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT
_TABLE = 'sensor_msgs/msg/PointCloud2'


class MappedTopics:
    """Subscribes to each topic of a feature map.

    A topic read by column is a table and is subscribed to at once, reliably. The type of any
    other topic is that of its first publisher, so the subscription comes when a publisher does.

    Args:
        node: subscribes.
        feature_map: names the topics.
        callback: called with the topic as the map writes it, and the message, or the
            :class:`TableMessage` of a table; not after :meth:`close`, though messages may still
            be under way.

    Raises:
        OccError: a topic's name is not valid.
    """

    def __init__(
        self, node: OccNode, feature_map: FeatureMap, callback: Callable[[str, Any], None]
    ) -> None:
        self._node = node
        self._callback = callback
        self._closed = False
        self._full_names = {topic: node.full_name(topic) for topic in feature_map.topics}
        self._tables = feature_map.table_topics
        self._subscriptions = []
        self._awaited = [topic for topic in feature_map.topics if topic not in self._tables]
        for topic in self._tables:
            self._subscribe(topic, _TABLE, STEPS)
        self._timer = node.steady_timer(_LOOK_SECONDS, self._look) if self._awaited else None

    def close(self) -> None:
        """Drop all subscriptions."""
        self._closed = True
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def problem(self) -> str:
        """Say which topics cannot be heard: unpublished, of a wrong type, offered too little."""
        problems = []
        for topic in self._full_names:
            publishers = self._publishers(topic)
            if not publishers:
                problems.append(f'nobody publishes {topic}')
            elif topic in self._tables:
                types = {publisher.topic_type for publisher in publishers}
                if types != {_TABLE}:
                    problems.append(f'{topic} is published as {min(types)}; allowed is {_TABLE}')
                elif all(item.qos_profile.reliability == _BEST_EFFORT for item in publishers):
                    problems.append(
                        f'{topic} is published best-effort; set the parameter '
                        f'qos_overrides.{self._full_names[topic]}.subscription.reliability to '
                        'best_effort'
                    )
        return '; '.join(problems)

    def _publishers(self, topic: str) -> list[TopicEndpointInfo]:
        return self._node.get_publishers_info_by_topic(self._full_names[topic])

    def _look(self) -> None:
        for topic in list(self._awaited):
            publishers = self._publishers(topic)
            if publishers:
                self._awaited.remove(topic)
                try:
                    self._subscribe(topic, publishers[0].topic_type, SENSORS)
                except OccError as error:
                    self._node.get_logger().error(f'topic {topic} cannot be read: {error}')
        if not self._awaited:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def _subscribe(self, topic: str, msgtype: str, qos: QoSProfile) -> None:
        def on_message(message: Any) -> None:
            if not self._closed:
                self._callback(topic, message)

        is_table = topic in self._tables
        self._subscriptions.append(
            self._node.create_subscription(
                message_class(msgtype),
                topic,
                reading(self._node, topic, on_message) if is_table else on_message,
                qos,
                raw=is_table,
                event_callbacks=no_events(),
                qos_overriding_options=overridable(),
            )
        )
