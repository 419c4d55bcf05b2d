# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to topics as they appear, to serialized messages of any type."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.nodes.bag_topics import profile_to_record
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import no_events
from occ_constraints_pkg.ros.rclpy_internals import RCLError
from occ_constraints_pkg.rosbag.definitions import find_definition
from occ_constraints_pkg.rosbag.qos import from_profile
from occ_constraints_pkg.rosbag.ring import LiveTopic

INSPECT_SECONDS = 0.1
"""How often to call :meth:`FoundTopics.inspect`."""
# Of these, so much is for topics and the rest for messages: thousands of subscriptions take long.
_INSPECT_SHARE_SECONDS = 0.04


@dataclass(eq=False)
class FoundTopic(LiveTopic):
    """A topic that somebody publishes.

    Attributes:
        subscription: ours; None as long as there can be none.
    """

    subscription: Subscription | None = None


class FoundTopics:
    """Subscribes to topics as they appear, and more modestly where a new publisher offers less.

    Attributes:
        found: the topics so far, by name.

    Args:
        node: knows which topics there are, and logs what cannot be subscribed to.
        wanted: tells of a topic's full name whether it is to be subscribed to.
        receive: returns for a topic what is called with each serialized message and with what the
            middleware knows of it.
        subscriber: the node that subscribes, where it is not ``node``.
        leave: is called before a subscription is given up for another one; what waits on it is
            lost then.
    """

    def __init__(
        self,
        node: OccNode,
        wanted: Callable[[str], bool],
        receive: Callable[[FoundTopic], Callable[..., None]],
        subscriber: Node | None = None,
        leave: Callable[[FoundTopic], None] | None = None,
    ) -> None:
        self.found: dict[str, FoundTopic] = {}
        self._node, self._wanted, self._receive = node, wanted, receive
        self._subscriber = subscriber or node
        self._leave = leave
        self._inspecting: Iterator[None] | None = None
        # The first look-up takes half a second, in which messages would pile up.
        find_definition('std_msgs/msg/Empty')

    def inspect(self) -> None:
        """Go on looking for topics and publishers, for a share of the time."""
        end = self._node.steady_seconds() + _INSPECT_SHARE_SECONDS
        self._inspecting = self._inspecting or self._each_topic()
        for _ in self._inspecting:
            if self._node.steady_seconds() > end:
                return
        self._inspecting = None

    def _each_topic(self) -> Iterator[None]:
        """Subscribe to new topics, and again where publishers have come or gone.

        Yields after each topic, the new ones first.
        """
        names = [name for name, _ in self._node.get_topic_names_and_types() if self._wanted(name)]
        for name in sorted(names, key=self.found.__contains__):
            known = self.found.get(name)
            if known is None or len(known.offered) != self._node.count_publishers(name):
                self._inspect(name, known)
            yield

    def _inspect(self, name: str, known: FoundTopic | None) -> None:
        publishers = self._node.get_publishers_info_by_topic(name)
        if not publishers:
            return
        if known is None:
            known = self.found[name] = FoundTopic(name, publishers[0].topic_type)
        profiles = [publisher.qos_profile for publisher in publishers]
        known.offered = [from_profile(profile) for profile in profiles]
        self._subscribe(known, profiles)

    def _subscribe(self, topic: FoundTopic, offered: list[QoSProfile]) -> None:
        before = topic.subscription
        profile = profile_to_record(offered, None if before is None else before.qos_profile)
        if before is not None and before.qos_profile == profile:
            return
        try:
            kind = message_class(topic.msgtype)
        except OccError as error:
            self._node.get_logger().warning(f'topic {topic.name} is not recorded: {error}')
            return
        # Kept once found, so that no message waits for it.
        find_definition(topic.msgtype)
        if before is not None:
            if self._leave is not None:
                self._leave(topic)
            topic.subscription = None
            self._subscriber.destroy_subscription(before)
        try:
            topic.subscription = self._subscriber.create_subscription(
                kind,
                topic.name,
                self._receive(topic),
                profile,
                raw=True,
                event_callbacks=no_events(),
            )
        except RCLError:
            # The middleware allows one type for each topic of a process.
            self._node.get_logger().warning(
                f'topic {topic.name} is not recorded: it has type {topic.msgtype!r}; allowed is '
                'the type that this node itself publishes there'
            )
