# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``recorder``: writes live topics to a rosbag2 directory (MCAP)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.nodes.bag_topics import topic_filter
from occ_constraints_pkg.nodes.found_topics import INSPECT_SECONDS, FoundTopic, FoundTopics
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.rosbag.writer import FLUSH_SECONDS, BagWriter
from occ_constraints_pkg.wording import count_of

# A topic that was asked for and that nobody publishes by then may be misspelled.
_PATIENCE_SECONDS = 5.0
# What every node publishes from its start: no sign that there is something to record.
_OF_ROS = ('/rosout', '/parameter_events')


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
        self._writer = BagWriter(
            output,
            compression=compression,
            max_file_bytes=max_bytes,
            max_file_seconds=max_seconds,
        )
        self._has_begun = False
        self._topics = FoundTopics(self, self._filter.allows, self._write_to)
        self.steady_timer(INSPECT_SECONDS, self._topics.inspect)
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
        missing = sorted(set(self._filter.names) - self._topics.found.keys())
        if missing:
            self.get_logger().warning(f'nobody has published {", ".join(missing)} so far')

    def _write_to(self, topic: FoundTopic) -> Callable[[bytes, Mapping[str, int]], None]:
        def write(data: bytes, info: Mapping[str, int]) -> None:
            if not self._has_begun and topic.name not in _OF_ROS:
                self._begin_duration()
            self._writer.write(
                topic.name, topic.msgtype, data, self._arrival_ns(info), qos=topic.offered
            )

        return write

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
