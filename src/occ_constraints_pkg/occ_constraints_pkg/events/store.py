# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The events of a robot in a SQLite file that survives kills, power cuts and full disks."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError, DataError, OccError
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.files import DirectoryLock, make_directory

STORE_NAME = 'events.db'
"""File name of a store in its directory."""

STORE_SCHEMA = 1
MAX_BYTES = 256 << 20
"""Size above which the oldest events are removed, of a recorder's store by default."""

# 'occev' as a number, by which `file` and we know such a file from other databases.
_APPLICATION = 0x6F636576
_BUSY_SECONDS = 5.0
_LOG_PAGES = 100
# So many events are removed at once, and so much of the size is left to others afterwards.
_REMOVED_AT_ONCE, _FILLED = 500, 0.95
_TABLE = """
CREATE TABLE events (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    id TEXT NOT NULL UNIQUE,
    kind TEXT NOT NULL,
    robot TEXT NOT NULL,
    rule TEXT,
    began INTEGER NOT NULL,
    ended INTEGER,
    heard INTEGER NOT NULL,
    pinned INTEGER NOT NULL DEFAULT 0,
    bag TEXT,
    document TEXT NOT NULL
)
"""
_INDEX = 'CREATE INDEX going_on ON events (number) WHERE ended IS NULL'
_COLUMNS = 'kind, robot, rule, began, ended, heard, bag, document, id'
_ADD = f'INSERT INTO events ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)'
# Tried first: an insertion that meets the same id would use up a number.
_CHANGE = (
    'UPDATE events SET kind = ?, robot = ?, rule = ?, began = ?, ended = ?, heard = ?, '
    'bag = coalesce(?, bag), document = ? WHERE id = ?'
)
_INTERRUPTED = 'interrupted: the recorder ended before the event did'


def default_directory(namespace: str = '') -> Path:
    """Return where the store of a robot's recorder is by default; without a name, all of them."""
    home = os.environ.get('ROS_HOME') or Path.home() / '.ros'
    return Path(home) / 'occ_events' / namespace.strip('/')


class StoreFullError(OccError):
    """All events that a full store holds are pinned or go on."""


@dataclass(frozen=True)
class Stored:
    """An event in a store.

    Attributes:
        number: in this store, from 1 in the order in which events came; never given twice.
        event: what happened.
        pinned: whether it stays when the store is full.
    """

    number: int
    event: Event
    pinned: bool


@dataclass(frozen=True)
class Filter:
    """Which events to read; each None allows any.

    Attributes:
        kind: see :class:`Event`.
        robot: see :class:`Event`; the robots ``#N`` of a table belong to their namespace.
        rule: id of the rule.
        since: those that have not ended before this wall time in ns.
        until: those that began before it.
    """

    kind: str | None = None
    robot: str | None = None
    rule: str | None = None
    since: int | None = None
    until: int | None = None

    def condition(self) -> tuple[str, dict[str, Any]]:
        """Return the condition in SQL, and its parameters."""
        terms = {
            'kind': 'kind = :kind',
            'robot': "(robot = :robot OR robot LIKE :robots ESCAPE '\\')",
            'rule': 'rule = :rule',
            'since': '(ended IS NULL OR ended >= :since)',
            'until': 'began < :until',
        }
        values = {name: value for name, value in vars(self).items() if value is not None}
        parts = [terms[name] for name in values]
        if self.robot is not None:
            escaped = self.robot.replace('\\', r'\\').replace('%', r'\%').replace('_', r'\_')
            values['robots'] = f'{escaped}#%'
        return ' AND '.join(parts) or '1', values


