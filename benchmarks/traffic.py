# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Messages at a steady rate or as fast as they are answered, and how long each answer took."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.qos import SETTLED_CHECKS, STEPS
from occ_constraints_pkg.ros.tables import table_message
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2

# A serialized message begins with four bytes that name the encoding, then its header's stamp.
_STAMP = struct.Struct('<iI')
_STAMP_AT = 4
_MATCH_SECONDS = 30.0
_LOOK_SECONDS = 0.05
# So long nothing may come until what is missing counts as lost.
_SILENCE_SECONDS = 2.0


@dataclass(frozen=True, eq=False)
class Answers:
    """What came back in one phase.

    Attributes:
        sent: messages sent.
        lost: those that were not answered.
        twice: answers beyond the first of a message.
        latencies: (answered,) seconds from before publishing to the first answer.
        seconds: from the first message to the last answer.
    """

    sent: int
    lost: int
    twice: int
    latencies: np.ndarray
    seconds: float

    @property
    def rate(self) -> float:
        """Answers per second."""
        return len(self.latencies) / self.seconds


def serialized(tables: Sequence[Table]) -> list[bytes]:
    """Return tables as messages that can be sent."""
    return [serialize_message(table_message(table, 0)) for table in tables]


class Traffic:
    """Sends tables to one node and takes its answers.

    Messages are serialized beforehand and answers are left serialized, so that this side takes
    little time. An answer belongs to the message with the same stamp.

    Attributes:
        total_sent: messages sent in all phases.

    Args:
        context: a ROS context.
        namespace: of the node, which subscribes to ``observation`` and publishes ``costs``.
    """

    def __init__(self, context: Context, namespace: str) -> None:
        self._node = Node('traffic', namespace=namespace, context=context)
        self._publisher = self._node.create_publisher(PointCloud2, 'observation', STEPS)
        self._node.create_subscription(PointCloud2, 'costs', self._on_answer, STEPS, raw=True)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._executor = EventsExecutor(context=context)
        self._executor.add_node(self._node)
        self._last_stamp = 0
        self.total_sent = 0
        self._begin([], 0, 0)

    @property
    def node(self) -> Node:
        """The node, for further subscriptions."""
        return self._node

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()

    def spin(self, seconds: float) -> None:
        """Let callbacks run for a while."""
        self._executor.spin_until_future_complete(Future(), seconds)

    def wait_for_node(self) -> None:
        """Wait until the node is there in both directions.

        Raises:
            OccError: it does not come.
        """
        end, settled = time.monotonic() + _MATCH_SECONDS, 0
        while settled < SETTLED_CHECKS:
            there = self._publisher.get_subscription_count() and self._node.count_publishers(
                f'{self._node.get_namespace()}/costs'
            )
            settled = settled + 1 if there else 0
            if time.monotonic() > end:
                raise OccError(
                    f'no node came to {self._node.get_namespace()} in {_MATCH_SECONDS} s'
                )
            self.spin(_LOOK_SECONDS)

    def steadily(self, messages: Sequence[bytes], rate: float, seconds: float) -> Answers:
        """Send messages by turns at a rate, whatever is answered."""
        self._begin(messages, max(1, round(rate * seconds)), 0)
        timer = self._node.create_timer(1.0 / rate, self._send, clock=self._steady)
        answers = self._finish()
        self._node.destroy_timer(timer)
        return answers

    def fast(self, messages: Sequence[bytes], count: int, outstanding: int) -> Answers:
        """Send messages by turns, the next whenever one is answered.

        Args:
            messages: serialized, see :func:`serialized`.
            count: messages in all.
            outstanding: messages under way, fewer than queues hold.
        """
        self._begin(messages, count, outstanding)
        for _ in range(min(outstanding, count)):
            self._send()
        return self._finish()

    def _begin(self, messages: Sequence[bytes], count: int, outstanding: int) -> None:
        self._messages = [bytearray(message) for message in messages]
        self._count, self._outstanding = count, outstanding
        self._sent: dict[int, float] = {}
        self._took: dict[int, float] = {}
        self._twice, self._last = 0, time.perf_counter()
        self._done = Future()

    def _finish(self) -> Answers:
        begin, seen = self._last, -1
        while not self._done.done() and seen != len(self._took) + len(self._sent):
            seen = len(self._took) + len(self._sent)
            self._executor.spin_until_future_complete(self._done, _SILENCE_SECONDS)
        # Second answers come right after the first.
        self.spin(_LOOK_SECONDS)
        self.total_sent += len(self._sent)
        return Answers(
            len(self._sent),
            len(self._sent) - len(self._took),
            self._twice,
            np.fromiter(self._took.values(), dtype=np.float64),
            self._last - begin,
        )

    def _send(self) -> None:
        number = len(self._sent)
        if number >= self._count:
            return
        message = self._messages[number % len(self._messages)]
        stamp = self._last_stamp = max(time.time_ns(), self._last_stamp + 1)
        _STAMP.pack_into(message, _STAMP_AT, *divmod(stamp, 1_000_000_000))
        self._sent[stamp] = time.perf_counter()
        self._publisher.publish(bytes(message))

    def _on_answer(self, message: bytes) -> None:
        now = time.perf_counter()
        seconds, rest = _STAMP.unpack_from(message, _STAMP_AT)
        stamp = seconds * 1_000_000_000 + rest
        if stamp not in self._sent:
            return
        if stamp in self._took:
            self._twice += 1
            return
        self._took[stamp], self._last = now - self._sent[stamp], now
        if len(self._took) == self._count:
            self._done.set_result(None)
        elif self._outstanding:
            self._send()
