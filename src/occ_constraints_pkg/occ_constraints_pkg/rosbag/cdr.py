# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers out of many serialized messages of one type at once, without building the messages.

A message in CDR (OMG, Common Data Representation, the encoding of ROS 2) has its fields one after
another, each aligned to its own size, counted from the end of the four bytes of the head. Only
strings and sequences vary in length. So a type is compiled to the few steps that find the next
string or sequence; between them, fields lie at distances that are known beforehand. Each step is
done for all messages together, as an operation on arrays of positions.

Messages are walked through to their end and must be as long as they say; what is wrong with one
that is not, or that lacks an element asked for, is reported by the decoder of single messages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

Step = str | int | slice
Path = tuple[Step, ...]
"""A field path in steps: ``('ranges', slice(0, 9))`` is ``ranges[0:9]``."""

_LITTLE_ENDIAN = 0x0100  # the head's first two bytes, 00 01, read as a number
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
# Sequences of more parts of varying length are left to a decoder of single messages.
_MOST_PARTS = 4096


class UnreadableError(ValueError):
    """Some message is not as it should be, or is of a kind that this module does not read."""


@dataclass(frozen=True, eq=False)
class Group:
    """The values of a field in those of the messages in which it is equally long.

    Attributes:
        rows: numbers of the m messages.
        base: (m, width) float64, or float32 where that is stored; fields in one array share it.
        start: first column of the field.
        stop: first column after it.
    """

    rows: np.ndarray
    base: np.ndarray
    start: int
    stop: int

    @property
    def values(self) -> np.ndarray:
        """The field's (m, length) part of the base."""
        return self.base[:, self.start : self.stop]


class CdrFields:
    """Reads fields of one message type.

    A path may lead to a number, to an array or sequence of numbers, to an element or slice of
    one, and to a part with fields x and y: then it stands for all of x, y, z and w that are there.
    To a sequence of strings, it stands for where that begins and ends in the data.

    Args:
        definitions: type name to its parsed definition, as a ``rosbags`` typestore has them.
        msgtype: the type's name.
        paths: the fields.

    Attributes:
        kinds: for each path, whether it leads to a ``number``, a ``vector`` (the fields x, y, ...),
            an ``array``, or ``texts``.

    Raises:
        UnreadableError: the type has no such field, or has a kind of part that only a decoder
            of single messages reads.
    """

    def __init__(self, definitions: Mapping[str, Any], msgtype: str, paths: Sequence[Path]) -> None:
        compiler = _Compiler(definitions)
        compiler.part(msgtype, {(number, 0): path for number, path in enumerate(paths)})
        compiler.advance()
        self._steps = compiler.steps
        self._leaves = [compiler.leaves.get(number) for number in range(len(paths))]
        if None in self._leaves:
            raise UnreadableError(f'{msgtype} has no field {paths[self._leaves.index(None)]}')
        self.kinds = [leaf.kind for leaf in self._leaves]

    def read(
        self, data: bytes | memoryview, starts: np.ndarray, ends: np.ndarray
    ) -> list[list[Group]]:
        """Return the groups of each path.

        Args:
            data: bytes in which the messages lie.
            starts: (n,) where each begins, n > 0.
            ends: (n,) where it ends.

        Raises:
            UnreadableError: a message is damaged, is big-endian, or lacks an element.
        """
        cursor = _Cursor(data, starts + 4, ends - starts - 4)
        if (cursor.size < 0).any():
            raise UnreadableError('a message is too short')
        if (cursor.numbers('<u2', starts) != _LITTLE_ENDIAN).any():
            raise UnreadableError('a message is not in little-endian CDR')
        for step in self._steps:
            step(cursor)
        rest = cursor.size - cursor.place
        if (rest < 0).any() or (rest > 3).any():
            raise UnreadableError('a message is longer or shorter than it says')
        return [leaf.read(cursor) for leaf in self._leaves]