class EventStore:
    """Keeps events; what a call has kept survives the end of the process and of the power.

    Only one program at a time may have a store open for writing; any may read it meanwhile. What
    was still open when an earlier program was killed is closed as interrupted.

    Attributes:
        path: the SQLite file.
        damaged: where a file was moved to that could not be read; None if all was well.
        interrupted: the events that an earlier program left open.

    Args:
        directory: made if it is not there; the store is its ``events.db``.
        max_bytes: size above which the oldest events that are not pinned are removed.

    Raises:
        OccError: the directory cannot be written, another program has it, or the file is another
            database or of a newer schema.
    """

    def __init__(self, directory: str | Path, *, max_bytes: int = MAX_BYTES) -> None:
        self.path = make_directory(directory) / STORE_NAME
        self._lock = DirectoryLock(self.path.parent)
        self._max_bytes = max_bytes
        self.damaged: Path | None = None
        self._file, self._is_damaged = (0, 0), False
        self._connection = self._open()
        self.interrupted = self._close_interrupted()

    def keep(self, events: Iterable[Event], *, now: int) -> None:
        """Keep the newest state of some events, all of them or none.

        Args:
            events: each replaces what is known of its id.
            now: wall time in ns, told as the end of those that are interrupted.

        Raises:
            OSError: the disk is full or cannot be written; nothing is changed.
            StoreFullError: the store is full of pinned events.
        """
        rows = [
            (
                event.kind,
                event.robot,
                event.rule,
                event.began,
                event.ended,
                now,
                event.bag,
                event.to_json('ended'),
                event.id,
            )
            for event in events
        ]
        with self._transaction():
            self._make_room()
            for row in rows:
                if not self._connection.execute(_CHANGE, row).rowcount:
                    self._connection.execute(_ADD, row)

    def pin(self, number: int, *, pinned: bool = True) -> bool:
        """Let an event stay when the store is full, or not; return whether there is such an event.

        Raises:
            OSError: see :meth:`keep`.
        """
        with self._transaction():
            return _pin(self._connection, number, pinned)

    def name_bag(self, ids: Sequence[str], bag: str | None) -> list[Event]:
        """Name the recording of the seconds around some events; return these.

        Args:
            ids: of events in the store; others are passed over.
            bag: its path; None: it was removed.

        Raises:
            OSError: see :meth:`keep`.
        """
        with self._transaction():
            named: list[Stored] = []
            for item in ids:
                self._connection.execute('UPDATE events SET bag = ? WHERE id = ?', (bag, item))
                named += _select_where(self._connection, 'id = :id', {'id': item})
            return [stored.event for stored in named]

    def hear_open(self, now: int) -> None:
        """Note that what goes on still does, for the end of what will be interrupted.

        Raises:
            OSError: see :meth:`keep`.
        """
        with self._transaction():
            self._connection.execute('UPDATE events SET heard = ? WHERE ended IS NULL', (now,))

    def pinned_bags(self) -> set[str]:
        """Return the recordings that must stay, for a pinned event names them."""
        rows = self._connection.execute(
            'SELECT DISTINCT bag FROM events WHERE pinned AND bag IS NOT NULL'
        )
        return {bag for (bag,) in rows}

    def events(self, wanted: Filter | None = None, *, newest: int | None = None) -> list[Stored]:
        """Return events, see :meth:`EventReader.events`."""
        return list(_select(self._connection, wanted or Filter(), newest))

    @property
    def used_bytes(self) -> int:
        """How large the store is, without room that it will fill again."""
        pages, free, size = (
            self._connection.execute(f'PRAGMA {name}').fetchone()[0]
            for name in ('page_count', 'freelist_count', 'page_size')
        )
        return int((pages - free) * size)

    def __len__(self) -> int:
        return int(self._connection.execute('SELECT count(*) FROM events').fetchone()[0])

    def close(self) -> None:
        """Close the file."""
        with suppress(sqlite3.Error):
            self._connection.close()
        self._lock.release()

    def check_file(self) -> str:
        """Open the file anew if it was damaged or removed meanwhile; return what was wrong.

        Raises:
            OccError: it cannot be opened.
            OSError: it cannot be written.
        """
        problem = 'it was damaged' if self._is_damaged else ''
        if not self._is_damaged:
            try:
                state = os.stat(self.path)
                if (state.st_dev, state.st_ino) != self._file:
                    problem = 'another file is in its place'
            except FileNotFoundError:
                problem = 'it was removed'
        if problem:
            with suppress(sqlite3.Error):
                self._connection.close()
            self._connection = self._open()
        return problem

    def _open(self) -> sqlite3.Connection:
        try:
            try:
                connection = self._connect()
            except sqlite3.DatabaseError as error:
                if not _is_damage(error):
                    raise
                self.damaged = _set_aside(self.path)
                connection = self._connect()
        except sqlite3.Error as error:
            raise _told(error, self.path) from error
        state = os.stat(self.path)
        self._file, self._is_damaged = (state.st_dev, state.st_ino), False
        return connection

    def _connect(self) -> sqlite3.Connection:
        connection = sqlite3.connect(
            self.path, timeout=_BUSY_SECONDS, isolation_level=None, check_same_thread=False
        )
        try:
            is_new = not connection.execute('PRAGMA schema_version').fetchone()[0]
            if not is_new:
                _check(connection, self.path)
                if connection.execute('PRAGMA quick_check(1)').fetchone()[0] != 'ok':
                    raise sqlite3.DatabaseError('database disk image is malformed')
            connection.execute('PRAGMA journal_mode = WAL')
            # Also a power cut then costs nothing that was kept; NORMAL would survive kills only.
            connection.execute('PRAGMA synchronous = FULL')
            # The log must not need much more room than the store itself.
            connection.execute(f'PRAGMA wal_autocheckpoint = {_LOG_PAGES}')
            connection.execute(f'PRAGMA journal_size_limit = {_LOG_PAGES << 12}')
            if is_new:
                connection.execute('BEGIN IMMEDIATE')
                connection.execute(_TABLE)
                connection.execute(_INDEX)
                connection.execute(f'PRAGMA application_id = {_APPLICATION}')
                connection.execute(f'PRAGMA user_version = {STORE_SCHEMA}')
                connection.execute('COMMIT')
        except BaseException:
            connection.close()
            raise
        return connection

    def _close_interrupted(self) -> list[Event]:
        """Close what an earlier program left open, at the time at which it last wrote of it."""
        rows = self._connection.execute(
            'SELECT document, bag, heard FROM events WHERE ended IS NULL'
        ).fetchall()
        closed = []
        for document, bag, heard in rows:
            event = _event(document, bag)
            reason = f'{event.reason}; {_INTERRUPTED}' if event.reason else _INTERRUPTED
            closed.append(replace(event, ended=max(heard, event.worst), reason=reason))
        if closed:
            with suppress(OSError, StoreFullError):
                self.keep(closed, now=max(heard for _, _, heard in rows))
        return closed

    def _make_room(self) -> None:
        """Remove the oldest events if the store is larger than allowed."""
        if self.used_bytes <= self._max_bytes:
            return
        while self.used_bytes > self._max_bytes * _FILLED:
            removed = self._connection.execute(
                'DELETE FROM events WHERE number IN (SELECT number FROM events '
                'WHERE NOT pinned AND ended IS NOT NULL ORDER BY number LIMIT ?)',
                (_REMOVED_AT_ONCE,),
            ).rowcount
            if not removed:
                if self.used_bytes <= self._max_bytes:
                    return
                raise StoreFullError(
                    f'{self.path} holds {self._max_bytes} bytes of pinned events; allowed are more '
                    'bytes, or fewer pins (occ events pin --off)'
                )

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        try:
            self._connection.execute('BEGIN IMMEDIATE')
            yield
            self._connection.execute('COMMIT')
        except sqlite3.Error as error:
            self._roll_back()
            self._is_damaged |= _is_damage(error)
            # On a full disk, what the log holds may still find room in the file itself.
            with suppress(sqlite3.Error):
                self._connection.execute('PRAGMA wal_checkpoint(TRUNCATE)')
            raise OSError(f'cannot write {self.path}: {error}') from error
        except BaseException:
            self._roll_back()
            raise

    def _roll_back(self) -> None:
        with suppress(sqlite3.Error):
            if self._connection.in_transaction:
                self._connection.execute('ROLLBACK')


