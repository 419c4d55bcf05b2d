# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Events that recorders tell of on the topic ``events``: the newest of them, each in one piece."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from occ_constraints_pkg.terminal import printable

MOST_EVENTS = 200
# Anybody may publish on the topic: so long a text is of no use to a viewer.
_MOST_TEXT = 400
_MOST_VALUES = 6
_MOST_MESSAGE = 65536
_NS_LIMIT = 2**63


@dataclass(frozen=True)
class HeardEvent:
    """What a message said of one event; a later one replaces it.

    It is read leniently and cut to what a view shows.

    Attributes:
        source: the topic that told of it.
        id: unique for that topic.
        phase: ``began``, ``update`` or ``ended``.
        kind: ``violation``, ``unknown``, ``near_miss``, ``stop`` or ``trigger``.
        robot: whom it is about.
        rule: id of the rule; empty where none is concerned.
        text: the event in words.
        values: of the features concerned, for people.
        margin: the worst one; NaN where there is none.
        began_ns: wall time of the beginning; 0 where unknown, as for the next two.
        worst_ns: of the worst moment.
        ended_ns: of the end; 0 while it goes on.
        reason: for UNKNOWN, and the cause of a stop.
        bag: the recording of the seconds around it; empty where there is none yet.
    """

    source: str
    id: str
    phase: str = ''
    kind: str = ''
    robot: str = ''
    rule: str = ''
    text: str = ''
    values: str = ''
    margin: float = math.nan
    began_ns: int = 0
    worst_ns: int = 0
    ended_ns: int = 0
    reason: str = ''
    bag: str = ''


class EventLog:
    """The newest events; what was told of last is last.

    Attributes:
        version: another number after each change.
        sources: topics that somebody publishes events on.
    """

    def __init__(self) -> None:
        self.version = 0
        self.sources: frozenset[str] = frozenset()
        self._events: dict[tuple[str, str], HeardEvent] = {}

    def __iter__(self) -> Iterator[HeardEvent]:
        return iter(self._events.values())

    def find(self, sources: Iterable[str]) -> None:
        """Take the topics that somebody publishes events on now."""
        found = frozenset(sources)
        if found != self.sources:
            self.sources = found
            self.version += 1

    def hear(self, event: HeardEvent) -> None:
        """Take an event, or what is newly known of one."""
        key = event.source, event.id
        if self._events.get(key) == event:
            return
        # To the end, for those that nothing new is told of are dropped first.
        self._events.pop(key, None)
        self._events[key] = event
        self.version += 1
        while len(self._events) > MOST_EVENTS:
            del self._events[next(iter(self._events))]


def read_event(text: str, source: str) -> HeardEvent | None:
    """Return what a message on ``events`` says; None for one that is not about an event.

    Args:
        text: the JSON of the message.
        source: name of the topic.
    """
    if len(text) > _MOST_MESSAGE:
        return None
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(said, dict) or not isinstance(said.get('kind'), str) or 'id' not in said:
        return None
    return HeardEvent(
        source,
        *(_text(said.get(key)) for key in ('id', 'phase', 'kind', 'robot', 'rule', 'text')),
        _values(said.get('values')),
        _number(said.get('margin')),
        *(_nanoseconds(said.get(key)) for key in ('began', 'worst', 'ended')),
        *(_text(said.get(key)) for key in ('reason', 'bag')),
    )


def _text(value: Any) -> str:
    if value is None or isinstance(value, dict | list):
        return ''
    text = printable(str(value))
    return text if len(text) <= _MOST_TEXT else f'{text[:_MOST_TEXT]}…'


def _values(values: Any) -> str:
    if not isinstance(values, dict):
        return ''
    told = [f'{_text(key)} {_shown(value)}' for key, value in list(values.items())[:_MOST_VALUES]]
    more = len(values) - _MOST_VALUES
    return ', '.join(told + ([f'{more} more'] if more > 0 else []))


def _shown(value: Any) -> str:
    number = _number(value)
    return _text(value) if math.isnan(number) else f'{number:.4g}'


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def _nanoseconds(value: Any) -> int:
    is_time = isinstance(value, int) and not isinstance(value, bool) and 0 < value < _NS_LIMIT
    return value if is_time else 0
