# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When each message of a recording is due, by a clock that the caller reads."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import chain, dropwhile, takewhile

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.recording import RawMessage, Recording, TopicInfo

# Published once for whoever comes later, by convention, in bags that do not tell.
_LATCHED_BY_CUSTOM = ('tf_static', 'robot_description')


class Playback:
    """Walks through a recording with the recorded spacing in time.

    All times ``now`` are seconds on one steady clock. Messages of latched topics that were logged
    before the start come first, because they were still valid then.

    Args:
        recording: what to play.
        topics: names of its topics to play.
        rate: recorded seconds per second.
        loop: begin again at the end.
        start_offset: seconds after the recording's first message to start from.

    Raises:
        OccError: no message of these topics is that late.
    """

    def __init__(
        self,
        recording: Recording,
        topics: Collection[str],
        *,
        rate: float = 1.0,
        loop: bool = False,
        start_offset: float = 0.0,
    ) -> None:
        self._recording, self._topics = recording, list(topics)
        self._rate, self._loop = rate, loop
        self._start_ns = recording.start_ns + round(start_offset * 1e9)
        self._latched = [topic for topic in topics if is_latched(topic, recording.topics[topic])]
        self._paused = True
        self._rewind(0.0)
        if next(self._from_start(), None) is None:
            raise DataError(
                f'{recording.path} has no message to play from {start_offset:g} s after its '
                'start on; allowed is a smaller start offset'
            )

    @property
    def is_over(self) -> bool:
        """Whether no message is left."""
        return self._next is None

    @property
    def is_paused(self) -> bool:
        """Whether time stands still, as it does until the first :meth:`resume`."""
        return self._paused

    def resume(self, now: float) -> None:
        """Let time go on."""
        self._base_ns, self._since, self._paused = self.time_ns(now), now, False

    def pause(self, now: float) -> None:
        """Let time stand still."""
        self._base_ns, self._since, self._paused = self.time_ns(now), now, True

    def time_ns(self, now: float) -> int:
        """Return the recorded time that playing has reached, in ns."""
        if self._paused:
            return self._base_ns
        return self._base_ns + round((now - self._since) * self._rate * 1e9)

    def due(self, now: float) -> Iterator[RawMessage]:
        """Yield the messages that should be out by now, none in a pause.

        Those not taken are due next time.
        """
        while (
            self._next is not None
            and not self._paused
            and self._next.log_time_ns <= self.time_ns(now)
        ):
            message, self._next = self._next, next(self._messages, None)
            if self._next is None and self._loop:
                self._rewind(now)
            yield message

    def _from_start(self) -> Iterator[RawMessage]:
        return dropwhile(self._is_early, self._recording.messages(self._topics))

    def _is_early(self, message: RawMessage) -> bool:
        return message.log_time_ns < self._start_ns

    def _rewind(self, now: float) -> None:
        early: Iterator[RawMessage] = iter(())
        if self._latched:
            early = takewhile(self._is_early, self._recording.messages(self._latched))
        self._messages = chain(early, self._from_start())
        self._next = next(self._messages, None)
        self._base_ns, self._since = self._start_ns, now


def is_latched(topic: str, info: TopicInfo) -> bool:
    """Tell whether a publisher of a recorded topic kept messages for whoever came later."""
    if not info.offered_qos:
        return topic.rpartition('/')[2] in _LATCHED_BY_CUSTOM
    return any(offered.get('durability') == 'transient_local' for offered in info.offered_qos)
