# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A SQLite storage file of rosbag2, complete or truncated; it is never written to."""

from __future__ import annotations

import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.qos import parse_profiles
from occ_constraints_pkg.rosbag.storage import (
    MAX_PIECE_BYTES,
    Block,
    Segment,
    TopicInfo,
    with_counts,
)

MAGIC = b'SQLite format 3\0'
# Magic, page size, change counter, number of pages, change counter for which that is valid.
_HEADER = struct.Struct('>16sH6xII60xI4x')
_SEGMENT_BYTES = 1 << 20
_SEGMENT_ROWS = 10_000


class SqliteFile:
    """Index of a SQLite storage file of any schema that rosbag2 has had.

    A truncated or damaged file is used up to the last row before the damage.

    Args:
        path: what errors and warnings call it.
        file: where it is readable; None: there.

    Attributes:
        path: the file's name.
        topics: topic number to its name and what is known of it.
        segments: runs of rows, in file order.
        warning: what is missing or damaged, in one sentence; empty when nothing is.

    Raises:
        OccError: the file cannot be read or is no storage file of rosbag2.
    """

    def __init__(self, path: Path, file: Path | None = None) -> None:
        self.path = path
        self._file = file or path
        self.warning = ''
        self.segments: list[Segment] = []
        self._counts: Counter[int] = Counter()
        try:
            is_truncated = _is_truncated(self._file)
            with closing(_connect(self._file)) as database:
                topics = dict(_topics(database))
                # Pages that are missing show only when the bytes of a message are asked for.
                problem = self._index(database, set(topics), look=is_truncated)
        except (sqlite3.Error, ValueError, OverflowError) as error:
            raise DataError(f'{path} cannot be read: {_reason(error)}') from error
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        if problem:
            self.warning = (
                f'{path} is damaged or truncated: {problem}; the {self._counts.total()} complete '
                f'messages before that are used'
            )
        self.topics = with_counts(topics, self._counts)

    def load(self, segment: Segment) -> Block:
        """Return a segment's messages in log order, those of equal time in order of their rows.

        Raises:
            OccError: the segment is damaged.
        """
        try:
            with closing(_connect(self._file)) as database:
                return _load(database, segment)
        except (sqlite3.Error, ValueError, OverflowError) as error:
            raise DataError(
                f'{self.path} is damaged: the rows from {segment.first} on cannot be read '
                f'({_reason(error)})'
            ) from error

    def _index(self, database: sqlite3.Connection, known: set[int], *, look: bool) -> str:
        """Divide the rows into segments; return what ended that before the last row, or nothing.

        Args:
            database: the open file.
            known: numbers of the topics.
            look: whether to look at the bytes of each message, too.
        """
        data = 'data' if look else 'NULL'
        run = _Run()
        try:
            for row, topic, time, size, _ in database.execute(
                f'SELECT id, topic_id, timestamp, length(data), {data} FROM messages ORDER BY id'
            ):
                problem = _problem(row, topic, time, size, known, run.last)
                if problem:
                    break
                if run.count and (run.size + size > _SEGMENT_BYTES or run.count == _SEGMENT_ROWS):
                    self._add(run)
                    run = _Run(last=run.last)
                run.add(row, topic, time, size)
            else:
                problem = ''
        except (sqlite3.Error, OverflowError) as error:
            problem = str(error)
        self._add(run)
        return problem

    def _add(self, run: _Run) -> None:
        if run.count:
            self._counts.update(run.topics)
            self.segments.append(
                Segment(
                    run.start,
                    run.end,
                    run.first,
                    run.last - run.first + 1,
                    channels=frozenset(run.topics),
                )
            )


class _Run:
    """Rows that become a segment."""

    def __init__(self, last: int | None = None) -> None:
        self.count = self.size = self.first = 0
        self.last = last
        self.start, self.end = 2**63 - 1, 0
        self.topics: Counter[int] = Counter()

    def add(self, row: int, topic: int, time: int, size: int) -> None:
        if not self.count:
            self.first = row
        self.count, self.last = self.count + 1, row
        self.size += size
        self.start, self.end = min(self.start, time), max(self.end, time)
        self.topics[topic] += 1


