# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of one topic of a recording, read from many serialized messages at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.features.cdr import CdrFields, Group, Path, UnreadableError
from occ_constraints_pkg.features.fields import (
    GEOMETRY,
    GREATEST,
    REDUCTIONS,
    FieldReader,
    MessageReader,
    header_stamp_ns,
    unmeasured,
)
from occ_constraints_pkg.features.sources import Reading
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
            ask('greatest', (next((name for name in GREATEST if name in names), GREATEST[0]),))
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
        values = np.empty((count, len(self._readers)))
        arrays: dict[tuple[int, str], _Arrays] = {}
        for place, reader in enumerate(self._readers):
            reading = reader.reading
            for group in found[place]:
                greatest = extra['greatest'][group.rows] if 'greatest' in extra else None
                if reading.reduce in (None, 'yaw'):
                    numbers = _single(reading, group, greatest)
                else:
                    # Several features mostly lie in one array, of which this is done once.
                    key = id(group.base), reading.missing
                    if key not in arrays:
                        arrays[key] = _Arrays(reading.missing, group, greatest)
                    numbers = arrays[key].reduced(reader, group, extra)
                values[group.rows, place] = numbers
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


def _single(reading: Reading, group: Group, greatest: np.ndarray | None) -> np.ndarray:
    """Do to all rows of a group what :meth:`FieldReader.number` does to one: (m,) float64."""
    if reading.reduce == 'yaw':
        return _yaws(group.values)
    numbers = group.values[:, 0].astype(np.float64)
    if reading.missing == 'unknown':
        return numbers
    return np.where(
        unmeasured(numbers), greatest if reading.missing == 'max_range' else np.nan, numbers
    )


class _Arrays:
    """The arrays of a group with what was not measured dealt with, and their reductions.

    It does what :class:`~occ_constraints_pkg.features.fields.MessageReader` does to each message.
    """

    def __init__(self, missing: str, group: Group, greatest: np.ndarray | None) -> None:
        self._base = group.base
        # Whether a value says something of what is in range; None where all are taken as they are.
        self._says = self._measured = None
        if missing == 'unknown' or not group.base.size:
            return
        lost = unmeasured(group.base)
        if missing == 'drop':
            self._measured = ~lost
        else:
            self._says = (group.base > 0) | (group.base == -np.inf)
            # As float32, when both are, is exact.
            limit = greatest.astype(group.base.dtype)
            limit = limit if np.array_equal(limit, greatest, equal_nan=True) else greatest
            self._base = np.where(lost, limit[:, None], group.base)

    def reduced(
        self, reader: FieldReader, group: Group, extra: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Return (m,) float64: the reading's reduction of each array; NaN where it is missing."""
        count, reading = len(group.rows), reader.reading
        if group.start == group.stop:
            return np.full(count, np.nan)
        part = slice(group.start, group.stop)
        if reading.degrees is None:
            result = self._reduce(reading.reduce, slice(None), part)
        else:
            firsts, steps = (extra[name][group.rows] for name in ('first', 'step'))
            result = np.empty(count)
            # Scans keep their geometry, as a rule.
            for first, step in set(zip(firsts.tolist(), steps.tolist(), strict=True)):
                rows = np.flatnonzero((firsts == first) & (steps == step))
                beams = reader.beams(first, step, group.stop - group.start)
                result[rows] = self._reduce(
                    reading.reduce, slice(None) if len(rows) == count else rows, beams
                )
        if self._says is not None:
            result = np.where(self._says[:, part].any(axis=1), result, np.nan)
        return result

    def _reduce(self, reduce: str, rows: Any, columns: Any) -> np.ndarray:
        numbers = self._base[rows][:, columns]
        if reduce in ('min', 'max'):
            if self._measured is None:
                return numbers.min(axis=1) if reduce == 'min' else numbers.max(axis=1)
            worst = np.inf if reduce == 'min' else -np.inf
            kept = np.where(self._measured[rows][:, columns], numbers, worst)
            result = kept.min(axis=1) if reduce == 'min' else kept.max(axis=1)
            return np.where(result == worst, np.nan, result)
        # Row by row, for along an axis NumPy may add in another order.
        lines = np.ascontiguousarray(numbers, dtype=np.float64)
        if self._measured is not None:
            kept_lines = zip(lines, self._measured[rows][:, columns], strict=True)
            lines = [line[measured] for line, measured in kept_lines]
        elif reduce == 'mean':
            return lines.mean(axis=1)
        call = REDUCTIONS[reduce]
        return np.array([call(line) if line.size else np.nan for line in lines])


def _yaws(quaternions: np.ndarray) -> np.ndarray:
    if quaternions.shape[1] != 4:
        raise UnreadableError('a quaternion has four parts')
    x, y, z, w = quaternions.T.astype(np.float64)
    sines, cosines = 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z
    # The arctangent of NumPy may differ from that of math in the last bit.
    angles = map(math.atan2, sines.tolist(), cosines.tolist())
    unset = (sines == 0.0) & (cosines == 0.0)
    return np.where(unset, np.nan, list(angles))
