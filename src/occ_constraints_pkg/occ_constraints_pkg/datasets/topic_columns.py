# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of one topic of a recording, read from many serialized messages at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.datasets.named_elements import NamedElements, NameLists
from occ_constraints_pkg.features.fields import (
    GEOMETRY,
    GREATEST,
    LEAST,
    FieldReader,
    MessageReader,
    NotNamedError,
    header_stamp_ns,
    is_plain_count,
    resolve_path,
    split_readings,
)
from occ_constraints_pkg.features.reductions import (
    ArrayReductions,
    RangeRule,
    angle_of,
    angle_parts,
    fill_unmeasured,
)
from occ_constraints_pkg.features.sources import ANGLES, Reading
from occ_constraints_pkg.rosbag.cdr import CdrFields, Group, Path, UnreadableError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block

_LIMITS = ('least', 'greatest')
_STAMP = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


@dataclass(frozen=True, eq=False)
class Walk:
    """What was found in the messages of one topic.

    Attributes:
        found: the groups of each path.
        names: place of a path to the lists of names that it leads to.
    """

    found: list[list[Group]]
    names: dict[int, NameLists]


class TopicColumns:
    """Reads all that is asked of one topic, from many messages at a time.

    Args:
        recording: where the topic's type is defined.
        topic: its name in the recording.
        readings: ``(feature, reading)`` for each number; each reading has a field.
        walks: what was found of the present block by others that read the same fields of the same
            messages; whoever passes it empties it before the next block. None: to share nothing.

    Attributes:
        unnamed: what the last message lacked of the names that are asked for, as long as no
            message has had them; else None.
    """

    def __init__(
        self,
        recording: Recording,
        topic: str,
        readings: Sequence[tuple[str, Reading]],
        walks: dict[str, Walk] | None = None,
    ) -> None:
        self._walks = walks
        self._recording, self._topic = recording, topic
        self._one_reader = MessageReader(readings)
        self._readers = [FieldReader(*item) for item in readings]
        self._scalars, arrays = split_readings(readings)
        # With the index of the array's path.
        self._arrays = [(members[0][0], ArrayReductions(members)) for members in arrays]
        self.unnamed: NotNamedError | None = None
        self._is_named = False
        definitions = recording.fields(topic)
        self._msgtype = recording.topics[topic].msgtype
        names = {
            name: _part_names(definitions, argument)
            for name, argument in _fields_of(definitions, self._msgtype)
        }
        paths: list[Path] = [
            resolve_path(reader.path, self._msgtype, names) for reader in self._readers
        ]
        self._named = NamedElements(definitions, self._msgtype, paths, self._readers)
        self._at: dict[str, int] = {}

        def ask(name: str, *path: str) -> None:
            self._at[name] = len(paths)
            paths.append(path)

        if _has_stamp(definitions, self._msgtype):
            ask('seconds', *_STAMP[0])
            ask('rest', *_STAMP[1])
        rules = {RangeRule.of(reading) for _, reading in readings}
        for key, allowed, is_needed, is_used in (
            ('least', LEAST, {rule.needs_least for rule in rules}, set()),
            (
                'greatest',
                GREATEST,
                {rule.needs_greatest for rule in rules},
                {rule.uses_greatest for rule in rules},
            ),
        ):
            found = next((name for name in allowed if name in names), None)
            # Where it is needed and not there, the reader of single messages says so.
            if True in is_needed or (found is not None and True in is_used):
                ask(key, found or allowed[0])
        if any(reading.is_sector for _, reading in readings):
            ask('first', GEOMETRY[0])
            ask('step', GEOMETRY[1])
        self._key = f'{topic} {paths}'
        self._fields = None
        self._kinds: list[str] = []
        try:
            fields = CdrFields(definitions, self._msgtype, paths)
        except UnreadableError:
            return
        extra = [fields.kinds[place] for place in self._at.values()]
        texts = [fields.kinds[place] for place in self._named.columns.values()]
        if (
            {*extra} <= {'number'}
            and {*texts} <= {'texts'}
            and all(
                _is_understood(reader.reading, kind, is_named=column in self._named.columns)
                for column, (reader, kind) in enumerate(
                    zip(self._readers, fields.kinds, strict=False)
                )
            )
        ):
            self._fields = fields
            self._kinds = fields.kinds

    @property
    def has_stamps(self) -> bool:
        """Whether the type has a header with a stamp."""
        return 'seconds' in self._at

    def read(self, block: Block, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (m, features) float64 values and (m,) header stamps in ns, 0 for none.

        Args:
            block: holds the messages.
            rows: (m,) which of its messages to read; all are of this topic.

        Raises:
            OccError: a message is damaged or lacks a field.
        """
        values, stamps, _ = self.read_named(block, rows)
        return values, stamps

    def read_named(
        self, block: Block, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what :meth:`read` does, and (m,) which messages have the names asked for."""
        if not len(rows):
            return np.empty((0, len(self._readers))), np.empty(0, np.int64), np.empty(0, bool)
        if self._fields is not None and self._recording.topics[self._topic].serialization == 'cdr':
            try:
                found = self._walk(block, rows)
                # A value that overflows is infinite, which the verdict tells; as in plain Python.
                with np.errstate(over='ignore', invalid='ignore'):
                    return self._finish(found, len(rows))
            except UnreadableError:
                pass
        return self._one_by_one(block, rows)

    def _walk(self, block: Block, rows: np.ndarray) -> Walk:
        """Find the fields in the messages, unless somebody has."""
        assert self._fields is not None
        walk = None if self._walks is None else self._walks.get(self._key)
        if walk is None:
            found = self._fields.read(block.data, block.starts[rows], block.ends[rows])
            lists = {
                place: NameLists.of(found[place][0], block.data)
                for place in set(self._named.columns.values())
            }
            walk = Walk(found, lists)
            if self._walks is not None:
                self._walks[self._key] = walk
        return walk

    def _one_by_one(
        self, block: Block, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        values = np.full((len(rows), len(self._readers)), np.nan)
        stamps = np.zeros(len(rows), dtype=np.int64)
        named, unnamed = np.ones(len(rows), dtype=bool), None
        for place, row in enumerate(rows.tolist()):
            message = self._recording.decode(self._recording.raw(block, row, self._topic))
            stamps[place] = header_stamp_ns(message) or 0
            try:
                values[place] = self._one_reader.read(message)
            except NotNamedError as error:
                named[place], unnamed = False, error
        self._note_names(named, unnamed)
        return values, stamps, named

    def _note_names(self, named: np.ndarray, unnamed: NotNamedError | None) -> None:
        """Remember whether some message has had the names that are asked for."""
        self._is_named = self._is_named or bool(named.any())
        self.unnamed = None if self._is_named else unnamed

    def _finish(self, walk: Walk, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = walk.found
        extra = {
            name: found[place][0].values[:, 0].astype(np.float64)
            for name, place in self._at.items()
        }
        values = np.full((count, len(self._readers)), np.nan)
        named = np.ones(count, dtype=bool)
        for column, texts in self._named.columns.items():
            numbers, has_name = self._named.read(column, walk.names[texts], found[column])
            values[:, column] = self._numbers(
                column,
                self._readers[column].reading,
                Group(np.arange(count), numbers[:, None], 0, 1),
                extra,
            )
            named &= has_name
        self._note_names(named, None if named.any() else self._named.error())
        for column, reader in self._scalars:
            if column in self._named.columns:
                continue
            for group in found[column]:
                values[group.rows, column] = self._numbers(column, reader.reading, group, extra)
        for place, array in self._arrays:
            for group in found[place]:
                _reduce(array, group, extra, values)
        stamps = np.zeros(count, dtype=np.int64)
        if 'seconds' in extra:
            # A float64 holds each 32-bit number exactly.
            seconds, rest = (extra[name].astype(np.int64) for name in ('seconds', 'rest'))
            stamps = seconds * 1_000_000_000 + rest
        return values, stamps, named

    def _numbers(
        self, column: int, reading: Reading, group: Group, extra: dict[str, np.ndarray]
    ) -> Any:
        """Return one number for each of a group's messages."""
        if is_plain_count(reading):
            return group.values.shape[1]
        numbers = group.values.astype(np.float64)
        if reading.reduce not in ANGLES:
            limits = (extra[key][group.rows] if key in extra else None for key in _LIMITS)
            return fill_unmeasured(numbers[:, 0], RangeRule.of(reading), *limits)
        if not numbers.shape[1]:
            return np.nan
        if numbers.shape[1] != 4:
            raise UnreadableError('a quaternion has four parts')
        order, angle = 'xyzw', str(reading.reduce)
        if self._kinds[column] == 'array':
            order = self._readers[column].order(self._msgtype)
        parts = [numbers[:, order.index(axis)] for axis in 'xyzw']
        columns = (part.tolist() for part in angle_parts(angle, *parts))
        return [angle_of(angle, *values) for values in zip(*columns, strict=True)]


def _fields_of(definitions: Mapping[str, Any], msgtype: str) -> list[tuple[str, Any]]:
    return list(definitions[msgtype][1]) if msgtype in definitions else []


def _part_names(definitions: Mapping[str, Any], field: Any) -> list[str]:
    """Return the names of a field's own fields, none where it is no message."""
    _, argument = field
    return (
        [name for name, _ in _fields_of(definitions, argument)]
        if (isinstance(argument, str))
        else []
    )


def _has_stamp(definitions: Mapping[str, Any], msgtype: str) -> bool:
    """Tell whether the type begins the way to a stamp as std_msgs/msg/Header has it."""
    for name in _STAMP[0][:-1]:
        field = dict(_fields_of(definitions, msgtype)).get(name)
        if field is None or not isinstance(field[1], str):
            return False
        msgtype = field[1]
    return msgtype in definitions and {'sec', 'nanosec'} <= dict(definitions[msgtype][1]).keys()


def _is_understood(reading: Reading, kind: str, *, is_named: bool) -> bool:
    """Tell whether all that the reading says can be done here to a field of that kind."""
    if is_named:
        return kind == 'array'
    if reading.reduce is None:
        return kind == 'number'
    if reading.reduce in ANGLES:
        return kind in ('vector', 'array')
    if is_plain_count(reading):
        return kind == 'array'
    return kind == 'array' or (kind == 'vector' and not reading.is_sector)


def _reduce(
    array: ArrayReductions, group: Group, extra: dict[str, np.ndarray], values: np.ndarray
) -> None:
    """Put the reductions of a group's arrays into its rows of ``values``, scan by scan alike."""
    rows = group.rows
    parts: list[tuple[Any, Any]] = [(slice(None), None)]
    if array.needs_geometry:
        firsts, steps = extra['first'][rows], extra['step'][rows]
        geometries = set(zip(firsts.tolist(), steps.tolist(), strict=True))
        parts = [((firsts == first) & (steps == step), (first, step)) for first, step in geometries]
        # NaN is unlike itself, and is refused where the sectors are laid out.
        if len(parts) == 1:
            parts = [(slice(None), parts[0][1])]
    for part, geometry in parts:
        chosen = rows[part]
        numbers = values[chosen]
        limits = tuple(extra[name][chosen] if name in extra else None for name in _LIMITS)
        array.reduce(group.values[part], limits, geometry, numbers)
        values[chosen] = numbers
