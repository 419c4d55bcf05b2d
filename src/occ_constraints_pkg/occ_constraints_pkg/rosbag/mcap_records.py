# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file, found and unpacked.

The layouts are those of the MCAP specification, https://mcap.dev/spec. Records that occur once or
a few times are parsed by the ``mcap`` library; messages, of which there are millions, are found
here, which is many times as fast, and also reads the beginning of a chunk that is truncated; the
library's ``NonSeekingReader`` yields only the complete chunks of such a file.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import lz4.frame
import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from occ_constraints_pkg.rosbag.storage import MAX_PIECE_BYTES, unpack_zstd

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
"""What each record begins with: its opcode and the length of what follows."""
_LENGTH = struct.Struct('<Q')
_CHUNK = struct.Struct('<QQQII')  # start, end, uncompressed size, CRC, length of compression name
DAMAGE = (
    *(McapError, struct.error, UnicodeDecodeError, EOFError, KeyError, IndexError, ValueError),
    *(OverflowError, RecursionError, MemoryError, RuntimeError),
)
"""Errors that the parsers of other people's libraries raise on damaged bytes."""


def walked(data: bytes | memoryview, *, truncated: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return where each record begins and ends, by going from one to the next.

    Args:
        data: the records.
        truncated: the last record may be incomplete; it is left out.

    Raises:
        ValueError: the last record reaches past the end.
    """
    edges, position, last = [0], 0, len(data) - HEAD.size
    note, length_at = edges.append, _LENGTH.unpack_from
    while position <= last:
        position += HEAD.size + length_at(data, position + 1)[0]
        note(position)
    if position < len(data):
        # What is left is not even the head of a record.
        note(position + HEAD.size)
    if edges[-1] > len(data):
        if not truncated:
            raise ValueError(f'a record reaches {edges[-1] - len(data)} bytes past its end')
        edges.pop()
    return np.array(edges[:-1], dtype=np.int64), np.array(edges[1:], dtype=np.int64)


def indexed(data: bytes | memoryview, index: bytes) -> tuple[np.ndarray, np.ndarray] | None:
    """Return what :func:`walked` does, from the index behind a chunk.

    None where the index does not account for every byte of the chunk, as it never does where
    schemas and channels lie between messages.
    """
    offsets = []
    try:
        for opcode, body in records_of(index):
            if opcode == Opcode.MESSAGE_INDEX:
                # The channel (2 bytes), the length of the list (4), then times and offsets.
                offsets.append(np.frombuffer(body, '<i8', offset=6)[1::2])
    except DAMAGE:
        return None
    if not offsets:
        return None
    begins = np.sort(np.concatenate(offsets))
    if not len(begins) or begins[0] != 0 or begins[-1] > len(data) - HEAD.size:
        return None
    ends = begins + HEAD.size + numbers_at(data, begins + 1, '<i8')
    if ends[-1] != len(data) or (ends[:-1] != begins[1:]).any():
        return None
    return begins, ends


def numbers_at(data: bytes | memoryview, places: np.ndarray, kind: str) -> np.ndarray:
    """Return the numbers at any places of the bytes."""
    dtype = np.dtype(kind)
    count = len(data) - dtype.itemsize + 1
    if count < 1:
        return np.empty(0, dtype)
    return np.ndarray((count,), dtype, data, strides=(1,))[places]


def unpack_chunk(record: bytes, *, truncated: bool) -> bytes | memoryview:
    """Return the records within a chunk record; of a truncated one, as much as can be unpacked.

    Raises:
        ValueError: it is no chunk, or is damaged.
    """
    body = HEAD.size
    opcode, length = HEAD.unpack_from(record)
    if opcode != Opcode.CHUNK or (length + body != len(record) and not truncated):
        raise ValueError('there is no such chunk')
    _, _, size, crc, name_length = _CHUNK.unpack_from(record, body)
    name_end = body + _CHUNK.size + name_length
    compression = record[body + _CHUNK.size : name_end].decode()
    stored_size = _LENGTH.unpack_from(record, name_end)[0]
    stored = memoryview(record)[name_end + 8 : name_end + 8 + stored_size]
    if size > MAX_PIECE_BYTES:
        raise ValueError(f'it says that it holds {size} bytes; allowed are {MAX_PIECE_BYTES}')
    if len(stored) != stored_size and not truncated:
        raise ValueError(f'it has {len(stored)} of {stored_size} bytes')
    data = _decompress(stored, compression, size, truncated=truncated)
    if not truncated:
        if len(data) != size:
            raise ValueError(f'it holds {len(data)} bytes instead of {size}')
        if crc and zlib.crc32(data) != crc:
            raise ValueError('its checksum is wrong')
    return data


def _decompress(
    stored: memoryview, compression: str, size: int, *, truncated: bool
) -> bytes | memoryview:
    match compression:
        case '':
            return stored
        case 'zstd':
            return unpack_zstd(stored, size, truncated=truncated)
        case 'lz4':
            try:
                return lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=size + 1)
            except RuntimeError as error:
                raise ValueError(f'its lz4 data are invalid: {error}') from error
    raise ValueError(f'compression {compression!r}; allowed are zstd, lz4 and none')


def records_of(buffer: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of each record.

    Raises:
        ValueError: a record reaches past the end.
        struct.error: the end lies within the head of a record.
    """
    position = 0
    while position < len(buffer):
        opcode, length = HEAD.unpack_from(buffer, position)
        position += HEAD.size + length
        if position > len(buffer):
            raise ValueError('a record reaches past the end')
        yield opcode, buffer[position - length : position]
