# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``recorder``: writes live topics to a rosbag2 directory (MCAP)."""

from __future__ import annotations

import time
from dataclasses import dataclass

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from occ_constraints_pkg.bags.definitions import find_definition
from occ_constraints_pkg.bags.qos import from_profile
from occ_constraints_pkg.bags.writer import BagWriter
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.process import OccNode, run_node
from occ_constraints_pkg.ros.qos import no_events

_LOOK_SECONDS = 0.1
_FLUSH_SECONDS = 0.5
_DEPTH = 1000


@dataclass
class _Recorded:
    """A topic that is recorded: its type, how many publish it, and our subscription."""

    msgtype: str
    publishers: int = 0
    subscription: Subscription | None = None


class Recorder(OccNode):
    """Subscribes to topics as they appear and writes their serialized messages unchanged."""

    def __init__(self) -> None:
        super().__init__('recorder')
        output = self.parameter('output', '', 'directory of the new bag; must not exist yet')
        wanted = self.parameter('topics', [], 'topics to record; none: all that are published')
        compression = self.parameter('compression', 'zstd', 'zstd, lz4 or none')
        if not output:
            raise OccError(
                "parameter 'output' of node 'recorder' is missing; "
                'give the directory of the new bag'
            )
        self._wanted = {self.full_name(topic) for topic in wanted}
        self._recorded: dict[str, _Recorded] = {}
        self._writer = BagWriter(output, compression=compression)
        self.steady_timer(_LOOK_SECONDS, self._look)
        self.steady_timer(_FLUSH_SECONDS, self._writer.flush)
        names = ', '.join(sorted(self._wanted)) or 'all topics'
        self.get_logger().info(f'recording {names} to {output}')

    def close(self) -> None:
        """End the bag."""
        self._writer.close()
        self.get_logger().info(f'{self._writer.message_count} messages recorded')

    def _look(self) -> None:
        """Subscribe to new topics, and more modestly where a new publisher offers less."""
        for topic, _ in self.get_topic_names_and_types():
            if self._wanted and topic not in self._wanted:
                continue
            known = self._recorded.get(topic)
            if known is not None and known.publishers == self.count_publishers(topic):
                continue
            publishers = self.get_publishers_info_by_topic(topic)
            if not publishers:
                continue
            if known is None:
                known = self._recorded[topic] = _Recorded(publishers[0].topic_type)
            known.publishers = len(publishers)
            self._subscribe(topic, known, [publisher.qos_profile for publisher in publishers])

    def _subscribe(self, topic: str, known: _Recorded, offered: list[QoSProfile]) -> None:
        """Ask for what every publisher offers: reliable or latched only when all of them are."""
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
        before = known.subscription
        if before is not None:
            # Never more than before: that would fetch latched messages a second time.
            reliable &= before.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            latched &= before.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=(ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT),
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
        )
        if before is not None and before.qos_profile == profile:
            return
        try:
            kind = message_class(known.msgtype)
        except OccError as error:
            self.get_logger().warning(f'topic {topic} is not recorded: {error}')
            return
        # Kept once found. The first look-up takes half a second, in which messages would pile up.
        find_definition(known.msgtype)
        entries = [from_profile(item) for item in offered]

        def write(data: bytes) -> None:
            self._writer.write(topic, known.msgtype, data, time.time_ns(), qos=entries)

        if before is not None:
            self.destroy_subscription(before)
        known.subscription = self.create_subscription(
            kind, topic, write, profile, raw=True, event_callbacks=no_events()
        )


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Recorder, argv)
