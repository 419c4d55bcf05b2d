# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of many topics, serialized, in bounded memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

MESSAGE_BYTES = 260
"""What a message takes in memory beside its own bytes: the tuple, two numbers, and their rounding
up to what an allocator gives."""
# Whoever joins late needs them, and a window begins late: of a topic, the last messages before.
MOST_LATCHED = 100
"""So many of a latched topic's last messages are kept, for several nodes may latch one each."""
# Of the bound, this much may be taken by latched messages beyond the last one of each topic.
_LATCHED_SHARE = 0.1


@dataclass(eq=False)
class LiveTopic:
    """A topic whose messages are kept.

    Attributes:
        name: in full.
        msgtype: for example ``nav_msgs/msg/Odometry``.
        offered: quality of service of each publisher, spelled as in rosbag2 metadata 9.
    """

    name: str
    msgtype: str
    offered: list[dict[str, Any]] = field(default_factory=list)

    @property
    def is_latched(self) -> bool:
        """Whether a publisher keeps its last messages for those that come late."""
        return any(profile.get('durability') == 'transient_local' for profile in self.offered)


Message = tuple[LiveTopic, int, int, bytes]
"""A message: its topic, log time and publish time in ns, and its bytes in CDR.

Tuples, and not objects with names, for there are thousands of them in a second.
"""


@dataclass(frozen=True)
class Batch:
    """Messages that were taken from the middleware together.

    Attributes:
        time: when that was, by a steady clock in seconds.
        messages: in the order of their log times.
        size: their bytes in memory.
    """

    time: float
    messages: Sequence[Message]
    size: int

    @classmethod
    def of(cls, time: float, messages: Sequence[Message]) -> Batch:
        """Return a batch with its size."""
        data = sum([len(message[3]) for message in messages])
        return cls(time, messages, data + MESSAGE_BYTES * len(messages))


class Ring:
    """Keeps batches of messages for some seconds, in at most some bytes.

    What is too old leaves, and where bytes are short, the oldest leave before they are. Of latched
    topics the last messages are kept for ever, :data:`MOST_LATCHED` of each while they fit into a
    tenth of the bytes, and the last one of each in any case.

    Time is that of a steady clock, so a jump of the system's clock neither empties the ring nor
    makes it grow.

    Attributes:
        size: bytes in memory, latched messages included.
        complete_since: every batch of a later time is still here.

    Args:
        seconds: how long a batch stays.
        max_bytes: the most that all may take in memory.
    """

    def __init__(self, seconds: float, max_bytes: int) -> None:
        self.size = 0
        self.complete_since = -math.inf
        self._seconds, self._max_bytes = seconds, max_bytes
        self._batches: deque[Batch] = deque()
        self._latched: dict[LiveTopic, deque[Message]] = {}
        self._latched_size = 0

    def __iter__(self) -> Iterator[Batch]:
        """Yield the batches, the oldest first."""
        return iter(self._batches)

    def add(self, batch: Batch) -> None:
        """Add the newest batch, and let go of what is too old or too much."""
        self._batches.append(batch)
        self.size += batch.size
        self.expire(batch.time)

    def expire(self, now: float) -> None:
        """Let go of what is too old by now or too much."""
        oldest = now - self._seconds
        while self._batches:
            first = self._batches[0]
            if first.time >= oldest and self.size <= self._max_bytes:
                return
            self._batches.popleft()
            self.complete_since = first.time
            self.size -= first.size
            self._keep_latched(first.messages)

    def since(self, start: float) -> tuple[list[Message], list[Batch]]:
        """Return what is needed from a time on.

        Args:
            start: by the steady clock, in seconds.

        Returns:
            The messages of latched topics from before, oldest first; and the batches since then.
        """
        before = {topic: deque(kept, MOST_LATCHED) for topic, kept in self._latched.items()}
        batches = []
        for batch in self._batches:
            if batch.time >= start:
                batches.append(batch)
                continue
            for message in batch.messages:
                if message[0].is_latched:
                    before.setdefault(message[0], deque(maxlen=MOST_LATCHED)).append(message)
        latched = [message for kept in before.values() for message in kept]
        return sorted(latched, key=lambda message: message[1]), batches

    def _keep_latched(self, messages: Sequence[Message]) -> None:
        for message in messages:
            if not message[0].is_latched:
                continue
            kept = self._latched.setdefault(message[0], deque())
            kept.append(message)
            self._latched_size += _size_of(message)
            self.size += _size_of(message)
            if len(kept) > MOST_LATCHED:
                self._drop_latched(kept)
        while self._latched_size > _LATCHED_SHARE * self._max_bytes:
            longest = max(self._latched.values(), key=lambda kept: (len(kept) > 1, _sum(kept)))
            if len(longest) < 2:
                return
            self._drop_latched(longest)

    def _drop_latched(self, kept: deque[Message]) -> None:
        size = _size_of(kept.popleft())
        self._latched_size -= size
        self.size -= size


def _size_of(message: Message) -> int:
    return len(message[3]) + MESSAGE_BYTES


def _sum(messages: Iterable[Message]) -> int:
    return sum(map(_size_of, messages))
