# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A directory of recordings of events: numbered, whole or not there, and within a quota."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Set
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import parse_yaml, read_text
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import DirectoryLock, make_directory, sync_directory
from occ_constraints_pkg.rosbag.writer import BagWriter, check_compression

CUSTOM_KEY = 'occ_constraints_events'
"""Key under ``custom_data`` of metadata.yaml that tells the recording of an event."""

_UNFINISHED = '.unfinished'
# The number comes first: a clock that was wrong gives no wrong order.
_DOCUMENT = re.compile(rf'^ +{CUSTOM_KEY}: (".*")$', re.MULTILINE)
_NAME = re.compile(r'event_(\d{6,})_\S*')
_MOST_LABEL = 60
# The index of each chunk has a record for each topic: with small ones they take half the time.
_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class EventBag:
    """A finished recording of an event.

    Attributes:
        path: its directory.
        number: counts up, so smaller ones are older, whatever the clocks said.
        size: bytes on disk.
    """

    path: Path
    number: int
    size: int


@dataclass(frozen=True)
class RemovedBag:
    """A recording that had to go.

    Attributes:
        path: its directory.
        events: ids of its events.
    """

    path: Path
    events: tuple[str, ...]


class Draft:
    """A recording that is being written, and that nobody takes for a whole one.

    Attributes:
        path: where it will be when it is finished.
        writer: writes it.
    """

    def __init__(self, path: Path, writer: BagWriter) -> None:
        self.path, self.writer = path, writer

    def finish(self) -> EventBag:
        """End the recording, see it to the disk, and give it its name.

        Raises:
            OccError: a file cannot be written.
        """
        self.writer.close()
        folder = self.writer.directory
        try:
            for file in folder.iterdir():
                _sync(file)
            sync_directory(folder)
            folder.rename(self.path)
            sync_directory(self.path.parent)
        except OSError as error:
            raise OccError(f'cannot write {self.path}: {error.strerror}') from error
        found = _bag_at(self.path)
        if found is None:
            raise OccError(f'{self.path} has gone while it was written')
        return found

    def discard(self) -> None:
        """Remove what has been written."""
        with suppress(OccError):
            self.writer.close()
        shutil.rmtree(self.writer.directory, ignore_errors=True)


