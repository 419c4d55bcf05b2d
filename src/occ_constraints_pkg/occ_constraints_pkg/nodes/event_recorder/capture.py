# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Takes the messages of chosen topics from the middleware, serialized, some fifty times a second.

An executor would wake Python for each message, which takes the events executor half as much time
again, and an ordinary one four times as much (``docs/speed.md``). The middleware notes when a
message arrived, so its log time is none the worse.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from operator import itemgetter

from rclpy.node import Node

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.nodes.found_topics import INSPECT_SECONDS, FoundTopic, FoundTopics
from occ_constraints_pkg.ros.node import OccNode, refusal_of
from occ_constraints_pkg.ros.rclpy_internals import RCLError, take
from occ_constraints_pkg.rosbag.ring import Batch, Message

LOOK_SECONDS = 0.02
"""How often the topics are looked at; of each, a thousand messages may wait."""
# A simulation that is so many times faster than time has had its clock set.
_FASTEST = 1000
# No topic keeps the others waiting for ever.
_MOST_AT_ONCE = 5000


class Capture:
    """A thread that subscribes to topics as they appear and hands their messages over in batches.

    Args:
        node: tells which topics there are, logs, and ends its process where ROS refuses.
        wanted: tells of a topic's full name whether it is to be captured.
        receive: gets each batch, also an empty one, in this thread.
    """

    def __init__(
        self, node: OccNode, wanted: Callable[[str], bool], receive: Callable[[Batch], None]
    ) -> None:
        self._node, self._receive = node, receive
        # Not spun, so that no executor takes a message. By its name, tools do not list it.
        self._subscriber = Node(
            f'_{node.get_name()}_capture',
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._topics = FoundTopics(
            node, wanted, lambda topic: _nothing, subscriber=self._subscriber, leave=self._leave
        )
        self._left: list[tuple[Message, int]] = []
        # What the system's clock and that of ROS said at the last look.
        self._last_look = (0, 0)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='capture', daemon=True)

    @property
    def topics(self) -> frozenset[str]:
        """Full names of the topics that are captured."""
        return frozenset(name for name, one in self._topics.found.items() if one.subscription)

    def start(self) -> None:
        """Begin to capture."""
        self._thread.start()

    def close(self) -> None:
        """Take what has come and end."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        self._subscriber.destroy_node()

    def _run(self) -> None:
        try:
            inspect_at = 0.0
            while not self._stopping.wait(LOOK_SECONDS):
                self._take_all()
                if (now := time.monotonic()) >= inspect_at:
                    inspect_at = now + INSPECT_SECONDS
                    self._topics.inspect()
            self._take_all()
        except (OccError, OSError) as error:
            self._node.fail(error)
        except RCLError as error:
            # Where the process ends, ROS may refuse anything.
            if not self._stopping.is_set():
                self._node.fail(refusal_of(error))

    def _take_all(self) -> None:
        now = time.monotonic()
        taken, self._left = self._left, []
        for topic in self._topics.found.values():
            if topic.subscription is not None:
                self._take(topic, taken)
        clock = self._node.get_clock()
        look = (time.time_ns(), self._node.ros_ns())
        if clock.ros_time_is_active:
            taken = [
                ((topic, ros_time(arrived, self._last_look, look), 0, data), arrived)
                for (topic, _, _, data), arrived in taken
            ]
        self._last_look = look
        # By arrival, and in simulated time too, where all of a look may be at one moment.
        taken.sort(key=itemgetter(1))
        messages = [
            message if message[2] else (message[0], message[1], message[1], message[3])
            for message, _ in taken
        ]
        self._receive(Batch.of(now, messages))

    @staticmethod
    def _take(topic: FoundTopic, taken: list[tuple[Message, int]]) -> None:
        """Append what waits on a topic, each with its arrival by the system's clock."""
        for _ in range(_MOST_AT_ONCE):
            one = take(topic.subscription)
            if one is None:
                return
            data, info = one
            # Not every middleware knows the times.
            arrived = info['received_timestamp'] or time.time_ns()
            taken.append(((topic, arrived, info['source_timestamp'], data), arrived))

    def _leave(self, topic: FoundTopic) -> None:
        self._take(topic, self._left)


def ros_time(arrived: int, before: tuple[int, int], now: tuple[int, int]) -> int:
    """Return the time of ``/clock`` at which a message arrived, between two looks at the clocks.

    Args:
        arrived: by the system's clock, ns.
        before: the system's clock and that of ROS at the look before, ns.
        now: both at this look.

    Returns:
        ns; the present time where one of the clocks was set.
    """
    passed, ros_passed = now[0] - before[0], now[1] - before[1]
    if not before[0] <= arrived <= now[0] or not 0 <= ros_passed <= _FASTEST * passed:
        return now[1]
    return before[1] + ros_passed * (arrived - before[0]) // max(1, passed)


def _nothing(*_: object) -> None:
    """Take the place of a callback where no executor calls any."""