class EventReader:
    """Reads a store, also while a recorder writes it.

    Args:
        path: the SQLite file.

    Raises:
        OccError: it cannot be read, or is no store of a schema that is known here.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._connection = _connect_to_read(self.path)
        except sqlite3.Error as error:
            raise _told(error, self.path) from error

    def events(self, wanted: Filter | None = None, *, newest: int | None = None) -> list[Stored]:
        """Return events in the order in which they came.

        Args:
            wanted: which; None: all.
            newest: only so many, the newest ones; None: all.

        Raises:
            DataError: the file is damaged.
        """
        try:
            return list(_select(self._connection, wanted or Filter(), newest))
        except sqlite3.Error as error:
            raise _told(error, self.path) from error

    def find(self, name: str) -> Stored | None:
        """Return the event with this number, or with an id that begins so; None without one.

        Raises:
            DataError: the file is damaged, or several ids begin so.
        """
        try:
            rows = list(
                _select_where(
                    self._connection,
                    'number = :number OR (length(:id) >= 6 AND substr(id, 1, length(:id)) = :id)',
                    {'number': int(name) if name.isdecimal() and len(name) < 6 else -1, 'id': name},
                )
            )
        except sqlite3.Error as error:
            raise _told(error, self.path) from error
        if len(rows) > 1:
            raise DataError(
                f'{len(rows)} events of {self.path} begin with {name!r}; allowed is one'
            )
        return rows[0] if rows else None

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


def pin_event(path: str | Path, number: int, *, pinned: bool) -> bool:
    """Pin or unpin an event of a store that a recorder may have open; see `EventStore.pin`.

    Raises:
        OccError: it cannot be written, or is no store of a schema that is known here.
    """
    EventReader(path).close()
    try:
        with (
            closing(
                sqlite3.connect(f'{_uri(Path(path))}?mode=rw', uri=True, timeout=_BUSY_SECONDS)
            ) as connection,
            connection,
        ):
            return _pin(connection, number, pinned)
    except sqlite3.Error as error:
        raise OccError(f'cannot write {path}: {error}') from error


def _pin(connection: sqlite3.Connection, number: int, pinned: bool) -> bool:
    return bool(
        connection.execute(
            'UPDATE events SET pinned = ? WHERE number = ?', (pinned, number)
        ).rowcount
    )


def _connect_to_read(path: Path) -> sqlite3.Connection:
    if not path.is_file():
        raise DataError(f'there is no event store {path}; allowed is the file of an event_recorder')
    connection = sqlite3.connect(f'{_uri(path)}?mode=ro', uri=True, timeout=_BUSY_SECONDS)
    try:
        try:
            connection.execute('PRAGMA schema_version').fetchone()
        except sqlite3.OperationalError:
            # What nobody has open, in a directory that we may not write, needs no log.
            connection.close()
            connection = sqlite3.connect(f'{_uri(path)}?immutable=1', uri=True)
        _check(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def _uri(path: Path) -> str:
    return path.absolute().as_uri()


def _check(connection: sqlite3.Connection, path: Path) -> None:
    application, version = (
        connection.execute(f'PRAGMA {name}').fetchone()[0]
        for name in ('application_id', 'user_version')
    )
    if application != _APPLICATION:
        raise ConfigurationError(
            f'{path} is no event store but another database; allowed is a store or a new file'
        )
    if version > STORE_SCHEMA:
        raise ConfigurationError(
            f'{path} is an event store of schema {version}; allowed is {STORE_SCHEMA} at most: '
            'update occ_constraints, or give another directory'
        )


def _select(connection: sqlite3.Connection, wanted: Filter, newest: int | None) -> Iterator[Stored]:
    condition, values = wanted.condition()
    return _select_where(connection, condition, values, newest)


def _select_where(
    connection: sqlite3.Connection,
    condition: str,
    values: dict[str, Any],
    newest: int | None = None,
) -> Iterator[Stored]:
    query = (
        f'SELECT number, document, bag, pinned FROM events WHERE {condition} '
        'ORDER BY number DESC LIMIT :newest'
    )
    limit = -1 if newest is None else newest
    rows = connection.execute(query, {**values, 'newest': limit}).fetchall()
    for number, document, bag, pinned in reversed(rows):
        yield Stored(number, _event(document, bag), bool(pinned))


def _event(document: str, bag: str | None) -> Event:
    try:
        return replace(Event.from_plain(json.loads(document)), bag=bag)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise sqlite3.DatabaseError(f'an event in it is damaged ({error})') from error


def _is_damage(error: sqlite3.Error) -> bool:
    code = getattr(error, 'sqlite_errorcode', None)
    return code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB) or 'malformed' in str(error)


def _set_aside(path: Path) -> Path:
    """Rename a damaged store with its log to the first free name, and return that."""
    number = 0
    while True:
        target = path.with_name(f'{path.name}.damaged{f".{number}" if number else ""}')
        if not target.exists():
            break
        number += 1
    for suffix in ('', '-wal', '-shm'):
        source = path.with_name(path.name + suffix)
        if source.exists():
            os.replace(source, target.with_name(target.name + suffix))
    return target


def _told(error: sqlite3.Error, path: Path) -> OccError:
    return DataError(f'cannot read the event store {path}: {error}')
