# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The recording of the seconds around events: which window, which messages, what it says."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.nodes.bag_topics import topic_filter
from occ_constraints_pkg.nodes.event_recorder.capture import Capture
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rosbag.event_bags import EventBags
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter, Outcome
from occ_constraints_pkg.rosbag.ring import Batch, Ring
from occ_constraints_pkg.rosbag.topic_filter import TopicFilter
from occ_constraints_pkg.wording import count_of

SCHEMA = 1
"""Version of what a recording says of its events."""

# Whatever else is chosen: the verdicts, what they are about, and the rules in force.
_ALWAYS = ('violation', 'events', 'rules', 'constraints')
# An event is told of so much later than it began, at the most; what says more is of another clock.
_LATE_SECONDS = 5.0
# Beyond what the ring holds, the writer may fall behind by this share of it before a recording
# ends early: the rest of the tenth by which memory may exceed its bound.
_BEHIND_SHARE = 0.05
# More are counted but not described.
_MOST_EVENTS = 200
_OUTCOME_SECONDS = 0.1


@dataclass(frozen=True)
class Settings:
    """What is kept, and for how long.

    Attributes:
        topics: which are captured, by full name.
        before: seconds before an event.
        after: seconds after it.
        longest: the most seconds that one recording goes on after its first event began.
        max_bytes: the most that the last seconds may take in memory.
        directory: where recordings go.
        quota: the most bytes that all of them may take on the disk; 0: no limit.
        compression: ``zstd``, ``lz4`` or ``none``.
    """

    topics: TopicFilter
    before: float = 10.0
    after: float = 5.0
    longest: float = 60.0
    max_bytes: int = 256 << 20
    directory: str = ''
    quota: int = 0
    compression: str = 'lz4'

    @classmethod
    def declare(cls, node: OccNode) -> Settings:
        """Declare the node's parameters, and return their values.

        Raises:
            OccError: one has a wrong value.
        """
        chosen = topic_filter(node, 'keep')
        before = node.parameter('before', cls.before, 'seconds kept before an event', low=0.0)
        after = node.parameter('after', cls.after, 'seconds recorded after an event', low=0.0)
        longest = node.parameter(
            'longest',
            cls.longest,
            'a recording ends so many seconds after its first event began, however long it goes on',
            low=0.0,
        )
        max_bytes = node.parameter(
            'max_bytes', cls.max_bytes, 'memory for the last seconds, in bytes', low=1 << 20
        )
        directory = node.parameter(
            'directory', cls.directory, 'where recordings of events go; empty: none are made'
        )
        quota = node.parameter(
            'quota', cls.quota, 'bytes of all recordings together; 0: no limit', low=0
        )
        compression = node.parameter('compression', cls.compression, 'zstd, lz4 or none')
        if longest < after:
            raise ConfigurationError(
                f"parameter 'longest' of node {node.get_name()!r}: got {longest:g}; allowed is "
                f"{after:g} (parameter 'after') or more"
            )
        if chosen.names or chosen.regex:
            chosen = replace(chosen, names=[*chosen.names, *_ALWAYS])
        return cls(
            chosen.with_names(node.full_name),
            before,
            after,
            longest,
            max_bytes,
            directory,
            quota,
            compression,
        )


@dataclass
class _Window:
    """A recording under way; times are of the steady clock, in seconds.

    Attributes:
        path: where it will be.
        document: what it says of itself.
        began: when its first event began.
        until: when it ends unless something else happens.
        latest: when it ends whatever happens.
        events: the newest document of each event, by id.
        going_on: ids of the events that have not ended.
        others: number of events that are not described.
    """

    path: Path
    document: dict[str, Any]
    began: float
    until: float
    latest: float
    events: dict[str, Mapping[str, Any]]
    going_on: set[str]
    others: int = 0

    @property
    def end(self) -> float:
        """When it ends, as far as is known."""
        return self.latest if self.going_on else min(self.until, self.latest)


