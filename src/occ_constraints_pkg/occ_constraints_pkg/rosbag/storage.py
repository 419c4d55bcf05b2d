# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What storage files of any kind hold, and their messages block by block in log order."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import zstandard

from occ_constraints_pkg.errors import DataError

MAX_PIECE_BYTES = 1 << 28
"""What is loaded at once may have this many bytes; more is taken for damage."""
ZSTD_SUFFIXES = ('.zstd', '.zst')
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_PIECE_BYTES = 1 << 20
# A file that grows by more than this is taken for damage or for malice, before it fills the disk.
_MOST_GROWTH = 2000
# Blocks of less are joined: most work on a block is the same whatever its size.
_BLOCK_BYTES = 1 << 22


@dataclass(frozen=True)
class TopicInfo:
    """What a recording knows about a topic.

    Attributes:
        msgtype: for example ``nav_msgs/msg/Odometry``.
        count: number of messages.
        serialization: ``cdr``, or what else the messages are encoded in.
        definition: text of the message definition as stored; empty when the bag has none.
        definition_format: ``ros2msg``, ``ros2idl`` or empty.
        offered_qos: profiles of the recorded publishers, spelled as in rosbag2 metadata 9.
        conflict: why the topic cannot be read although other topics can: its parts contradict each
            other; empty if they do not.
    """

    msgtype: str
    count: int
    serialization: str = 'cdr'
    definition: str = ''
    definition_format: str = ''
    offered_qos: tuple[dict[str, Any], ...] = ()
    conflict: str = ''


@dataclass(frozen=True, eq=False)
class Block:
    """Messages in log order, still serialized: columns of equal length n.

    Attributes:
        data: the bytes that all of them lie in.
        topics: (n,) which topic each belongs to: within a file the channel's number, in what
            :meth:`Recording.blocks` yields the place in its list of topics.
        times: (n,) int64, log time in ns, not falling.
        starts: (n,) where the message begins in ``data``.
        ends: (n,) where it ends.
    """

    data: bytes | memoryview
    topics: np.ndarray
    times: np.ndarray
    starts: np.ndarray
    ends: np.ndarray

    def __len__(self) -> int:
        return len(self.times)

    def select(self, rows: np.ndarray | slice) -> Block:
        """Return some of the messages: those at row numbers, in a mask, or in a slice."""
        return replace(
            self,
            topics=self.topics[rows],
            times=self.times[rows],
            starts=self.starts[rows],
            ends=self.ends[rows],
        )

    def message(self, row: int) -> bytes:
        """Return the bytes of one message."""
        return bytes(self.data[self.starts[row] : self.ends[row]])

    def mapped(self, convert: Callable[[bytes], bytes]) -> Block:
        """Return a block whose messages are those of this one, each passed through ``convert``."""
        messages = [convert(self.message(row)) for row in range(len(self))]
        ends = np.cumsum([len(message) for message in messages], dtype=np.int64)
        starts = np.append(0, ends[:-1])[: len(ends)]
        return replace(self, data=b''.join(messages), starts=starts, ends=ends)


@dataclass(frozen=True)
class Segment:
    """A part of a storage file that is loaded at once.

    Attributes:
        start_ns: no message in it was logged earlier.
        end_ns: no message in it was logged later.
        first: where it begins: a byte in an MCAP file, a row in a database.
        length: how long it is, in the same unit.
        chunk: whether it is a chunk of an MCAP file and not a run of its records.
        channels: numbers of those channels that have messages in it; None when that is not told.
        index_length: bytes behind a chunk that tell where its messages are.
    """

    start_ns: int
    end_ns: int
    first: int
    length: int
    chunk: bool = False
    channels: frozenset[int] | None = None
    index_length: int = 0


class StorageFile(Protocol):
    """An indexed storage file: its content is known and none of it is held.

    Attributes:
        path: the file.
        topics: channel number to topic name and what is known of it, ``count`` included.
        segments: the parts that hold messages, in file order.
        warning: what is missing or damaged, in one sentence; empty when nothing is.
    """

    path: Path
    topics: dict[int, tuple[str, TopicInfo]]
    segments: list[Segment]
    warning: str

    def load(self, segment: Segment) -> Block:
        """Return a segment's messages, those of equal time in file order.

        Raises:
            OccError: the segment is damaged.
        """


