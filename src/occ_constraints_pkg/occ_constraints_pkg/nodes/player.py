# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``player``: publishes the messages of a recording, byte for byte."""

from __future__ import annotations

from collections.abc import Iterator

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from occ_constraints_pkg.bags.recording import RawMessage, Recording, TopicInfo
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.messages import message_class
from occ_constraints_pkg.ros.process import OccNode, run_node
from occ_constraints_pkg.ros.qos import SETTLED_LOOKS

_LOOK_SECONDS = 0.05
_DEPTH = 1000
# Messages published in one go when the player is behind, before other callbacks get a turn.
_BURST = 100


class Player(OccNode):
    """Keeps the recorded spacing in time, scaled by ``rate``."""

    def __init__(self) -> None:
        super().__init__('player')
        bag = self.parameter('bag', '', 'rosbag2 directory or .mcap file')
        topics = self.parameter('topics', [], 'topics to play; none: all')
        self._rate = self.parameter('rate', 1.0, 'speed, 1.0: as recorded', low=0.001)
        self._loop = self.parameter('loop', False, 'start again at the end')
        self._wanted = self.parameter(
            'wait_for_subscribers', 0, 'subscriptions over all topics before the start', low=0
        )
        if not bag:
            raise OccError("parameter 'bag' of node 'player' is missing; give a recording")
        self._recording = Recording(bag)
        for warning in self._recording.warnings:
            self.get_logger().warning(warning)
        chosen = [self._recording.find(topic) for topic in topics]
        self._publishers_of = {
            topic: self._publisher(topic, self._recording.topics[topic])
            for topic in chosen or self._playable()
        }
        self._messages: Iterator[RawMessage] = iter(())
        self._next: RawMessage | None = None
        self._offset: float | None = None
        self._looks = 0
        self._timer = self.steady_timer(_LOOK_SECONDS, self._begin)

    def _playable(self) -> list[str]:
        """Return the topics whose types are installed; warn of the others."""
        playable = []
        for topic, info in self._recording.topics.items():
            try:
                message_class(info.msgtype)
                playable.append(topic)
            except OccError as error:
                self.get_logger().warning(f'topic {topic} is not played: {error}')
        if not playable:
            raise OccError(f'{self._recording.path} has no topic whose message type is installed')
        return playable

    def _publisher(self, topic: str, info: TopicInfo) -> Publisher:
        """Offer what suits every subscriber that one of the recorded publishers suited.

        Latched messages all stay available, for several publishers may have latched one each.
        """
        best_effort = info.offered_qos and all(
            offered.get('reliability') == 'best_effort' for offered in info.offered_qos
        )
        latched = any(
            offered.get('durability') == 'transient_local' for offered in info.offered_qos
        )
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=(
                ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
            ),
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
        )
        return self.create_publisher(message_class(info.msgtype), topic, profile)

    def _begin(self) -> None:
        subscribers = sum(
            publisher.get_subscription_count() for publisher in self._publishers_of.values()
        )
        if subscribers < self._wanted:
            self._looks = 0
            return
        self._looks += 1
        if self._wanted and self._looks < SETTLED_LOOKS:
            return
        self.destroy_timer(self._timer)
        self._rewind()
        self._timer = self.steady_timer(0.001, self._play)

    def _rewind(self) -> None:
        self._messages = self._recording.messages(self._publishers_of)
        self._next = next(self._messages, None)
        self._offset = None

    def _play(self) -> None:
        """Publish what is due."""
        now = self.steady_seconds()
        for _ in range(_BURST):
            if self._next is None:
                self._end()
                return
            recorded = self._next.log_time_ns * 1e-9 / self._rate
            if self._offset is None:
                self._offset = now - recorded
            if recorded + self._offset > now:
                return
            self._publishers_of[self._next.topic].publish(bytes(self._next.data))
            self._next = next(self._messages, None)

    def _end(self) -> None:
        if self._loop:
            self._rewind()
            return
        self._timer.cancel()
        self.get_logger().info('the recording is over')
        self.finish()

    def close(self) -> None:
        """Let the last messages leave before the publishers go."""
        self.let_leave(*self._publishers_of.values())


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Player, argv)
