# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``recorder``: writes live topics to a rosbag2 directory (MCAP)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.nodes.bag_topics import profile_to_record, topic_filter
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import no_events
from occ_constraints_pkg.ros.rclpy_internals import RCLError
from occ_constraints_pkg.rosbag.definitions import find_definition
from occ_constraints_pkg.rosbag.qos import from_profile
from occ_constraints_pkg.rosbag.writer import FLUSH_SECONDS, BagWriter
from occ_constraints_pkg.wording import count_of

_INSPECT_SECONDS = 0.1
# Of these, so much is for topics and the rest for messages: thousands of subscriptions take long.
_INSPECT_SHARE_SECONDS = 0.04
# A topic that was asked for and that nobody publishes by then may be misspelled.
_PATIENCE_SECONDS = 5.0
# What every node publishes from its start: no sign that there is something to record.
_OF_ROS = ('/rosout', '/parameter_events')


@dataclass
class _Recorded:
    """A topic that is recorded: its type, what its publishers offer, and our subscription."""

    msgtype: str
    offered: list[dict[str, Any]] = field(default_factory=list)
    subscription: Subscription | None = None


class Recorder(OccNode):
    """Subscribes to topics as they appear and writes their serialized messages unchanged."""

    drain_on_shutdown = True

    def __init__(self) -> None:
        super().__init__('recorder')
        output = self.parameter('output', '', 'directory of the new bag; must not exist yet')
        self._filter = topic_filter(self, 'record').with_names(self.full_name)
        compression = self.parameter('compression', 'zstd', 'zstd, lz4 or none')
        max_bytes = self.parameter(
            'max_bag_size', 0, 'bytes after which a new file is begun; 0: never', low=0
        )
        max_seconds = self.parameter(
            'max_bag_duration', 0.0, 'seconds after which a new file is begun; 0: never', low=0.0
        )
        self._seconds = self.parameter(
            'duration', 0.0, 'seconds from the first message after which it ends; 0: never', low=0.0
        )
        self.declared()
        if not output:
            raise ConfigurationError(
                "parameter 'output' of node 'recorder' is missing; "
                'give the directory of the new bag'
            )
        self._recorded: dict[str, _Recorded] = {}
        self._writer = BagWriter(
            output,
            compression=compression,
            max_file_bytes=max_bytes,
            max_file_seconds=max_seconds,
        )
        # The first look-up takes half a second, in which messages would pile up.
        find_definition('std_msgs/msg/Empty')
        self._inspecting: Iterator[None] | None = None
        self._has_begun = False
        self.steady_timer(_INSPECT_SECONDS, self._inspect_topics)
        self.steady_timer(FLUSH_SECONDS, self._writer.flush)
        self._patience_timer = self.steady_timer(_PATIENCE_SECONDS, self._report_missing)
        self.get_logger().info(f'recording {self._filter} to {output}')

    def close(self) -> None:
        """End the bag."""
        self._writer.close()
        self._report_missing()
        count, files = self._writer.message_count, len(self._writer.paths)
        self.get_logger().info(
            f'{count_of(count, "message")} recorded' + (f' in {files} files' if files > 1 else '')
        )

    def _report_missing(self) -> None:
        """Name the topics that were asked for and that nobody has published."""
        self._patience_timer.cancel()
        missing = sorted(set(self._filter.names) - self._recorded.keys())
        if missing:
            self.get_logger().warning(f'nobody has published {", ".join(missing)} so far')

    def _inspect_topics(self) -> None:
        """Go on inspecting the topics, for a share of the time."""
        end = self.steady_seconds() + _INSPECT_SHARE_SECONDS
        self._inspecting = self._inspecting or self._each_topic()
        for _ in self._inspecting:
            if self.steady_seconds() > end:
                return
        self._inspecting = None

    def _each_topic(self) -> Iterator[None]:
        """Subscribe to new topics, and more modestly where a new publisher offers less.

        Yields after each topic, the new ones first.
        """
        allowed = [
            topic for topic, _ in self.get_topic_names_and_types() if self._filter.allows(topic)
        ]
        for topic in sorted(allowed, key=self._recorded.__contains__):
            known = self._recorded.get(topic)
            if known is None or len(known.offered) != self.count_publishers(topic):
                self._inspect(topic, known)
            yield

    def _inspect(self, topic: str, known: _Recorded | None) -> None:
        publishers = self.get_publishers_info_by_topic(topic)
        if not publishers:
            return
        if known is None:
            known = self._recorded[topic] = _Recorded(publishers[0].topic_type)
        profiles = [publisher.qos_profile for publisher in publishers]
        known.offered = [from_profile(profile) for profile in profiles]
        self._subscribe(topic, known, profiles)

    def _subscribe(self, topic: str, known: _Recorded, offered: list[QoSProfile]) -> None:
        before = known.subscription
        profile = profile_to_record(offered, None if before is None else before.qos_profile)
        if before is not None and before.qos_profile == profile:
            return
        try:
            kind = message_class(known.msgtype)
        except OccError as error:
            self.get_logger().warning(f'topic {topic} is not recorded: {error}')
            return
        # Kept once found, so that no message waits for it.
        find_definition(known.msgtype)

        def write(data: bytes, info: Mapping[str, int]) -> None:
            if not self._has_begun and topic not in _OF_ROS:
                self._begin_duration()
            self._writer.write(
                topic, known.msgtype, data, self._arrival_ns(info), qos=known.offered
            )

        if before is not None:
            self.destroy_subscription(before)
        try:
            known.subscription = self.create_subscription(
                kind, topic, write, profile, raw=True, event_callbacks=no_events()
            )
        except RCLError:
            # The middleware allows one type for each topic of a process.
            self.get_logger().warning(
                f'topic {topic} is not recorded: it has type {known.msgtype!r}; allowed is the '
                'type that this node itself publishes there'
            )

    def _begin_duration(self) -> None:
        """End in time, counted from the first message: starts take longer on some machines."""
        self._has_begun = True
        if self._seconds:
            self.steady_timer(self._seconds, self._end_in_time)

    def _end_in_time(self) -> None:
        self.get_logger().info(f'ending, {self._seconds:g} s after the first message')
        self.finish()

    def _arrival_ns(self, info: Mapping[str, int]) -> int:
        """Return when a message arrived, which may be long before it is its turn to be written.

        With use_sim_time it is the time of /clock, as bags of a simulation have it: the messages
        of the clock wait in the same queue, so they are as late.
        """
        clock = self.get_clock()
        # Not every middleware reports the time.
        if clock.ros_time_is_active or not info['received_timestamp']:
            return clock.now().nanoseconds
        return info['received_timestamp']


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Recorder, argv)