class IncidentRecorder:
    """Keeps the last seconds of topics in memory, and records those around events.

    An event opens a recording with what came ``before``, which goes on until ``after`` seconds
    after its end. Events that begin while one is open share it; an event that goes on for longer
    than ``longest`` does not keep it open.

    Args:
        node: an executor must spin it; its topics are those of its namespace.
        settings: see there.
        on_bag: is called by the executor with what became of each recording.

    Raises:
        OccError: the directory cannot be used.
    """

    def __init__(
        self,
        node: OccNode,
        settings: Settings,
        on_bag: Callable[[Outcome], None] = lambda outcome: None,
    ) -> None:
        self._node, self._settings, self._on_bag = node, settings, on_bag
        self._bags = EventBags(settings.directory, settings.quota, settings.compression)
        self._writer = EventBagWriter(self._bags)
        self._ring = Ring(settings.before + _LATE_SECONDS, settings.max_bytes)
        self._window: _Window | None = None
        # Events come by the executor, messages by the thread that captures.
        self._lock = threading.Lock()
        self._started = math.inf
        self._is_short = False
        self._capture = Capture(node, settings.topics.allows, self._receive)
        node.steady_timer(_OUTCOME_SECONDS, self._tell_outcomes)
        if self._bags.interrupted:
            count = count_of(len(self._bags.interrupted), 'recording')
            node.get_logger().warning(
                f'{count} of events were interrupted before this start; what was written of them '
                f'is {", ".join(map(str, self._bags.interrupted[:3]))}'
            )
        node.get_logger().info(
            f'keeping the last {settings.before:g} s of {settings.topics} for recordings of events '
            f'in {self._bags.directory}'
        )

    def begin(self) -> None:
        """Begin to capture."""
        self._ring.complete_since = self._started = time.monotonic()
        self._capture.start()

    def on_event(self, event: Mapping[str, Any]) -> Path | None:
        """Record the seconds around an event, or go on recording.

        Args:
            event: its document as on the topic ``events``, of any phase; one of the kind
                ``trigger`` has no beginning but its end.

        Returns:
            The recording that it is in, or will be in; None where it began in one that has ended.
        """
        now, began_ns = time.monotonic(), event['began']
        age = (time.time_ns() - began_ns) * 1e-9
        # Otherwise a clock was set, and the event is taken to have begun just now.
        began = now - age if 0.0 <= age <= _LATE_SECONDS else now
        with self._lock:
            window = self._window
            if event['phase'] != 'began' and event['kind'] != 'trigger':
                if window is None or event['id'] not in window.events:
                    return None
            elif window is None:
                window = self._window = self._open(event, began)
            self._extend(window, event, now)
            return window.path

    def close(self) -> None:
        """End a recording that is under way, and see it to the disk."""
        self._capture.close()
        with self._lock:
            if self._window is not None:
                self._end(time.monotonic(), 'the recorder was ended')
        self._writer.close()
        self._tell_outcomes()

    def _extend(self, window: _Window, event: Mapping[str, Any], now: float) -> None:
        key = event['id']
        if key in window.events or len(window.events) < _MOST_EVENTS:
            window.events[key] = dict(event)
        else:
            window.others += 1
        if event['phase'] == 'ended' or key not in window.events:
            window.going_on.discard(key)
            window.until = max(window.until, now + self._settings.after)
        else:
            window.going_on.add(key)

    def _open(self, event: Mapping[str, Any], began: float) -> _Window:
        start = began - self._settings.before
        latched, batches = self._ring.since(start)
        missing = self._ring.complete_since - start
        if missing > 0.0 and self._ring.complete_since > self._started and not self._is_short:
            self._is_short = True
            self._node.get_logger().warning(
                f'{missing:.1f} of {self._settings.before:g} s before the event are not in '
                f'memory: it is full; raise max_bytes ({self._settings.max_bytes}) or keep '
                'fewer topics'
            )
        first = next((batch.messages[0] for batch in batches if batch.messages), None)
        start_ns = self._node.ros_ns() if first is None else first[1]
        label = f'{event["kind"]}_{event.get("rule") or ""}'
        document = {
            'schema': SCHEMA,
            'before': self._settings.before,
            'after': self._settings.after,
            'complete': False,
            'reason': 'the recorder was killed',
            'missing_before': round(max(0.0, missing), 3),
            'events': [dict(event)],
        }
        path = self._bags.next_path(time.time_ns(), label)
        # Of what was latched before, the log time is the window's start, as for a late subscriber;
        # the publish time is its own.
        moved = [(topic, start_ns, publish, data) for topic, _, publish, data in latched]
        self._writer.begin(path, document, moved)
        for batch in batches:
            self._writer.put(batch)
        settings = self._settings
        return _Window(
            path, document, began, began + settings.after, began + settings.longest, {}, set()
        )

    def _receive(self, batch: Batch) -> None:
        with self._lock:
            if batch.messages:
                self._ring.add(batch)
            else:
                self._ring.expire(batch.time)
            window = self._window
            if window is None:
                return
            self._writer.put(batch)
            if self._writer.backlog > self._ring.size + _BEHIND_SHARE * self._settings.max_bytes:
                self._end(batch.time, 'the disk was too slow')
            elif batch.time >= window.end:
                self._end(batch.time)

    def _end(self, now: float, problem: str = '') -> None:
        window, self._window = self._window, None
        assert window is not None
        events = list(window.events.values())
        reason = problem
        if not problem and window.going_on:
            reason = f'an event went on for longer than {self._settings.longest:g} s'
        self._writer.end(
            {
                **window.document,
                'seconds_after': round(now - window.began, 3),
                'complete': not reason,
                'reason': reason,
                'events': events,
                'other_events': window.others,
            }
        )

    def _tell_outcomes(self) -> None:
        log = self._node.get_logger()
        while self._writer.outcomes:
            outcome = self._writer.outcomes.popleft()
            for path in outcome.removed:
                log.info(f'{path} was removed to make room')
            if not outcome.is_kept:
                log.error(f'there is no recording {outcome.path}: {outcome.problem}')
            else:
                reason = outcome.document.get('reason')
                log.info(
                    f'recorded {count_of(len(outcome.document["events"]), "event")} to '
                    f'{outcome.path}' + (f', which ends early: {reason}' if reason else '')
                )
            self._on_bag(outcome)