def in_log_order(pieces: Iterable[tuple[int, Callable[[], Block]]]) -> Iterator[Block]:
    """Join pieces that may overlap in time; holds as many of them as overlap, and a few more.

    Args:
        pieces: ``(time before which it has no message, function that loads it)`` of each piece,
            sorted by time. Messages of equal time are taken from the earlier piece first.
    """
    entries = list(pieces)
    held: list[Block] = []
    ready: list[Block] = []
    for number, (_, load) in enumerate(entries):
        block = load()
        if len(block):
            held.append(block)
        # What comes before the beginning of the next piece comes before all that is left.
        following = entries[number + 1][0] if number + 1 < len(entries) else None
        left = []
        for item in held:
            count = len(item)
            place = count if following is None else int(np.searchsorted(item.times, following))
            if place:
                ready.append(item.select(slice(place)))
            if place < count:
                rest = item.select(slice(place, None))
                # A few messages shall not hold a whole piece.
                left.append(rest if place < count / 2 else _copied(rest))
        held = left
        if sum(len(item.data) for item in ready) >= _BLOCK_BYTES or following is None:
            if ready:
                yield _joined(ready)
            ready = []


def _joined(blocks: list[Block]) -> Block:
    """Return one block of all messages in log order, those of equal time block by block."""
    if len(blocks) == 1:
        return blocks[0]
    shifts = np.cumsum([0, *(len(block.data) for block in blocks[:-1])])
    pairs = list(zip(blocks, shifts.tolist(), strict=True))
    merged = Block(
        b''.join([block.data for block in blocks]),
        np.concatenate([block.topics for block in blocks]),
        np.concatenate([block.times for block in blocks]),
        np.concatenate([block.starts + shift for block, shift in pairs]),
        np.concatenate([block.ends + shift for block, shift in pairs]),
    )
    if (merged.times[1:] >= merged.times[:-1]).all():
        return merged
    return merged.select(np.argsort(merged.times, kind='stable'))


def _copied(block: Block) -> Block:
    return block.mapped(bytes)


def with_counts(
    topics: dict[int, tuple[str, TopicInfo]], counts: Counter[int]
) -> dict[int, tuple[str, TopicInfo]]:
    """Return topics by channel with their numbers of messages."""
    return {
        number: (name, replace(info, count=counts[number]))
        for number, (name, info) in topics.items()
    }


def unpack_zstd(data: bytes | memoryview, limit: int, *, truncated: bool = False) -> bytes:
    """Decompress without ever holding much more than is allowed.

    Args:
        data: one or more zstd frames.
        limit: allowed number of bytes.
        truncated: the data may end early; what can be unpacked is returned.

    Raises:
        ValueError: the data are no zstd frames, or hold more.
    """
    try:
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader:
            pieces = []
            try:
                while limit >= 0 and (piece := reader.read(min(limit + 1, 1 << 22))):
                    pieces.append(piece)
                    limit -= len(piece)
            except zstandard.ZstdError:
                if not truncated:
                    raise
    except zstandard.ZstdError as error:
        raise ValueError(f'its zstd data are invalid: {error}') from error
    if limit < 0:
        raise ValueError('its zstd data unpack to more bytes than they should')
    return pieces[0] if len(pieces) == 1 else b''.join(pieces)


class Unpacked:
    """A folder for temporary files that goes when this object does."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._count = 0

    def open(self, path: Path) -> tuple[Path, str]:
        """Return a file that can be read as it is, and a warning if part of it is lost.

        That is the file itself, unless it is compressed as a whole, or is a database beside which
        lies a write-ahead log: to open that one in place would change it.

        Raises:
            OccError: the file cannot be read or unpacked.
        """
        log = path.with_name(f'{path.name}-wal')
        try:
            with path.open('rb') as file:
                compressed = file.read(len(_ZSTD_MAGIC)) == _ZSTD_MAGIC
            if compressed:
                target = self._target(path)
                return target, _decompress(path, target)
            if log.is_file() and log.stat().st_size:
                target = self._target(path)
                shutil.copyfile(path, target)
                shutil.copyfile(log, target.with_name(f'{target.name}-wal'))
                return target, ''
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        return path, ''

    def _target(self, path: Path) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix='occ_bag_'))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._count += 1
        name = path.stem if path.suffix in ZSTD_SUFFIXES else path.name
        return self._folder / f'{self._count}_{name}'


def _decompress(path: Path, target: Path) -> str:
    allowed = path.stat().st_size * _MOST_GROWTH
    written, problem = 0, ''
    with path.open('rb') as source, target.open('wb') as sink:
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
        while True:
            try:
                block = reader.read(_PIECE_BYTES)
            except zstandard.ZstdError as error:
                problem = str(error)
                break
            if not block:
                break
            written += len(block)
            if written > allowed:
                raise DataError(
                    f'{path} cannot be read: it unpacks to more than {_MOST_GROWTH} times its size'
                )
            sink.write(block)
    if not written:
        raise DataError(f'{path} is damaged: nothing of it can be unpacked')
    return f'{path} is damaged: {problem}; its first {written} bytes are used' if problem else ''
