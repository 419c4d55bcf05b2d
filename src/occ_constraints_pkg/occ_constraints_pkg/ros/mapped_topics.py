# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to the topics that a feature map names, whatever their types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from occ_constraints_pkg.bags.feature_map import FeatureMap
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.qos import SENSORS, STEPS, overridable

_LOOK_SECONDS = 0.2
_TABLE = 'sensor_msgs/msg/PointCloud2'


class MappedTopics:
    """Subscribes to each topic of a feature map.

    A topic read by column is a table and is subscribed to at once, reliably. The type of any
    other topic is learned from the graph, so the subscription comes when a publisher does.
    """

    def __init__(
        self, node: OccNode, feature_map: FeatureMap, callback: Callable[[str, Any], None]
    ) -> None:
        self._node = node
        self._callback = callback
        tables = {source.topic for source in feature_map.features if source.column is not None}
        self._subscriptions = []
        self._missing = []
        for topic in feature_map.topics:
            if topic in tables:
                self._subscribe(topic, _TABLE, STEPS)
            else:
                self._missing.append(topic)
        self._timer = node.steady_timer(_LOOK_SECONDS, self._look) if self._missing else None

    @property
    def missing(self) -> tuple[str, ...]:
        """Topics that nobody has published so far."""
        return tuple(self._missing)

    def close(self) -> None:
        """Drop all subscriptions."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _look(self) -> None:
        known = dict(self._node.get_topic_names_and_types())
        for topic in list(self._missing):
            types = known.get(self._node.resolve_topic_name(topic))
            if types:
                self._missing.remove(topic)
                self._subscribe(topic, types[0], SENSORS)
        if not self._missing:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def _subscribe(self, topic: str, msgtype: str, qos: Any) -> None:
        self._subscriptions.append(
            self._node.create_subscription(
                message_class(msgtype),
                topic,
                lambda message: self._callback(topic, message),
                qos,
                qos_overriding_options=overridable(),
            )
        )