@dataclass(frozen=True)
class _Leaf:
    """How a path's values are gathered once all places are known."""

    kind: str
    dtypes: tuple[str, ...]
    keys: tuple[Any, ...]
    step: Step | None = None
    length: int | None = None  # of an array; -1 where a sequence has a length of its own

    def read(self, cursor: _Cursor) -> list[Group]:
        rows = np.arange(len(cursor.body))
        if self.kind == 'texts':
            ends = [cursor.body + cursor.found[key] for key in self.keys]
            return [Group(rows, np.stack(ends, axis=1), 0, 2)]
        if self.length is None:
            columns = [
                cursor.numbers(dtype, cursor.body + cursor.found[key])
                for dtype, key in zip(self.dtypes, self.keys, strict=True)
            ]
            base = columns[0][:, None] if len(columns) == 1 else np.stack(columns, axis=1)
            base = _widened(base)
            return [Group(rows, base, 0, base.shape[1])]
        found = cursor.found[self.keys[0]]
        first, lengths = found if self.length == -1 else (found, np.full(len(rows), self.length))
        at, groups = cursor.body + first, []
        alike = (lengths == lengths[0]).all()
        for length in lengths[:1].tolist() if alike else np.unique(lengths).tolist():
            some = rows if alike else np.flatnonzero(lengths == length)
            base = self._base(cursor, length, at[some])
            groups.append(Group(some, base, *_reach(self.step, length)))
        return groups

    def _base(self, cursor: _Cursor, length: int, at: np.ndarray) -> np.ndarray:
        """Return the whole array of some messages; fields in the same array get the same one."""
        key = (self.keys[0], length)
        if key not in cursor.found:
            dtype = np.dtype(self.dtypes[0])
            if length:
                row = np.dtype((np.void, length * dtype.itemsize))
                base = cursor.numbers(row, at).view(dtype).reshape(len(at), length)
            else:
                base = np.empty((len(at), 0))
            cursor.found[key] = _widened(base)
        return cursor.found[key]


def _widened(numbers: np.ndarray) -> np.ndarray:
    # Sequences of float32 are long, and comparing them as they are takes half the time.
    return numbers if numbers.dtype == np.float32 else numbers.astype(np.float64)


def _reach(step: Step | None, length: int) -> tuple[int, int]:
    """Return the first element that a step takes of an array, and the first it does not take."""
    if step is None:
        return 0, length
    if isinstance(step, int):
        if not -length <= step < length:
            raise UnreadableError('an array lacks an element')
        return step % length, step % length + 1
    ends = [end for end in (step.start, step.stop) if end is not None]
    start, stop, _ = step.indices(length)
    if length and (start >= stop or any(abs(end) > length for end in ends)):
        raise UnreadableError('an array lacks elements')
    return start, stop