class EventBags:
    """Recordings of events in one directory, the oldest of which go when there are too many.

    A recording is written below ``.unfinished`` and renamed when it is whole and on the disk; so
    what has its proper name is whole, also after a crash or a power failure. It is removed in the
    same way, renamed first. A directory belongs to one recorder at a time.

    Nothing is ever removed but what a recorder has written: by its name and by what its
    ``metadata.yaml`` says.

    Attributes:
        directory: where they are.
        pinned: paths of recordings that stay; to be set by whoever knows.
        interrupted: recordings that a recorder began and did not finish, before this one started:
            below ``.unfinished``; the quota removes them first.

    Args:
        directory: made if missing.
        quota: the most bytes that all may take together; 0: as many as the disk holds.
        compression: ``zstd``, ``lz4`` or ``none``.

    Raises:
        OccError: the directory cannot be made or read, or another recorder uses it; or there
            is no such compression.
    """

    def __init__(self, directory: str | Path, quota: int = 0, compression: str = 'zstd') -> None:
        check_compression(compression)
        self.directory = make_directory(directory).resolve()
        self._hidden = make_directory(self.directory / _UNFINISHED)
        self._lock = DirectoryLock(self._hidden)
        self.pinned: Set[str] = frozenset()
        self._quota, self._compression = quota, compression
        self._bags = event_bags(self.directory)
        try:
            self.interrupted = sorted(path for path in self._hidden.iterdir() if path.is_dir())
        except OSError as error:
            raise OccError(f'cannot read {self._hidden}: {error.strerror}') from error
        taken = [bag.number for bag in self._bags]
        taken += [int(match[1]) for path in self.interrupted if (match := _match(path))]
        self._last = max(taken, default=0)

    def next_path(self, time_ns: int, label: str) -> Path:
        """Return where the next recording will be, and take this name.

        Args:
            time_ns: wall time for people.
            label: a word or two for people.
        """
        self._last += 1
        when = datetime.fromtimestamp(time_ns / 1e9, UTC).strftime('%Y-%m-%dT%H-%M-%SZ')
        words = re.sub(r'[^A-Za-z0-9]+', '_', label).strip('_')[:_MOST_LABEL]
        return self.directory / f'event_{self._last:06d}_{when}{"_" if words else ""}{words}'

    def begin(self, path: Path, custom: str) -> Draft:
        """Begin a recording.

        Args:
            path: from :meth:`next_path`.
            custom: what metadata.yaml says under :data:`CUSTOM_KEY` until there is more to say.

        Raises:
            OccError: it cannot be written.
        """
        folder = self._hidden / path.name
        try:
            writer = BagWriter(
                folder,
                compression=self._compression,
                chunk_bytes=_CHUNK_BYTES,
                custom_data={CUSTOM_KEY: custom},
            )
        except OccError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return Draft(path, writer)

    def add(self, bag: EventBag) -> None:
        """Count a finished recording in."""
        self._bags.append(bag)

    def make_room(self, needed: int) -> tuple[list[RemovedBag], bool]:
        """Remove the oldest recordings that are not pinned until others have room.

        Args:
            needed: bytes of what is being written.

        Returns:
            What was removed, and whether there is room now.
        """
        if not self._quota:
            return [], True
        # Somebody may have removed or moved one.
        self._bags = [bag for bag in self._bags if bag.path.is_dir()]
        removed: list[RemovedBag] = []
        kept = []
        used = needed + sum(bag.size for bag in self._bags)
        used += sum(_size_of(path) for path in self.interrupted)
        while self.interrupted and used > self._quota:
            path = self.interrupted.pop(0)
            used -= _size_of(path)
            removed.append(RemovedBag(path, ids_of(path)))
            shutil.rmtree(path, ignore_errors=True)
        for bag in self._bags:
            if used <= self._quota or str(bag.path) in self.pinned:
                kept.append(bag)
                continue
            ids = ids_of(bag.path)
            if self._remove(bag):
                used -= bag.size
                removed.append(RemovedBag(bag.path, ids))
            else:
                kept.append(bag)
        self._bags = kept
        return removed, used <= self._quota

    def _remove(self, bag: EventBag) -> bool:
        hidden = self._hidden / f'{bag.path.name}.removed'
        try:
            # What is half removed shall not look whole either.
            bag.path.rename(hidden)
        except OSError:
            return False
        shutil.rmtree(hidden, ignore_errors=True)
        return True


def event_bags(directory: Path) -> list[EventBag]:
    """Return the finished recordings of events in a directory, the oldest first.

    Raises:
        OccError: the directory cannot be read.
    """
    try:
        found = [_bag_at(path) for path in directory.iterdir()]
    except OSError as error:
        raise OccError(f'cannot read {directory}: {error.strerror}') from error
    return sorted((bag for bag in found if bag is not None), key=lambda bag: bag.number)


def event_document(bag: Path) -> dict[str, Any]:
    """Return what the recording of an event says of itself; empty where there is no such thing.

    It is what :meth:`.EventBagWriter.end` wrote; some of the keys are ``events``, ``complete`` and
    ``reason``.
    """
    try:
        # One line of a long file, of which the rest takes a general parser half a second.
        line = _DOCUMENT.search(read_text(bag / 'metadata.yaml'))
        document = json.loads(parse_yaml(line[1], 'it')) if line else {}
    except (OccError, ValueError, TypeError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def ids_of(bag: Path) -> tuple[str, ...]:
    """Return the ids of the events in a recording, as far as it tells."""
    events = event_document(bag).get('events', ())
    return tuple(str(event.get('id')) for event in events if isinstance(event, dict))


def _match(path: Path) -> re.Match[str] | None:
    return _NAME.fullmatch(path.name)


def _bag_at(path: Path) -> EventBag | None:
    match = _match(path)
    if match is None or path.is_symlink() or not path.is_dir():
        return None
    try:
        if not _DOCUMENT.search(read_text(path / 'metadata.yaml')):
            return None
    except OccError:
        return None
    return EventBag(path, int(match[1]), _size_of(path))


def _size_of(folder: Path) -> int:
    """Return the bytes that the files of a folder take on the disk."""
    size = 0
    with suppress(OSError):
        for file in folder.iterdir():
            size += file.lstat().st_blocks * 512
    return size


def _sync(file: Path) -> None:
    descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
