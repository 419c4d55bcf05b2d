# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ events``: what an event_recorder has kept."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from occ_constraints_pkg.cli.common import (
    AT_LEAST_1,
    JSON,
    help_without_command,
    print_json,
    report,
    say_lines,
)
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.events.event import KINDS
from occ_constraints_pkg.files import EVENTS, check_outputs, replacing
from occ_constraints_pkg.wording import count_of

if TYPE_CHECKING:
    from occ_constraints_pkg.events.store import EventReader, Filter, Stored

_AGO = re.compile(r'(\d+(?:\.\d+)?)\s*([smhdw])')
_UNITS = {'s': 'seconds', 'm': 'minutes', 'h': 'hours', 'd': 'days', 'w': 'weeks'}


class _Time(click.ParamType):
    """A wall time in ns: a date, a date and time, a time of today, or how long ago."""

    name = 'time'

    def convert(self, value: Any, param: Any, ctx: Any) -> int:
        """Return the time.

        Raises:
            click.BadParameter: it is none.
        """
        if isinstance(value, int):
            return value
        text, now = value.strip(), datetime.now()
        ago = _AGO.fullmatch(text)
        try:
            if ago:
                then = now - timedelta(**{_UNITS[ago[2]]: float(ago[1])})
            elif re.fullmatch(r'\d{1,2}:\d{2}(:\d{2}(\.\d+)?)?', text):
                then = datetime.fromisoformat(f'{now:%Y-%m-%d}T{text.zfill(5)}')
            else:
                then = datetime.fromisoformat(text)
            return round(then.timestamp() * 1e9)
        except (ValueError, OverflowError, OSError):
            self.fail(
                f"got {value!r}; allowed are 2026-12-01, '2026-12-01 02:14', 02:14 (today) and "
                '30m, 2h or 1d (ago)',
                param,
                ctx,
            )


_STORE = click.option(
    '--store',
    type=click.Path(),
    metavar='PATH',
    help='A store, or a directory with stores; default: ~/.ros/occ_events.',
)


def _filters(command: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.option('--until', type=_Time(), metavar='TIME', help='Those that began before.'),
        click.option(
            '--since',
            type=_Time(),
            metavar='TIME',
            help="Those not over before: '2026-12-01 02:14', 02:14, or 2h ago as 2h.",
        ),
        click.option('--kind', type=click.Choice(KINDS), help='Those of one kind.'),
        click.option('--robot', metavar='NAMESPACE', help='Those of one robot.'),
        click.option('--rule', metavar='ID', help='Those of one rule.'),
        _STORE,
    ):
        command = option(command)
    return command


@click.group('events', invoke_without_command=True)
@click.pass_context
def events(context: click.Context) -> None:
    """Tell what happened to a robot, and why it stopped.

    The node event_recorder keeps violations, UNKNOWN, near misses and stops of the gate.

    \b
    Example: occ events list --since 8h --kind stop
             occ events show 12
    """
    help_without_command(context)


@events.command('list')
@_filters
@click.option(
    '-n',
    '--newest',
    default=50,
    show_default=True,
    type=AT_LEAST_1,
    help='At most so many, the newest ones.',
)
@JSON
def list_(store: str | None, newest: int, as_json: bool, **wanted: Any) -> None:
    """List events, a line each; * marks those that are pinned.

    \b
    Example: occ events list --since 02:00 --robot /robot1
    """
    from occ_constraints_pkg.events.text import event_document, list_events

    found = _read(store, _filter(wanted), newest)
    if as_json:
        print_json(
            [
                {'store': str(path), 'events': [event_document(item) for item in items]}
                for path, items in found
            ]
        )
        return
    for place, (path, items) in enumerate(found):
        if len(found) > 1:
            say_lines(f'{"" if place == 0 else chr(10)}{path}:')
        if items:
            say_lines(list_events(items, now=time.time_ns()))
        else:
            report(f'no such events in {path}')
        if len(items) == newest:
            report(f'the newest {newest}; see --newest')