class _Compiler:
    """Turns a type into steps of a cursor.

    Attributes:
        steps: what has to be done at parts of varying length.
        leaves: path number to how it is read.
        offset: distance from the last of these parts.
        known: the alignment that the cursor's place is sure to have.
    """

    def __init__(self, definitions: Mapping[str, Any], depth: int = 0) -> None:
        if depth > 32:
            raise UnreadableError('a type contains itself')
        self._definitions, self._depth = definitions, depth
        self.steps: list[Callable[[_Cursor], None]] = []
        self.leaves: dict[int, _Leaf] = {}
        self.offset, self.known = 0, 8
        self._vectors: set[int] = set()

    def part(self, msgtype: str, wanted: Mapping[Any, Path]) -> None:
        """Pass over a message; ``wanted`` says what of it is asked for."""
        self._depth += 1
        if self._depth > 32 or msgtype not in self._definitions:
            raise UnreadableError(f'{msgtype} is not defined, or contains itself')
        fields = self._definitions[msgtype][1]
        if not fields:
            raise UnreadableError(f'{msgtype} has no fields')
        names = [name for name, _ in fields]
        asked = {key: path for key, path in wanted.items() if path}
        for (number, _), path in wanted.items():
            if path:
                continue
            if not {'x', 'y'} <= set(names):
                raise UnreadableError(f'{msgtype} is no vector')
            self._vectors.add(number)
            axes = [axis for axis in 'xyzw' if axis in names]
            asked.update({(number, place): (axis,) for place, axis in enumerate(axes)})
        for name, (kind, argument) in fields:
            inner = {key: path[1:] for key, path in asked.items() if path[0] == name}
            if kind == Nodetype.NAME:
                self.part(argument, inner)
            elif kind == Nodetype.BASE:
                self._base(argument[0], inner)
            elif kind == Nodetype.ARRAY:
                self._array(*argument, inner)
            else:
                self._sequence(argument[0], inner)
        self._depth -= 1

    def advance(self) -> None:
        """Bring the cursor to where the compiler is."""
        if self.offset:
            self._do(_advance, self.offset)
            self.offset, self.known = 0, 1

    def _do(self, step: Callable[..., None], *arguments: Any) -> None:
        self.steps.append(lambda cursor: step(cursor, *arguments))

    def _align(self, size: int) -> None:
        if size <= self.known:
            self.offset = -(-self.offset // size) * size
        else:
            self._do(_align, self.offset, size)
            self.offset, self.known = 0, size

    def _base(self, name: str, wanted: Mapping[Any, Path]) -> None:
        if name == 'string':
            if wanted:
                raise UnreadableError('a string is no number')
            self._align(4)
            self._do(_pass_string, self.offset)
            self.offset, self.known = 0, 1
            return
        dtype = _number_dtype(name)
        self._align(dtype.itemsize)
        for key, path in wanted.items():
            if path:
                raise UnreadableError('a number has no parts')
            self._do(_note, self.offset, key)
            number, place = key
            leaf = self.leaves.get(number) if place else None
            self.leaves[number] = _Leaf(
                'vector' if number in self._vectors else 'number',
                (*(leaf.dtypes if leaf else ()), dtype.str),
                (*(leaf.keys if leaf else ()), key),
            )
        self.offset += dtype.itemsize

    def _array(self, element: Any, length: int, wanted: Mapping[Any, Path]) -> None:
        kind, argument = element
        if kind == Nodetype.BASE and argument[0] != 'string':
            dtype = _number_dtype(argument[0])
            self._align(dtype.itemsize)
            key = object()
            self._do(_note, self.offset, key)
            for (number, _), path in wanted.items():
                self._add_array(number, path, dtype, key, length)
                # The reach is checked here once and for all.
                _reach(path[0] if path else None, length)
            self.offset += length * dtype.itemsize
            return
        if length > _MOST_PARTS:
            raise UnreadableError('an array has too many parts')
        for index in range(length):
            inner = {
                key: path[1:]
                for key, path in wanted.items()
                if path and path[0] in (index, index - length)
            }
            if kind == Nodetype.BASE:
                self._base(argument[0], inner)
            else:
                self.part(argument, inner)

    def _sequence(self, element: Any, wanted: Mapping[Any, Path]) -> None:
        kind, argument = element
        self._align(4)
        if kind == Nodetype.BASE and argument[0] != 'string':
            dtype = _number_dtype(argument[0])
            key = object()
            self._do(_pass_numbers, self.offset, dtype.itemsize, key)
            self.offset, self.known = 0, min(4, dtype.itemsize)
            for (number, _), path in wanted.items():
                self._add_array(number, path, dtype, key, -1)
            return
        numbers = [number for number, _ in wanted]
        if any(wanted.values()) or (wanted and kind != Nodetype.BASE):
            raise UnreadableError('parts of a sequence of messages are read one at a time')
        ends = object(), object()
        if numbers:
            self._do(_note, self.offset, ends[0])
        layout = self._layout(argument) if kind == Nodetype.NAME else None
        if layout is not None:
            self._do(_pass_parts, self.offset, *layout)
        else:
            inner = _Compiler(self._definitions, self._depth)
            inner.known = 1
            if kind == Nodetype.BASE:
                inner._base(argument[0], {})
            else:
                inner.part(argument, {})
            inner.advance()
            self._do(_pass_each, self.offset, inner.steps)
        self.offset, self.known = 0, 1
        if numbers:
            self._do(_note, self.offset, ends[1])
            self.leaves.update({number: _Leaf('texts', (), ends) for number in numbers})

    def _add_array(
        self, number: int, path: Path, dtype: np.dtype, key: object, length: int
    ) -> None:
        if len(path) > 1:
            raise UnreadableError('a number has no parts')
        step = path[0] if path else None
        if not isinstance(step, int | slice | None):
            raise UnreadableError('an array has no fields, and no names of elements')
        kind = 'number' if isinstance(step, int) else 'array'
        self.leaves[number] = _Leaf(kind, (dtype.str,), (key,), step, length)

    def _layout(self, msgtype: str) -> tuple[int, int] | None:
        """Return alignment and size of a part whose layout never varies, else None.

        The first field must need the largest alignment, so that all parts of a sequence are alike.
        """
        inner = _Compiler(self._definitions, self._depth)
        inner.part(msgtype, {})
        first = self._first_alignment(msgtype)
        fits = first == self._largest_alignment(msgtype)
        return (first, inner.offset) if fits and not inner.steps else None

    def _first_alignment(self, msgtype: str) -> int:
        return self._alignment(self._definitions[msgtype][1][0][1], first=True)

    def _largest_alignment(self, msgtype: str) -> int:
        fields = self._definitions[msgtype][1]
        return max(self._alignment(field, first=False) for _, field in fields)

    def _alignment(self, field: Any, *, first: bool) -> int:
        kind, argument = field
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            return 4 if kind == Nodetype.SEQUENCE else self._alignment(argument[0], first=first)
        if kind == Nodetype.NAME:
            find = self._first_alignment if first else self._largest_alignment
            return find(argument)
        return 4 if argument[0] == 'string' else _number_dtype(argument[0]).itemsize


class _Cursor:
    """How far the walk through each message has come.

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

    def part(self, rows: np.ndarray) -> _Cursor:
        """Return a cursor over some of the messages."""
        cursor = _Cursor(self.data, self.body[rows], self.size[rows])
        cursor.place = self.place[rows]
        return cursor


def _number_dtype(name: str) -> np.dtype:
    """Return how numbers of a kind are stored.

    Raises:
        UnreadableError: the kind is no number that is read here.
    """
    if name not in _DTYPES:
        raise UnreadableError(f'there are no numbers of kind {name}')
    return np.dtype(_DTYPES[name])


def read_texts(data: bytes | memoryview) -> list[str]:
    """Return the strings of a sequence, from the bytes between its ends.

    Raises:
        UnreadableError: they are not such a sequence.
    """
    texts, place = [], 4
    try:
        for _ in range(int.from_bytes(data[:4], 'little')):
            place = -(-place // 4) * 4
            end = place + 4 + int.from_bytes(data[place : place + 4], 'little')
            texts.append(bytes(data[place + 4 : end - 1]).decode())
            place = end
    except UnicodeDecodeError as error:
        raise UnreadableError('a string is not in UTF-8') from error
    return texts


def _advance(cursor: _Cursor, offset: int) -> None:
    """Go on by a known distance."""
    cursor.place = cursor.place + offset


def _align(cursor: _Cursor, offset: int, size: int) -> None:
    """Go on by a known distance, and to the next multiple of a size."""
    cursor.place = (cursor.place + (offset + size - 1)) & -size


def _note(cursor: _Cursor, offset: int, key: Any) -> None:
    """Remember a place for a leaf."""
    cursor.found[key] = cursor.place + offset


def _pass_string(cursor: _Cursor, offset: int) -> None:
    """Go to the end of a string."""
    place = cursor.place + offset
    length = cursor.length(place)
    cursor.place = place + 4 + length
    if (length < 1).any() or (cursor.place > cursor.size).any():
        raise UnreadableError('a string is longer than its message')
    if cursor.numbers('u1', cursor.body + cursor.place - 1).any():
        raise UnreadableError('a string has no end')


def _pass_numbers(cursor: _Cursor, offset: int, size: int, key: Any) -> None:
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


def _pass_parts(cursor: _Cursor, offset: int, alignment: int, size: int) -> None:
    """Go to the end of a sequence of parts that are all of one size."""
    place = cursor.place + offset
    length = cursor.length(place)
    if (length > cursor.size).any():
        raise UnreadableError('a sequence is longer than its message')
    place = place + 4
    stride = -(-size // alignment) * alignment
    beyond = ((place + (alignment - 1)) & -alignment) + (length - 1) * stride + size
    cursor.place = np.where(length > 0, beyond, place)


def _pass_each(cursor: _Cursor, offset: int, steps: list[Callable[[_Cursor], None]]) -> None:
    """Go through a sequence of parts one by one, in all messages together."""
    place = cursor.place + offset
    length = cursor.length(place)
    # Each part has a byte at least.
    if (length > np.minimum(cursor.size, _MOST_PARTS)).any():
        raise UnreadableError('a sequence is longer than its message, or very long')
    cursor.place = place = np.broadcast_to(place + 4, length.shape).copy()
    for number in range(int(length.max())):
        rows = np.flatnonzero(length > number)
        part = cursor.part(rows)
        for step in steps:
            step(part)
        place[rows] = part.place
