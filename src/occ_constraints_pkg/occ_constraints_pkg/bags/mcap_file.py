# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Index of one MCAP file, whole or cut short, and the messages of its parts.

The record layouts are those of the MCAP specification, https://mcap.dev/spec. Records that occur
once or a few times are parsed by the ``mcap`` library; messages, of which there are millions, are
unpacked here, which is several times as fast and lets a cut-off chunk give up what it still holds.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from occ_constraints_pkg.errors import OccError

MAGIC = b'\x89MCAP0\r\n'
_HEAD = struct.Struct('<BQ')  # opcode, length of the body
_MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK = struct.Struct('<QQQII')  # start, end, uncompressed size, CRC, length of compression name
_FOOTER_SIZE = _HEAD.size + 20 + len(MAGIC)
_RUN_BYTES = 1 << 20
# Errors that the parsers of other people's libraries raise on damaged bytes.
_DAMAGE = (McapError, struct.error, UnicodeDecodeError, EOFError, KeyError, IndexError, ValueError)


@dataclass(frozen=True)
class Segment:
    """A part of a file that is loaded at once: a chunk, or a run of messages outside of chunks.

    Attributes:
        start_ns: no message in it was logged earlier.
        end_ns: no message in it was logged later.
        offset: where its first record begins in the file.
        length: bytes up to the end of its last record, or of the file where that is cut short.
        chunk: whether it is a chunk.
        cut: whether the file ends inside it.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    chunk: bool
    cut: bool = False


@dataclass
class McapIndex:
    """What an MCAP file holds and where.

    Attributes:
        path: the file.
        schemas: schema id to record.
        channels: channel id to record.
        counts: channel id to number of messages.
        segments: the parts that hold messages, in file order.
        warning: what is missing or damaged, in one sentence; empty when nothing is.
    """

    path: Path
    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    segments: list[Segment] = field(default_factory=list)
    warning: str = ''


def index_mcap(path: Path) -> McapIndex:
    """Index an MCAP file from its summary, or by reading through it where that does not suffice.

    Raises:
        OccError: the file cannot be read or is not MCAP.
    """
    try:
        with path.open('rb') as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise OccError(f'{path} is not an MCAP file: it does not begin with the MCAP magic')
            return _from_summary(path, file) or _from_scan(path, file)
    except OSError as error:
        raise OccError(f'cannot read {path}: {error.strerror}') from error


def load_segment(index: McapIndex, file: BinaryIO, segment: Segment) -> list[tuple]:
    """Return ``(log_time_ns, channel_id, data)`` of a segment's messages, in log order.

    Messages of equal time keep the order in which they were written.

    Raises:
        OccError: the segment is damaged.
    """
    file.seek(segment.offset)
    stored = file.read(segment.length)
    try:
        records_ = _unpack_chunk(stored, cut=segment.cut) if segment.chunk else stored
        messages = list(_messages(index, records_, cut=segment.cut))
    except _DAMAGE as error:
        raise OccError(
            f'{index.path} is damaged: the chunk at byte {segment.offset} cannot be read ({error})'
        ) from error
    messages.sort(key=_log_time)
    return messages


def _log_time(message: tuple) -> int:
    return message[0]


def _messages(index: McapIndex, buffer: bytes, *, cut: bool = False) -> Iterator[tuple]:
    """Walk over the records of a chunk or run; learn its schemas and channels on the way."""
    position, size = 0, len(buffer)
    while position < size:
        body = position + _HEAD.size
        opcode, length = _HEAD.unpack_from(buffer, position) if body <= size else (0, 0)
        position = body + length
        if position > size:
            if cut:
                return
            raise ValueError(f'a record reaches {position - size} bytes past its end')
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = _MESSAGE.unpack_from(buffer, body)
            if channel not in index.channels:
                raise ValueError(f'a message belongs to the unknown channel {channel}')
            yield log_time, channel, buffer[body + _MESSAGE.size : position]
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _learn(index, opcode, buffer[body:position])


def _learn(index: McapIndex, opcode: int, body: bytes) -> None:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = records.Schema.read(stream)
        index.schemas[schema.id] = schema
    else:
        channel = records.Channel.read(stream)
        index.channels[channel.id] = channel


def _unpack_chunk(record: bytes, *, cut: bool) -> bytes:
    """Return the records within a chunk record; of a cut one, as much as can be unpacked."""
    body = _HEAD.size
    _, _, size, crc, name_length = _CHUNK.unpack_from(record, body)
    name_end = body + _CHUNK.size + name_length
    compression = record[body + _CHUNK.size : name_end].decode()
    stored_size = struct.unpack_from('<Q', record, name_end)[0]
    stored = record[name_end + 8 : name_end + 8 + stored_size]
    if compression not in ('', 'zstd', 'lz4'):
        raise ValueError(f'compression {compression!r}; allowed are zstd, lz4 and none')
    try:
        if compression == 'zstd':
            stored = zstandard.ZstdDecompressor().decompressobj().decompress(stored)
        elif compression == 'lz4':
            stored = lz4.frame.LZ4FrameDecompressor().decompress(stored)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise ValueError(f'its {compression} data are invalid: {error}') from error
    if not cut:
        if len(stored) != size:
            raise ValueError(f'it holds {len(stored)} bytes instead of {size}')
        if crc and zlib.crc32(stored) != crc:
            raise ValueError('its checksum is wrong')
    return stored


def _from_summary(path: Path, file: BinaryIO) -> McapIndex | None:
    """Return the index that the file's summary gives, or None where it does not tell all."""
    size = os.fstat(file.fileno()).st_size
    if size < len(MAGIC) + _FOOTER_SIZE:
        return None
    file.seek(size - _FOOTER_SIZE)
    footer = file.read()
    opcode, length = _HEAD.unpack_from(footer)
    start = struct.unpack_from('<Q', footer, _HEAD.size)[0]
    if opcode != Opcode.FOOTER or length != 20 or footer[-8:] != MAGIC or not start < size:
        return None
    if start == 0:
        return None
    index, statistics = McapIndex(path), None
    file.seek(start)
    summary = file.read(size - _FOOTER_SIZE - start)
    try:
        for opcode, body in _records(summary):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                _learn(index, opcode, body)
            elif opcode == Opcode.STATISTICS:
                statistics = records.Statistics.read(ReadDataStream(BytesIO(body)))
            elif opcode == Opcode.CHUNK_INDEX:
                chunk = records.ChunkIndex.read(ReadDataStream(BytesIO(body)))
                index.segments.append(
                    Segment(
                        chunk.message_start_time,
                        chunk.message_end_time,
                        chunk.chunk_start_offset,
                        chunk.chunk_length,
                        chunk=True,
                    )
                )
    except _DAMAGE:
        return None
    if statistics is None:
        return None
    index.counts.update(statistics.channel_message_counts)
    told = (
        len(index.channels) == statistics.channel_count
        and len(index.segments) == statistics.chunk_count > 0
        and sum(index.counts.values()) == statistics.message_count
        and index.counts.keys() <= index.channels.keys()
        and all(channel.schema_id in (0, *index.schemas) for channel in index.channels.values())
    )
    index.segments.sort(key=lambda segment: segment.offset)
    return index if told else None


