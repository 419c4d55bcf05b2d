# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of one topic of a recording, read from many serialized messages at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.features.fields import (
    GEOMETRY,
    LIMITS,
    FieldReader,
    MessageReader,
    header_stamp_ns,
    split_readings,
)
from occ_constraints_pkg.features.reductions import (
    ArrayReductions,
    fill_unmeasured,
    yaw_angle,
    yaw_vector,
)
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.rosbag.cdr import CdrFields, Group, Path, UnreadableError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block

_STAMP = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


class TopicColumns:
    """Reads all that is asked of one topic, from many messages at a time.

    Args:
        recording: where the topic's type is defined.
        topic: its name in the recording.
        readings: ``(feature, reading)`` for each number; each reading has a field.
    """

    def __init__(
        self, recording: Recording, topic: str, readings: Sequence[tuple[str, Reading]]
    ) -> None:
        self._recording, self._topic = recording, topic
        self._one_reader = MessageReader(readings)
        self._readers = [FieldReader(*item) for item in readings]
        self._scalars, arrays = split_readings(readings)
        # With the index of the array's path.
        self._arrays = [(members[0][0], ArrayReductions(members)) for members in arrays]
        definitions = recording.fields(topic)
        msgtype = recording.topics[topic].msgtype
        paths: list[Path] = [reader.path for reader in self._readers]
        self._at: dict[str, int] = {}

        def ask(name: str, path: Path) -> None:
            self._at[name] = len(paths)
            paths.append(path)

        if _has_stamp(definitions, msgtype):
            ask('seconds', _STAMP[0])
            ask('rest', _STAMP[1])
        names = {name for name, _ in definitions[msgtype][1]} if msgtype in definitions else set()
        if any(reading.missing == 'max_range' for _, reading in readings):
            ask('limit', (next((name for name in LIMITS if name in names), LIMITS[0]),))
        if any(reading.degrees is not None for _, reading in readings):
            ask('first', (GEOMETRY[0],))
            ask('step', (GEOMETRY[1],))
        self._fields = None
        try:
            fields = CdrFields(definitions, msgtype, paths)
        except UnreadableError:
            return
        extra = [fields.kinds[place] for place in self._at.values()]
        own = zip(self._readers, fields.kinds, strict=False)
        if set(extra) <= {'number'} and all(
            _is_understood(item.reading, kind) for item, kind in own
        ):
            self._fields = fields

    def read(self, block: Block, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (m, features) float64 values and (m,) header stamps in ns, 0 for none.

        Args:
            block: holds the messages.
            rows: (m,) which of its messages to read; all are of this topic.

        Raises:
            OccError: a message is damaged or lacks a field.
        """
        if not len(rows):
            return np.empty((0, len(self._readers))), np.empty(0, dtype=np.int64)
        if self._fields is not None and self._recording.topics[self._topic].serialization == 'cdr':
            try:
                found = self._fields.read(block.data, block.starts[rows], block.ends[rows])
                # A value that overflows is infinite, which the verdict tells; as in plain Python.
                with np.errstate(over='ignore', invalid='ignore'):
                    return self._finish(found, len(rows))
            except UnreadableError:
                pass
        return self._one_by_one(block, rows)

    def _one_by_one(self, block: Block, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values = np.empty((len(rows), len(self._readers)))
        stamps = np.zeros(len(rows), dtype=np.int64)
        for place, row in enumerate(rows.tolist()):
            message = self._recording.decode(self._recording.raw(block, row, self._topic))
            values[place] = self._one_reader.read(message)
            stamps[place] = header_stamp_ns(message) or 0
        return values, stamps

    def _finish(self, found: list[list[Group]], count: int) -> tuple[np.ndarray, np.ndarray]:
        extra = {
            name: found[place][0].values[:, 0].astype(np.float64)
            for name, place in self._at.items()
        }
        values = np.full((count, len(self._readers)), np.nan)
        for column, reader in self._scalars:
            # Numbers and vectors are of one length, so there is one group of all messages.
            numbers = found[column][0].values.astype(np.float64)
            if reader.reading.reduce == 'yaw':
                values[:, column] = _yaws(numbers)
            else:
                missing = reader.reading.missing
                values[:, column] = fill_unmeasured(numbers[:, 0], missing, extra.get('limit'))
        for place, array in self._arrays:
            for group in found[place]:
                _reduce(array, group, extra, values)
        stamps = np.zeros(count, dtype=np.int64)
        if 'seconds' in extra:
            # A float64 holds each 32-bit number exactly.
            seconds, rest = (extra[name].astype(np.int64) for name in ('seconds', 'rest'))
            stamps = seconds * 1_000_000_000 + rest
        return values, stamps


def _has_stamp(definitions: dict[str, Any], msgtype: str) -> bool:
    """Tell whether the type begins the way to a stamp as std_msgs/msg/Header has it."""
    for name in _STAMP[0][:-1]:
        field = dict(definitions[msgtype][1] if msgtype in definitions else ()).get(name)
        if field is None or not isinstance(field[1], str):
            return False
        msgtype = field[1]
    return msgtype in definitions and {'sec', 'nanosec'} <= dict(definitions[msgtype][1]).keys()


def _is_understood(reading: Reading, kind: str) -> bool:
    """Tell whether all that the reading says can be done here to a field of that kind."""
    if reading.reduce is None:
        return kind == 'number'
    if reading.reduce == 'yaw':
        return kind == 'vector'
    return kind == 'array' or (kind == 'vector' and reading.degrees is None)


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
        limits = extra['limit'][chosen] if array.needs_limits else None
        array.reduce(group.values[part], limits, geometry, numbers)
        values[chosen] = numbers


def _yaws(quaternions: np.ndarray) -> list[float]:
    if quaternions.shape[1] != 4:
        raise UnreadableError('a quaternion has four parts')
    sines, cosines = yaw_vector(*quaternions.T)
    return list(map(yaw_angle, sines.tolist(), cosines.tolist()))
