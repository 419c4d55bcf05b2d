# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``player``: publishes the messages of a recording, byte for byte."""

from __future__ import annotations

from itertools import islice
from typing import Any

from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.nodes.bag_topics import profile_to_play, topic_filter
from occ_constraints_pkg.ros.messages import message_class, to_time
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import SETTLED_CHECKS
from occ_constraints_pkg.ros.rclpy_internals import RCLError
from occ_constraints_pkg.rosbag.playback import Playback, is_latched
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.wording import count_of

_CHECK_SECONDS = 0.05
_PLAY_SECONDS = 0.001
# Messages published in one go when the player is behind, before other callbacks get a turn.
_BURST = 100
# How long subscribers may take, on a busy machine, to get all of a recording that has been played.
_FLUSH_SECONDS = 10.0
_CLOCK = '/clock'


class Player(OccNode):
    """Keeps the recorded spacing in time, scaled by ``rate``."""

    def __init__(self) -> None:
        super().__init__('player')
        bag = self.parameter('bag', '', 'rosbag2 directory, .mcap or .db3 file')
        chosen = topic_filter(self, 'play')
        rate = self.parameter('rate', 1.0, 'speed, 1.0: as recorded', low=0.001)
        loop = self.parameter('loop', False, 'start again at the end')
        offset = self.parameter(
            'start_offset', 0.0, 'seconds of the recording to leave out', low=0.0
        )
        self._clock_rate = self.parameter(
            'clock', 0.0, 'messages per second on /clock; 0: none', low=0.0, high=1000.0
        )
        self._starts_paused = self.parameter('start_paused', False, 'wait for ~/resume')
        self._wanted = self.parameter(
            'wait_for_subscribers', 0, 'subscriptions over all topics before the start', low=0
        )
        self.declared()
        if not bag:
            raise ConfigurationError(
                "parameter 'bag' of node 'player' is missing; give a recording"
            )
        recording = Recording(bag)
        for warning in recording.warnings:
            self.get_logger().warning(warning)
        chosen = chosen.with_names(recording.find)
        topics = [topic for topic in recording.topics if chosen.allows(topic)]
        self._publishers_of = self._advertise(recording, topics)
        self._playback = Playback(
            recording, list(self._publishers_of), rate=rate, loop=loop, start_offset=offset
        )
        self._clock_publisher = (
            self.create_publisher(Clock, _CLOCK, 10) if self._clock_rate else None
        )
        for name, answer in (
            ('pause', self._on_pause),
            ('resume', self._on_resume),
            ('toggle_paused', self._on_toggle),
        ):
            self.create_service(Trigger, f'~/{name}', answer)
        self._settled_checks = 0
        self._timer = self.steady_timer(_CHECK_SECONDS, self._start)
        played = count_of(len(self._publishers_of), 'topic')
        self.get_logger().info(f'{played} of {bag}{self._waits_for()}')

    def _advertise(self, recording: Recording, topics: list[str]) -> dict[str, Publisher]:
        """Return a publisher for each topic whose type is installed; warn of the others."""
        publishers = {}
        for topic in topics:
            if topic == _CLOCK and self._clock_rate:
                self.get_logger().info('the recorded /clock is replaced by that of this player')
                continue
            info = recording.topics[topic]
            try:
                kind = message_class(info.msgtype)
                self.full_name(topic)
            except OccError as error:
                self.get_logger().warning(f'topic {topic} is not played: {error}')
                continue
            qos = profile_to_play(info.offered_qos, latched=is_latched(topic, info))
            try:
                publishers[topic] = self.create_publisher(kind, topic, qos)
            except RCLError:
                # The middleware allows one type for each topic of a process.
                self.get_logger().warning(
                    f'topic {topic} is not played: a message of type {info.msgtype!r} cannot be '
                    'published there; allowed is the type that this node itself publishes there'
                )
        if not publishers:
            raise ConfigurationError(
                f'{recording.path} has none of the topics to play whose message type is '
                f'installed; its topics are {", ".join(recording.topics)}'
            )
        return publishers

    def _waits_for(self) -> str:
        """Return what has to happen before anything is played."""
        waits = []
        if self._wanted:
            waits.append(f'{self._wanted} subscription{"s" if self._wanted > 1 else ""}')
        if self._starts_paused:
            waits.append(f'a call of {self.get_fully_qualified_name()}/resume')
        return f', waiting for {" and ".join(waits)}' if waits else ''

    def _start(self) -> None:
        subscribers = sum(
            publisher.get_subscription_count() for publisher in self._publishers_of.values()
        )
        if subscribers < self._wanted:
            self._settled_checks = 0
            return
        self._settled_checks += 1
        if self._wanted and self._settled_checks < SETTLED_CHECKS:
            return
        self.destroy_timer(self._timer)
        if not self._starts_paused:
            self._playback.resume(self.steady_seconds())
        if self._clock_publisher is not None:
            self._publish_clock()
            self.steady_timer(1.0 / self._clock_rate, self._publish_clock)
        self._timer = self.steady_timer(_PLAY_SECONDS, self._play)

    def _play(self) -> None:
        """Publish what is due."""
        for message in islice(self._playback.due(self.steady_seconds()), _BURST):
            self._publishers_of[message.topic].publish(bytes(message.data))
        if self._playback.is_over:
            self._timer.cancel()
            self.get_logger().info('the recording is over')
            self.finish()

    def _publish_clock(self) -> None:
        now = self._playback.time_ns(self.steady_seconds())
        self._clock_publisher.publish(Clock(clock=to_time(now)))

    def _on_pause(self, _request: Any, response: Any) -> Any:
        self._playback.pause(self.steady_seconds())
        response.success, response.message = True, 'paused'
        return response

    def _on_resume(self, _request: Any, response: Any) -> Any:
        self._playback.resume(self.steady_seconds())
        response.success, response.message = True, 'playing'
        return response

    def _on_toggle(self, request: Any, response: Any) -> Any:
        toggle = self._on_resume if self._playback.is_paused else self._on_pause
        return toggle(request, response)

    def close(self) -> None:
        """Let the last messages leave before the publishers go."""
        patience = _FLUSH_SECONDS if self._playback.is_over else 1.0
        self.flush(*self._publishers_of.values(), seconds=patience)


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Player, argv)