def _records(buffer: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position < len(buffer):
        opcode, length = _HEAD.unpack_from(buffer, position)
        position += _HEAD.size + length
        if position > len(buffer):
            raise ValueError('a record reaches past the end of the summary')
        yield opcode, buffer[position - length : position]


def _from_scan(path: Path, file: BinaryIO) -> McapIndex:
    """Index a file by reading through it, up to where it ends or stops making sense."""
    index = McapIndex(path)
    size = os.fstat(file.fileno()).st_size
    position, run = len(MAGIC), None
    while True:
        file.seek(position)
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        end = position + _HEAD.size + length
        loose = opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL) and end <= size
        if run is not None and (not loose or end - run > _RUN_BYTES):
            _add(index, file, Segment(0, 0, run, position - run, chunk=False))
            run = None
        if loose and run is None:
            run = position
        if opcode == Opcode.CHUNK:
            length = min(end, size) - position
            _add(index, file, Segment(0, 0, position, length, chunk=True, cut=end > size))
        if opcode in (0, Opcode.DATA_END, Opcode.FOOTER) or end > size or index.warning:
            break
        position = end
    if opcode not in (Opcode.DATA_END, Opcode.FOOTER) and not index.warning:
        _warn(index, f'the file ends, or is no longer readable, at byte {position} of {size}')
    return index


def _add(index: McapIndex, file: BinaryIO, segment: Segment) -> None:
    """Count a segment's messages and note it; a damaged one ends the part that is used."""
    try:
        messages = load_segment(index, file, segment)
    except OccError as error:
        _warn(index, str(error))
        return
    if not messages:
        return
    index.counts.update(channel for _, channel, _ in messages)
    times = messages[0][0], messages[-1][0]
    index.segments.append(
        Segment(*times, segment.offset, segment.length, segment.chunk, segment.cut)
    )


def _warn(index: McapIndex, what: str) -> None:
    count = sum(index.counts.values())
    index.warning = (
        f'{index.path} was not finished by its recorder: {what}; '
        f'the {count} complete messages before that are used'
    )
