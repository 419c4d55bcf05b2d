# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Changes of events on their way: first into the store, then to whoever listens."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import replace

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.derivation import Change
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.events.store import EventStore

# An event that only gets worse is told so often at most.
_UPDATE_NS = 1_000_000_000
# Events that wait while the store cannot be written; of more, the oldest are lost.
_MOST_WAITING = 10_000
# How many events are remembered for what may still happen to them.
_MOST_RECENT = 200
# How often a store is tried again that could not be written, and open events are noted.
_RETRY_NS, _HEAR_NS = 1_000_000_000, 2_000_000_000


class Journal:
    """Keeps changes in a store and hands them on.

    While the store cannot be written, as on a full disk, changes wait and are handed on all the
    same: what is told live does not depend on a disk.

    Attributes:
        problem: why the store cannot be written; empty while it can.
        lost: events that were dropped while too many waited.
        recent: the newest events, in the order of their beginnings.

    Args:
        store: where events are kept.
        tell: called with an event and its phase.
    """

    def __init__(self, store: EventStore, tell: Callable[[Event, str], None]) -> None:
        self._store, self._tell = store, tell
        self.problem = ''
        self.lost = 0
        self.recent: OrderedDict[str, Event] = OrderedDict()
        # What the store does not have yet, and what was not told yet for it came too soon.
        self._waiting: OrderedDict[str, Event] = OrderedDict()
        self._held_back: dict[str, Event] = {}
        self._told_at: dict[str, int] = {}
        self._bags: OrderedDict[str, str | None] = OrderedDict()
        self._tried, self._heard = -_RETRY_NS, 0

    @property
    def waiting(self) -> int:
        """How many events the store does not have as they are."""
        return len(self._waiting)

    @property
    def going_on(self) -> int:
        """How many of the recent events have not ended."""
        return sum(event.ended is None for event in self.recent.values())

    def add(self, changes: Iterable[Change], *, wall: int, steady: int) -> None:
        """Take changes: keep them, then tell them.

        Args:
            changes: in their order.
            wall: wall time in ns.
            steady: time in ns on a clock that is never set.
        """
        due: list[Change] = []
        for event, phase in changes:
            event = self._with_bag(event)
            self._remember(event)
            if phase == 'update' and steady - self._told_at.get(event.id, 0) < _UPDATE_NS:
                self._held_back[event.id] = event
                continue
            self._held_back.pop(event.id, None)
            due.append((event, phase))
        self._hand_on(due, wall, steady)

    def tick(self, *, wall: int, steady: int) -> None:
        """Tell what was held back, and try again what failed; to be called once a second or so."""
        due = [
            (event, 'update')
            for event in self._held_back.values()
            if steady - self._told_at.get(event.id, 0) >= _UPDATE_NS
        ]
        for event, _ in due:
            del self._held_back[event.id]
        self._hand_on(due, wall, steady)
        self._keep(wall, steady)
        if steady - self._heard >= _HEAR_NS and not self.problem:
            self._heard = steady
            try:
                self._check_file()
                if self.going_on:
                    self._store.hear_open(wall)
            except (OSError, OccError) as error:
                self.problem = str(error)

    def name_bag(self, ids: Iterable[str], bag: str | None, *, wall: int, steady: int) -> None:
        """Name the recording of the seconds around some events, and tell it.

        Args:
            ids: of the events.
            bag: its path; None: it was removed.
            wall: wall time in ns.
            steady: time in ns on a clock that is never set.
        """
        ids = list(ids)
        for item in ids:
            self._bags[item] = bag
            self._bags.move_to_end(item)
        while len(self._bags) > _MOST_RECENT:
            self._bags.popitem(last=False)
        known: dict[str, Event] = {}
        try:
            known = {event.id: event for event in self._store.name_bag(ids, bag)}
        except OSError as error:
            self.problem = str(error)
        due = []
        for item in ids:
            event = self.recent.get(item, known.get(item))
            if event is not None:
                event = replace(event, bag=bag)
                self._remember(event)
                due.append((event, 'update' if event.ended is None else 'ended'))
        self._hand_on(due, wall, steady)

    def _with_bag(self, event: Event) -> Event:
        return replace(event, bag=self._bags[event.id]) if event.id in self._bags else event

    def _remember(self, event: Event) -> None:
        self.recent[event.id] = event
        if len(self.recent) > _MOST_RECENT:
            # Those that go on are needed yet.
            ended = (item.id for item in self.recent.values() if item.ended is not None)
            oldest = next(ended, next(iter(self.recent)))
            del self.recent[oldest]

    def _hand_on(self, due: list[Change], wall: int, steady: int) -> None:
        if not due:
            return
        for event, _ in due:
            self._waiting[event.id] = event
        while len(self._waiting) > _MOST_WAITING:
            self._waiting.popitem(last=False)
            self.lost += 1
        self._keep(wall, steady)
        for event, phase in due:
            if phase == 'ended':
                self._told_at.pop(event.id, None)
            else:
                self._told_at[event.id] = steady
            self._tell(event, phase)

    def _keep(self, wall: int, steady: int) -> None:
        """Write what waits, not too often while that fails."""
        if not (self._waiting or self.problem):
            return
        if self.problem and steady - self._tried < _RETRY_NS:
            return
        self._tried = steady
        try:
            if self.problem:
                self._check_file()
            self._store.keep(self._waiting.values(), now=wall)
        except (OSError, OccError) as error:
            self.problem = str(error)
            return
        self._waiting.clear()
        self.problem = ''

    def _check_file(self) -> None:
        """Begin a new store where the file is damaged or gone, with what is known of now."""
        if self._store.check_file():
            self._waiting = OrderedDict(self.recent)
