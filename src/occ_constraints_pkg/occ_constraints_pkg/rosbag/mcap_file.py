# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file, complete or truncated: what it holds and where."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.rosbag.mcap_records import (
    DAMAGE,
    HEAD,
    MAGIC,
    indexed,
    numbers_at,
    records_of,
    unpack_chunk,
    walked,
)
from occ_constraints_pkg.rosbag.qos import parse_profiles
from occ_constraints_pkg.rosbag.storage import (
    MAX_PIECE_BYTES,
    Block,
    Segment,
    TopicInfo,
    with_counts,
)

_MESSAGE_SIZE = 22  # channel (2 bytes), sequence (4), log time (8), publish time (8)
_FOOTER_SIZE = HEAD.size + 20 + len(MAGIC)
_RUN_BYTES = 1 << 20


class McapFile:
    """Index of an MCAP file, made from its summary or, where that does not suffice, by reading it.

    A file that its recorder did not finish is used up to the last complete message.

    Args:
        path: what errors and warnings call it.
        file: where it is readable; None: there.

    Attributes:
        path: the file's name.
        topics: channel number to topic name and what is known of it.
        segments: the parts that hold messages, in file order.
        warning: what is missing or damaged, in one sentence; empty when nothing is.

    Raises:
        OccError: the file cannot be read or is not MCAP.
    """

    def __init__(self, path: Path, file: Path | None = None) -> None:
        self.path = path
        self._file = file or path
        self.warning = ''
        self.segments: list[Segment] = []
        self._schemas: dict[int, records.Schema] = {}
        self._channels: dict[int, records.Channel] = {}
        self._counts: Counter[int] = Counter()
        # Where a chunk that the end of the file truncates begins.
        self._truncated: int | None = None
        try:
            with self._file.open('rb') as file:
                self._size = os.fstat(file.fileno()).st_size
                if file.read(len(MAGIC)) != MAGIC:
                    raise DataError(
                        f'{path} is not an MCAP file: it does not begin with the MCAP magic'
                    )
                if not self._read_summary(file):
                    self.segments.clear()
                    self._schemas.clear()
                    self._channels.clear()
                    self._counts.clear()
                    self._scan(file)
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        topics = {number: self._topic(channel) for number, channel in self._channels.items()}
        self.topics = with_counts(topics, self._counts)

    def load(self, segment: Segment) -> Block:
        """Return a segment's messages in log order, those of equal time in file order.

        Raises:
            OccError: the segment is damaged.
        """
        try:
            with self._file.open('rb') as file:
                block = self._read(file, segment)
        except OSError as error:
            raise DataError(f'cannot read {self.path}: {error.strerror}') from error
        if len(block) and not segment.start_ns <= block.times[0] <= block.times[-1] <= (
            segment.end_ns
        ):
            raise self._damage(segment, 'its messages are of other times than the summary says')
        return block

    def _damage(self, segment: Segment, what: object) -> OccError:
        kind = 'chunk' if segment.chunk else 'part'
        return DataError(
            f'{self.path} is damaged: the {kind} at byte {segment.first} cannot be read ({what})'
        )

    def _topic(self, channel: records.Channel) -> tuple[str, TopicInfo]:
        schema = self._schemas.get(channel.schema_id)
        return channel.topic, TopicInfo(
            schema.name if schema else '',
            0,
            channel.message_encoding,
            schema.data.decode('utf-8', 'replace') if schema else '',
            schema.encoding if schema else '',
            parse_profiles(channel.metadata.get('offered_qos_profiles')),
        )

    def _read(self, file: BinaryIO, segment: Segment) -> Block:
        truncated = segment.first == self._truncated
        try:
            if segment.length > MAX_PIECE_BYTES:
                raise ValueError(f'it has {segment.length} bytes; allowed are {MAX_PIECE_BYTES}')
            file.seek(segment.first)
            data, index = file.read(segment.length), b''
            if segment.chunk:
                data = unpack_chunk(data, truncated=truncated)
                index = file.read(segment.index_length)
            return self._messages(data, index, truncated=truncated)
        except DAMAGE as error:
            raise self._damage(segment, error or type(error).__name__) from error

    def _messages(self, data: bytes | memoryview, index: bytes, *, truncated: bool) -> Block:
        """Find the messages among the records of a chunk or run; learn channels on the way."""
        begins, ends = indexed(data, index) or walked(data, truncated=truncated)
        opcodes = np.frombuffer(data, dtype=np.uint8)[begins]
        for row in np.flatnonzero((opcodes == Opcode.SCHEMA) | (opcodes == Opcode.CHANNEL)):
            body = data[begins[row] + HEAD.size : ends[row]]
            self._learn(opcodes[row], bytes(body))
        rows = np.flatnonzero(opcodes == Opcode.MESSAGE)
        bodies, ends = begins[rows] + HEAD.size, ends[rows]
        if (ends - bodies < _MESSAGE_SIZE).any():
            raise ValueError('a message is too short to have a time')
        channels = numbers_at(data, bodies, '<u2').astype(np.int64)
        times = numbers_at(data, bodies + 6, '<u8').astype(np.int64)
        if (times < 0).any():
            raise ValueError('a message has a time above 2^63 - 1 ns')
        unknown = set(np.flatnonzero(np.bincount(channels)).tolist()) - self._channels.keys()
        if unknown:
            raise ValueError(f'a message belongs to the unknown channel {min(unknown)}')
        block = Block(data, channels, times, bodies + _MESSAGE_SIZE, ends)
        rising = len(times) < 2 or bool((times[1:] >= times[:-1]).all())
        return block if rising else block.select(np.argsort(times, kind='stable'))

    def _learn(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = records.Schema.read(stream)
            if self._schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f'schema {schema.id} is there twice, with different content')
        else:
            channel = records.Channel.read(stream)
            known = self._channels.setdefault(channel.id, channel)
            if (known.topic, known.schema_id, known.message_encoding) != (
                channel.topic,
                channel.schema_id,
                channel.message_encoding,
            ):
                raise ValueError(f'channel {channel.id} is there twice, with different content')

    def _read_summary(self, file: BinaryIO) -> bool:
        """Take the index from the file's summary; tell whether it says all that is needed."""
        if self._size < len(MAGIC) + _FOOTER_SIZE:
            return False
        file.seek(self._size - _FOOTER_SIZE)
        footer = file.read()
        opcode, length = HEAD.unpack_from(footer)
        start, _, crc = struct.unpack_from('<QQI', footer, HEAD.size)
        end = self._size - _FOOTER_SIZE
        if opcode != Opcode.FOOTER or length != 20 or footer[-8:] != MAGIC:
            return False
        if not 0 < start <= end or end - start > MAX_PIECE_BYTES:
            return False
        file.seek(start)
        summary = file.read(end - start)
        # The checksum covers the footer up to the checksum itself.
        if crc and zlib.crc32(footer[: HEAD.size + 16], zlib.crc32(summary)) != crc:
            return False
        statistics, chunks = None, []
        try:
            for opcode, body in records_of(summary):
                stream = ReadDataStream(BytesIO(body))
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._learn(opcode, body)
                elif opcode == Opcode.STATISTICS:
                    statistics = records.Statistics.read(stream)
                elif opcode == Opcode.CHUNK_INDEX:
                    chunks.append(records.ChunkIndex.read(stream))
        except DAMAGE:
            return False
        if statistics is None or not chunks:
            return False
        chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
        self._counts.update(statistics.channel_message_counts)
        self.segments += (
            Segment(
                chunk.message_start_time,
                chunk.message_end_time,
                chunk.chunk_start_offset,
                chunk.chunk_length,
                chunk=True,
                channels=frozenset(chunk.message_index_offsets) or None,
                index_length=min(chunk.message_index_length, MAX_PIECE_BYTES),
            )
            for chunk in chunks
        )
        return (
            len(self._channels) == statistics.channel_count
            and len(chunks) == statistics.chunk_count
            and sum(self._counts.values()) == statistics.message_count
            and self._counts.keys() <= self._channels.keys()
            and all(item.schema_id in (0, *self._schemas) for item in self._channels.values())
            and _chunks_hold_all(file, chunks, start)
        )

    def _scan(self, file: BinaryIO) -> None:
        """Index the file by reading through it, up to where it ends or stops making sense."""
        position, run = len(MAGIC), None
        while True:
            file.seek(position)
            head = file.read(HEAD.size)
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            end = position + HEAD.size + length
            whole = end <= self._size
            loose = opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL) and whole
            if run is not None and (not loose or end - run > _RUN_BYTES):
                if not self._add(file, Segment(0, 0, run, position - run)):
                    return
                run = None
            if loose and run is None:
                run = position
            if opcode == Opcode.CHUNK:
                self._truncated = None if whole else position
                length = min(end, self._size) - position
                if not self._add(file, Segment(0, 0, position, length, chunk=True)):
                    return
            if opcode in (0, Opcode.DATA_END, Opcode.FOOTER) or not whole:
                break
            position = end
        if self._truncated is not None:
            self._warn(
                f'the file ends {end - self._size} bytes before the end of the chunk at byte '
                f'{position}'
            )
        elif opcode not in (Opcode.DATA_END, Opcode.FOOTER):
            self._warn(f'the file ends, or is no longer readable, at byte {position}', position)

    def _add(self, file: BinaryIO, segment: Segment) -> bool:
        """Count a segment's messages and note it; a damaged one ends the part that is used."""
        try:
            block = self._read(file, segment)
        except OccError as error:
            self._warn(str(error), segment.first)
            return False
        if len(block):
            channels, counts = np.unique(block.topics, return_counts=True)
            found = dict(zip(channels.tolist(), counts.tolist(), strict=True))
            self._counts.update(found)
            times = int(block.times[0]), int(block.times[-1])
            place = segment.first, segment.length, segment.chunk
            self.segments.append(Segment(*times, *place, frozenset(found)))
        return True

    def _warn(self, what: str, position: int | None = None) -> None:
        """Say what is wrong, and what of the file is used: all before ``position``, if given."""
        count = sum(self._counts.values())
        self.warning = (
            f'{self.path} was not finished by its recorder or is damaged: {what}; the {count} '
            'complete messages before that are used'
        )
        if position is not None and (lost := self._size - position):
            self.warning += f', the last {lost} of {self._size} bytes are not'


def _chunks_hold_all(file: BinaryIO, chunks: list[records.ChunkIndex], end: int) -> bool:
    """Tell whether no message lies outside of the chunks, where no summary would index it.

    Args:
        file: the MCAP file.
        chunks: its chunks, in file order.
        end: where the summary begins.
    """
    position = len(MAGIC)
    indexed = [
        (item.chunk_start_offset, item.chunk_length + item.message_index_length) for item in chunks
    ]
    for until, following in (*indexed, (end, 0)):
        while position < until:
            file.seek(position)
            head = file.read(HEAD.size)
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            if opcode in (0, Opcode.MESSAGE, Opcode.CHUNK):
                return False
            position += HEAD.size + length
        if position != until:
            return False
        position += following
    return True