def _problem(row: Any, topic: Any, time: Any, size: Any, known: set[int], last: int | None) -> str:
    """Say what is wrong with a row, or nothing."""
    if not all(isinstance(item, int) for item in (row, topic, time, size)):
        return f'row {row} lacks a topic, a time or data'
    if last is not None and row <= last:
        return f'row {row} comes after row {last}'
    if topic not in known:
        return f'row {row} belongs to the unknown topic {topic}'
    if time < 0:
        return f'row {row} has the time {time} ns'
    if size > MAX_PIECE_BYTES:
        return f'row {row} has {size} bytes; allowed are {MAX_PIECE_BYTES}'
    return ''


def _is_truncated(path: Path) -> bool:
    """Tell whether a database has fewer pages than it says.

    Raises:
        ValueError: it is no database.
    """
    with path.open('rb') as file:
        header = file.read(_HEADER.size)
    if len(header) < _HEADER.size or not header.startswith(MAGIC):
        raise ValueError('file is not a database')
    _, page, changed, pages, valid = _HEADER.unpack(header)
    # Whoever changes the file without telling the number of pages leaves the two apart.
    return changed == valid and path.stat().st_size < pages * (65536 if page == 1 else page)


def _connect(path: Path) -> sqlite3.Connection:
    # Immutable: SQLite neither locks the file nor writes beside it. Where there is a write-ahead
    # log, the file is a copy of ours.
    log = path.with_name(f'{path.name}-wal')
    mode = 'rw' if log.exists() and log.stat().st_size else 'ro&immutable=1'
    database = sqlite3.connect(f'{path.absolute().as_uri()}?mode={mode}', uri=True)
    if _is_truncated(path):
        # This is how SQLite is told to open a file that lacks pages; nothing is written.
        database.execute('PRAGMA writable_schema = ON')
    # A text column that is not UTF-8 shall not stop the rest.
    database.text_factory = lambda data: data.decode('utf-8', 'replace')
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_PIECE_BYTES)
    database.execute('PRAGMA trusted_schema = OFF')
    return database


def _topics(database: sqlite3.Connection) -> Iterator[tuple[int, tuple[str, TopicInfo]]]:
    tables = {
        name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    }
    if not {'messages', 'topics'} <= tables:
        raise ValueError('it lacks the tables messages and topics of rosbag2')
    definitions: dict[str, tuple[str, str]] = {}
    if 'message_definitions' in tables:
        for name, encoding, text in database.execute(
            'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions '
            'ORDER BY id'
        ):
            definitions.setdefault(str(name), (str(text or ''), str(encoding or '')))
    columns = {row[1] for row in database.execute('PRAGMA table_info(topics)')}
    qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
    for number, name, msgtype, serialization, profiles in database.execute(
        f'SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id'
    ):
        if not isinstance(number, int) or not all(
            isinstance(item, str) for item in (name, msgtype, serialization)
        ):
            raise ValueError(f'its table of topics is damaged at {number!r}')
        info = TopicInfo(
            msgtype,
            0,
            serialization,
            *definitions.get(msgtype, ('', '')),
            parse_profiles(profiles if isinstance(profiles, str) else None),
        )
        yield number, (name, info)


def _load(database: sqlite3.Connection, segment: Segment) -> Block:
    rows = database.execute(
        'SELECT topic_id, timestamp, data FROM messages WHERE id BETWEEN ? AND ? ORDER BY id',
        (segment.first, segment.first + segment.length - 1),
    ).fetchall()
    topics, times, messages = zip(*rows, strict=True) if rows else ((), (), ())
    if not all(isinstance(message, bytes) for message in messages):
        raise ValueError('a message is not stored as bytes')
    ends = np.cumsum([len(message) for message in messages], dtype=np.int64)
    block = Block(
        b''.join(messages),
        np.array(topics, dtype=np.int64),
        np.array(times, dtype=np.int64),
        np.concatenate([[0], ends[:-1]]).astype(np.int64),
        ends,
    )
    return block.select(np.argsort(block.times, kind='stable'))


def _reason(error: Exception) -> str:
    """Return what SQLite says, which may quote lines of a damaged schema, in one line."""
    return ' '.join(str(error).split()).rstrip('.')
