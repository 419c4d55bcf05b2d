# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Events as lines for people, as plain values and as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.events.store import Stored
from occ_constraints_pkg.terminal import printable

_COLUMNS = (
    'number',
    'id',
    'kind',
    'robot',
    'rule',
    'began',
    'ended',
    'seconds',
    'margin',
    'text',
    'reason',
    'values',
    'rule_set',
    'cause',
    'bag',
    'pinned',
)
# What a spreadsheet would take for a formula.
_FORMULA = ('=', '+', '-', '@', '\t', '\r')


def event_document(stored: Stored) -> dict[str, Any]:
    """Return a stored event as plain values, ready for JSON: as on the topic, and its number."""
    document = stored.event.to_document('ended' if stored.event.ended is not None else 'began')
    del document['phase']
    seconds = stored.event.seconds
    return {'number': stored.number, 'pinned': stored.pinned, 'seconds': seconds, **document}


def list_events(events: Sequence[Stored], *, now: int) -> str:
    """Return a table of events, a line each.

    Args:
        events: in their order.
        now: wall time in ns, for how long those last that go on.
    """
    rows = [('N', 'began', 'lasted', 'kind', 'robot', 'margin', 'what')]
    for stored in events:
        event = stored.event
        rows.append(
            (
                f'{stored.number}{"*" if stored.pinned else ""}',
                local_time(event.began)[:19],
                _lasted(event, now),
                event.kind,
                event.robot,
                '' if math.isnan(event.margin) else f'{event.margin:.3g}',
                _what(event),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    lines = []
    for row in rows:
        cells = [printable(cell).ljust(width) for cell, width in zip(row, widths, strict=False)]
        lines.append('  '.join([*cells, printable(row[-1])]).rstrip())
    return '\n'.join(lines)


def describe_event(stored: Stored, *, cause: Stored | None, now: int) -> str:
    """Return all that is known of an event.

    Args:
        stored: the event.
        cause: the event that made the gate stop, if it is known and still there.
        now: wall time in ns.
    """
    event = stored.event
    ended = 'goes on' if event.ended is None else local_time(event.ended)
    lines = [
        f'event {stored.number}: {event.kind} of {event.robot}'
        + (', pinned' if stored.pinned else ''),
        f'  {event.text}',
        f'  began     {local_time(event.began)}',
        f'  ended     {ended} ({_lasted(event, now)})',
    ]
    if event.rule is not None:
        lines.append(f'  rule      {event.rule}')
    if not math.isnan(event.margin):
        lines.append(f'  margin    {event.margin:.4g}, smallest at {local_time(event.worst)}')
    if event.values:
        values = ', '.join(f'{name} {value:.4g}' for name, value in event.values.items())
        lines.append(f'  values    {values}')
    if event.bounds:
        bounds = ' and '.join(
            f'{_subject(item)} {item["operator"]} {item["bound"]:.6g}' for item in event.bounds
        )
        lines.append(f'  bounds    {bounds}')
    if event.reason:
        lines.append(f'  reason    {event.reason}')
    if event.cause is not None:
        number = 'is no longer kept' if cause is None else f'is event {cause.number}'
        lines.append(f'  cause     {event.cause} {number}')
    if event.rule_set is not None:
        lines.append(f'  rule set  {event.rule_set}')
    lines.append(f'  id        {event.id}')
    if event.bag is None:
        lines.append('  bag       none')
    else:
        is_there = Path(event.bag).exists()
        lines.append(f'  bag       {event.bag}{"" if is_there else " (is not there any more)"}')
    return '\n'.join(map(printable, lines))


def csv_text(events: Iterable[Stored]) -> str:
    """Return events as CSV with a header; times are local, with their offset from UTC."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(_COLUMNS)
    for stored in events:
        event = stored.event
        document = event_document(stored)
        document |= {
            'began': _iso(event.began),
            'ended': None if event.ended is None else _iso(event.ended),
            'values': json.dumps(document['values']),
        }
        writer.writerow([_cell(document[name]) for name in _COLUMNS])
    return stream.getvalue()


def local_time(ns: int) -> str:
    """Return a wall time as local time to the millisecond."""
    try:
        return datetime.fromtimestamp(ns / 1e9).strftime('%Y-%m-%d %H:%M:%S.%f')[:-3]
    except (OverflowError, ValueError, OSError):
        return f'{ns} ns'


def _iso(ns: int) -> str:
    try:
        return datetime.fromtimestamp(ns / 1e9).astimezone().isoformat(timespec='milliseconds')
    except (OverflowError, ValueError, OSError):
        return str(ns)


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def _lasted(event: Event, now: int) -> str:
    if event.seconds is None:
        return f'{max(0, now - event.began) * 1e-9:.1f} s so far'
    return f'{event.seconds:.1f} s'


def _what(event: Event) -> str:
    rule = f'{event.rule}: ' if event.kind == 'violation' and event.rule else ''
    return f'{rule}{event.text}'


def _subject(bound: Any) -> str:
    return f'any {bound["family"]}' if 'family' in bound else str(bound.get('feature', '?'))
