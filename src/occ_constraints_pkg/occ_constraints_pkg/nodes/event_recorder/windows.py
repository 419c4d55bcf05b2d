# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which seconds around events are recorded, and what the recording says of itself; without ROS."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from occ_constraints_pkg.rosbag.event_bags import EventBags
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter
from occ_constraints_pkg.rosbag.ring import Batch, Ring

SCHEMA = 1
"""Version of what a recording says of its events."""

# An event is told of so much later than it began, at the most; what says more is of another clock.
_LATE_SECONDS = 5.0
# This share of the memory is left to what the ring no longer holds and the writer has yet to write;
# if it falls behind by more, the recording ends early.
_BEHIND_SHARE = 0.05
# More are counted but not described.
_MOST_EVENTS = 200


@dataclass(frozen=True)
class Extent:
    """How much is kept and recorded.

    Attributes:
        before: seconds before an event.
        after: seconds after it.
        longest: seconds after its first event began, by which no event keeps a recording open; with
            those ``after`` it, the most that one recording takes.
        max_bytes: the most that the last seconds may take in memory.
    """

    before: float = 10.0
    after: float = 5.0
    longest: float = 60.0
    max_bytes: int = 256 << 20


@dataclass
class _Window:
    """A recording under way; times are of the steady clock, in seconds.

    Attributes:
        path: where it will be.
        document: what it says of itself.
        began: when its first event began.
        until: until then it goes on in any case.
        latest: until then an event that goes on keeps it open.
        events: the newest document of each event, by id.
        going_on: ids of the events that have not ended.
        others: number of events that are not described.
    """

    path: Path
    document: dict[str, Any]
    began: float
    until: float
    latest: float
    events: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    going_on: set[str] = field(default_factory=set)
    others: int = 0

    @property
    def end(self) -> float:
        """When it ends, as far as is known."""
        return max(self.latest, self.until) if self.going_on else self.until


class EventWindows:
    """Keeps the last seconds of messages, and hands those around events to the writer.

    An event opens a recording with what came ``before`` it, which goes on until ``after`` seconds
    after its end. Events that begin meanwhile share it, up to ``longest`` seconds after the first;
    an event that goes on for longer does not keep it open.

    Messages and events may come from two threads.

    Args:
        extent: how much.
        bags: names recordings.
        writer: writes them.
        warn: is told, once, that memory is too small.
        now: the steady clock in seconds when messages begin to come.
    """

    def __init__(
        self,
        extent: Extent,
        bags: EventBags,
        writer: EventBagWriter,
        warn: Callable[[str], object],
        now: float,
    ) -> None:
        self._extent, self._bags, self._writer, self._warn = extent, bags, writer, warn
        self._behind_bytes = round(_BEHIND_SHARE * extent.max_bytes)
        self._ring = Ring(extent.before + _LATE_SECONDS, extent.max_bytes - self._behind_bytes)
        self._ring.complete_since = self._started = now
        self._window: _Window | None = None
        self._lock = threading.Lock()
        self._has_warned = False

    def add(self, batch: Batch) -> None:
        """Take a batch of messages, which may be empty, and end a recording that has enough."""
        with self._lock:
            if batch.messages:
                self._ring.add(batch)
            else:
                self._ring.expire(batch.time)
            if self._window is None:
                return
            self._writer.put(batch)
            if self._writer.backlog > self._ring.size + self._behind_bytes:
                self._end(batch.time, 'the disk was too slow')
            elif batch.time >= self._window.end:
                self._end(batch.time)

    def on_event(self, event: Mapping[str, Any], now: float, wall_ns: int) -> Path | None:
        """Record the seconds around an event, or go on recording.

        Args:
            event: its document as on the topic ``events``, of any phase.
            now: the steady clock, in seconds.
            wall_ns: the time that the event's times are of, in ns.

        Returns:
            The recording that it is in, or will be in; None where it began in one that has ended.
        """
        with self._lock:
            window = self._window
            if event['phase'] != 'began':
                if window is None or event['id'] not in window.events:
                    return None
            elif window is None or now > window.latest:
                if window is not None:
                    self._end(now, 'it goes on in the next recording')
                age = (wall_ns - event['began']) * 1e-9
                # Otherwise a clock was set, and the event is taken to have begun just now.
                began = now - age if 0.0 <= age <= _LATE_SECONDS else now
                window = self._window = self._open(event, began, wall_ns)
            self._extend(window, event, now)
            return window.path

    def end(self, now: float, problem: str) -> None:
        """End a recording that is under way early."""
        with self._lock:
            if self._window is not None:
                self._end(now, problem)

    def _open(self, event: Mapping[str, Any], began: float, wall_ns: int) -> _Window:
        extent, start = self._extent, began - self._extent.before
        latched, batches = self._ring.since(start)
        missing = max(0.0, self._ring.complete_since - start)
        if missing > 0.0 and self._ring.complete_since > self._started and not self._has_warned:
            self._has_warned = True
            self._warn(
                f'{missing:.1f} of {extent.before:g} s before an event are not in memory: it is '
                f"full; raise 'max_bytes' ({extent.max_bytes}), or choose fewer 'topics'"
            )
        document = {
            'schema': SCHEMA,
            'before': extent.before,
            'after': extent.after,
            'missing_before': round(missing, 3),
            'complete': False,
            'reason': 'the recorder was killed',
            'events': [dict(event)],
        }
        path = self._bags.next_path(wall_ns, f'{event["kind"]}_{event.get("rule") or ""}')
        # Of what was latched before, the log time is the window's start, as for a subscriber that
        # comes then; the publish time is its own.
        first = next((batch.messages[0][1] for batch in batches if batch.messages), None)
        if first is None:
            first = latched[-1][1] if latched else 0
        moved = [(topic, first, published, data) for topic, _, published, data in latched]
        self._writer.begin(path, document, moved)
        for batch in batches:
            self._writer.put(batch)
        return _Window(path, document, began, began + extent.after, began + extent.longest)

    def _extend(self, window: _Window, event: Mapping[str, Any], now: float) -> None:
        key = event['id']
        is_new = key not in window.events
        if is_new and len(window.events) == _MOST_EVENTS:
            window.others += 1
        else:
            window.events[key] = dict(event)
            if is_new and len(window.events) > 1:
                # For whoever finds it unfinished.
                self._writer.describe({**window.document, 'events': list(window.events.values())})
        if event['phase'] == 'ended' or key not in window.events:
            window.going_on.discard(key)
        else:
            window.going_on.add(key)
        if event['phase'] != 'update':
            most = window.latest + self._extent.after
            window.until = max(window.until, min(now + self._extent.after, most))

    def _end(self, now: float, problem: str = '') -> None:
        window, self._window = self._window, None
        assert window is not None
        if not problem and window.going_on:
            problem = f'an event went on for longer than {self._extent.longest:g} s'
        self._writer.end(
            {
                **window.document,
                'seconds_after': round(now - window.began, 3),
                'complete': not problem,
                'reason': problem,
                'events': list(window.events.values()),
                'other_events': window.others,
            }
        )