@events.command()
@click.argument('event', metavar='N')
@_STORE
@JSON
def show(event: str, store: str | None, as_json: bool) -> None:
    """Show all that is known of an event, by its number or its id, and its bag.

    \b
    Example: occ events show 12
    """
    from occ_constraints_pkg.events.text import describe_event, event_document

    reader, stored = _find(event, store)
    if as_json:
        print_json(event_document(stored))
        return
    cause = reader.find(stored.event.cause) if stored.event.cause else None
    say_lines(describe_event(stored, cause=cause, now=time.time_ns()))
    if stored.event.bag and Path(stored.event.bag).exists():
        say_lines(f'  judge it  occ check {stored.event.bag} -c CONSTRAINTS')


@events.command()
@_filters
@click.option(
    '--format',
    'form',
    type=click.Choice(['json', 'csv']),
    help='Default: by the end of the name of --output, else json.',
)
@click.option('-o', '--output', type=click.Path(), help='File to write; default: print it.')
def export(store: str | None, form: str | None, output: str | None, **wanted: Any) -> None:
    """Write events as JSON or CSV, oldest first.

    \b
    Example: occ events export --since 7d -o week.csv
    """
    from occ_constraints_pkg.events.text import csv_text, event_document

    if output:
        check_outputs({output: EVENTS})
    if form is None:
        form = 'csv' if output and output.endswith('.csv') else 'json'
    items = [item for _, found in _read(store, _filter(wanted), None) for item in found]
    if form == 'csv':
        text = csv_text(items)
    else:
        text = json.dumps({'events': [event_document(item) for item in items]}, indent=1) + '\n'
    if output is None:
        say_lines(text, nl=False)
        return
    with replacing(output, EVENTS) as draft:
        draft.write_text(text, encoding='utf-8')
    report(f'{count_of(len(items), "event")} written to {output}')


@events.command()
@click.argument('event', metavar='N')
@click.option('--off', is_flag=True, help='Let it be removed again.')
@_STORE
def pin(event: str, off: bool, store: str | None) -> None:
    """Let an event and its bag stay when the store is full.

    \b
    Example: occ events pin 12
    """
    from occ_constraints_pkg.events.store import pin_event

    reader, stored = _find(event, store)
    if not pin_event(reader.path, stored.number, pinned=not off):
        raise DataError(f'{reader.path} does not hold event {event} any more')
    report(f'event {stored.number} is {"no longer " if off else ""}pinned')


def _filter(wanted: dict[str, Any]) -> Filter:
    from occ_constraints_pkg.events.store import Filter

    robot = wanted['robot']
    if robot is not None and not robot.startswith('/'):
        wanted['robot'] = f'/{robot}'
    return Filter(**wanted)


def _readers(store: str | None) -> list[EventReader]:
    """Open the stores that a user means.

    Raises:
        OccError: there is none, or one cannot be read.
    """
    from occ_constraints_pkg.events.store import STORE_NAME, EventReader, default_directory

    path = Path(store).expanduser() if store else default_directory()
    paths = sorted(path.rglob(STORE_NAME)) if path.is_dir() else [path]
    if not paths or not (store or path.is_dir()):
        raise DataError(
            f'there is no event store in {path}; allowed is the directory of an event_recorder '
            '(its parameter store), see occ node event_recorder --help'
        )
    return [EventReader(item) for item in paths]


def _read(store: str | None, wanted: Filter, newest: int | None) -> list[tuple[Path, list[Stored]]]:
    return [(reader.path, reader.events(wanted, newest=newest)) for reader in _readers(store)]


def _find(event: str, store: str | None) -> tuple[EventReader, Stored]:
    """Return the one event that a user means, with its store.

    Raises:
        OccError: there is none, or several stores have one.
    """
    readers = _readers(store)
    found = [(reader, stored) for reader in readers if (stored := reader.find(event)) is not None]
    names = ', '.join(str(reader.path) for reader in readers)
    if not found:
        raise DataError(
            f'{names}: there is no event {event!r}; allowed is a number that occ events list '
            'prints, or an id'
        )
    if len(found) > 1:
        raise DataError(
            f'{len(found)} stores have an event {event}: {names}; name one with --store'
        )
    return found[0]
