# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``recorder``: writes live topics to a rosbag2 directory (MCAP)."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from occ_constraints_pkg.bags.qos import from_profile
from occ_constraints_pkg.bags.writer import BagWriter
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.process import OccNode, run_node

_LOOK_SECONDS = 0.1
_FLUSH_SECONDS = 0.5
_DEPTH = 1000


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
        self._wanted = {self.resolve_topic_name(topic) for topic in wanted}
        self._subscribed: set[str] = set()
        self._writer = BagWriter(output, compression=compression)
        self.steady_timer(_LOOK_SECONDS, self._look)
        self.steady_timer(_FLUSH_SECONDS, self._writer.flush)
        # Types of wanted topics that nobody publishes yet are not known: look from now on.
        self._look()
        names = ', '.join(sorted(self._wanted)) or 'all topics'
        self.get_logger().info(f'recording {names} to {output}')

    def close(self) -> None:
        """End the bag."""
        self._writer.close()
        self.get_logger().info(f'{self._writer.message_count} messages recorded')

    def _look(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            if topic in self._subscribed or (self._wanted and topic not in self._wanted):
                continue
            offered = self.get_publishers_info_by_topic(topic)
            if not offered:
                continue
            self._subscribed.add(topic)
            try:
                kind = message_class(types[0])
            except OccError as error:
                self.get_logger().warning(f'topic {topic} is not recorded: {error}')
                continue
            self._subscribe(topic, types[0], kind, [info.qos_profile for info in offered])

    def _subscribe(self, topic: str, msgtype: str, kind: Any, offered: list[QoSProfile]) -> None:
        """Ask for what every publisher offers: reliable or latched only when all of them are."""
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=(ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT),
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
        )
        entries = [from_profile(item) for item in offered]
        self.create_subscription(
            kind,
            topic,
            lambda data: self._writer.write(topic, msgtype, data, time.time_ns(), qos=entries),
            profile,
            raw=True,
        )


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Recorder, argv)
