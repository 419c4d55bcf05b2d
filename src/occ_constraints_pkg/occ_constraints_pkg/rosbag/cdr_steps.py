# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Steps through many messages in CDR at once: where each string and sequence ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

_DTYPES = {
    'bool': '?',
    'byte': 'i1',
    'char': 'u1',
    'int8': 'i1',
    'uint8': 'u1',
    'int16': '<i2',
    'uint16': '<u2',
    'int32': '<i4',
    'uint32': '<u4',
    'int64': '<i8',
    'uint64': '<u8',
    'float32': '<f4',
    'float64': '<f8',
}
MOST_PARTS = 4096
"""Sequences of more parts of varying length are left to a decoder of single messages."""


class UnreadableError(ValueError):
    """Some message is not as it should be, or is of a kind that this module does not read."""


class Cursor:
    """Where the walk through each message stands.

    Attributes:
        body: (n,) where each message's body begins in the data.
        size: (n,) its length.
        place: how far into the body the walk is: one number for all, or (n,).
        found: places, and lengths of sequences, that leaves ask for.
    """

    def __init__(self, data: bytes | memoryview, body: np.ndarray, size: np.ndarray) -> None:
        self.data, self.body, self.size = data, body, size
        self.place: Any = 0
        self.found: dict[Any, Any] = {}

    def numbers(self, dtype: str | np.dtype, at: np.ndarray) -> np.ndarray:
        """Return the (n,) numbers that begin at any bytes of the data."""
        kind = np.dtype(dtype)
        count = len(self.data) - kind.itemsize + 1
        return np.ndarray((max(count, 0),), kind, self.data, strides=(1,))[at]

    def length(self, place: Any) -> np.ndarray:
        """Return the (n,) lengths that stand before strings and sequences."""
        if (place + 4 > self.size).any():
            raise UnreadableError('a message ends within a length')
        return self.numbers('<u4', self.body + place).astype(np.int64)

    def part(self, rows: np.ndarray) -> Cursor:
        """Return a cursor over some of the messages."""
        cursor = Cursor(self.data, self.body[rows], self.size[rows])
        cursor.place = self.place[rows]
        return cursor


def number_dtype(name: str) -> np.dtype:
    """Return how numbers of a kind are stored.

    Raises:
        UnreadableError: the kind is no number that is read here.
    """
    if name not in _DTYPES:
        raise UnreadableError(f'there are no numbers of kind {name}')
    return np.dtype(_DTYPES[name])


def advance(cursor: Cursor, offset: int) -> None:
    """Go on by a known distance."""
    cursor.place = cursor.place + offset


def align(cursor: Cursor, offset: int, size: int) -> None:
    """Go on by a known distance, and to the next multiple of a size."""
    cursor.place = (cursor.place + (offset + size - 1)) & -size


def note(cursor: Cursor, offset: int, key: Any) -> None:
    """Remember a place for a leaf."""
    cursor.found[key] = cursor.place + offset


def pass_string(cursor: Cursor, offset: int) -> None:
    """Go to the end of a string."""
    place = cursor.place + offset
    length = cursor.length(place)
    cursor.place = place + 4 + length
    if (length < 1).any() or (cursor.place > cursor.size).any():
        raise UnreadableError('a string is longer than its message')
    if cursor.numbers('u1', cursor.body + cursor.place - 1).any():
        raise UnreadableError('a string has no end')


def pass_numbers(cursor: Cursor, offset: int, size: int, key: Any) -> None:
    """Go to the end of a sequence of numbers; remember its place and length."""
    place = cursor.place + offset
    length = cursor.length(place)
    place = place + 4
    if size > 4:
        # An empty sequence has no elements that would need alignment.
        place = np.where(length > 0, (place + (size - 1)) & -size, place)
    cursor.found[key] = place, length
    cursor.place = place + length * size
    if (cursor.place > cursor.size).any():
        raise UnreadableError('a sequence is longer than its message')


def pass_parts(cursor: Cursor, offset: int, alignment: int, size: int) -> None:
    """Go to the end of a sequence of parts that are all of one size."""
    place = cursor.place + offset
    length = cursor.length(place)
    if (length > cursor.size).any():
        raise UnreadableError('a sequence is longer than its message')
    place = place + 4
    stride = -(-size // alignment) * alignment
    beyond = ((place + (alignment - 1)) & -alignment) + (length - 1) * stride + size
    cursor.place = np.where(length > 0, beyond, place)


def pass_each(cursor: Cursor, offset: int, steps: list[Callable[[Cursor], None]]) -> None:
    """Go through a sequence of parts one by one, in all messages together."""
    place = cursor.place + offset
    length = cursor.length(place)
    # Each part has a byte at least.
    if (length > np.minimum(cursor.size, MOST_PARTS)).any():
        raise UnreadableError('a sequence is longer than its message, or very long')
    cursor.place = place = np.broadcast_to(place + 4, length.shape).copy()
    for number in range(int(length.max())):
        rows = np.flatnonzero(length > number)
        part = cursor.part(rows)
        for step in steps:
            step(part)
        place[rows] = part.place
