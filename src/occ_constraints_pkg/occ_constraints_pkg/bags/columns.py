# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Features of recordings by blocks: what pushing message by message gives, many times as fast.

:class:`~occ_constraints_pkg.bags.extract.FeatureExtractor` states what a row is; this module
computes the same bits from serialized messages. Whatever it does not understand, be it a field, a
transform or a damaged message, is decoded and read one message at a time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.bags.cdr import CdrFields, Group, Path, UnreadableError
from occ_constraints_pkg.bags.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.bags.fields import (
    GEOMETRY,
    GREATEST,
    REDUCTIONS,
    FieldReader,
    MessageReader,
    header_stamp_ns,
    unmeasured,
)
from occ_constraints_pkg.bags.recording import Recording
from occ_constraints_pkg.bags.sources import Reading
from occ_constraints_pkg.bags.storage import Block
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.bags.transforms import RowTransforms

_STAMP = (('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec'))


@dataclass(frozen=True, eq=False)
class RowBlock:
    """Rows of features at messages of the pace topic, without repeats.

    Attributes:
        values: (n, k) float64; NaN where a value is missing or stale.
        stamps_ns: (n,) header stamps, or arrivals where there are none.
        times_ns: (n,) when the pace messages were logged.
        table: the pace message as a table, when it is one.
    """

    values: np.ndarray
    stamps_ns: np.ndarray
    times_ns: np.ndarray
    table: Table | None = None


class BlockExtractor:
    """Computes rows from one recording's blocks, in their order.

    Args:
        recording: decodes what is not read here.
        topics: topic as :func:`topic_key` writes it, to its name in the recording; the pace first,
            in the order of the blocks' numbers.
        feature_map: what to compute; :meth:`reads` must say that it can be.
    """

    def __init__(
        self, recording: Recording, topics: dict[str, str], feature_map: FeatureMap
    ) -> None:
        readings = feature_map.readings
        self._width = len(readings)
        self._max_age_ns = round(feature_map.max_age * 1e9)
        self._transforms = RowTransforms(feature_map)
        self._readers = []
        for key, name in topics.items():
            places = [
                place for place, (_, item) in enumerate(readings) if topic_key(item.topic) == key
            ]
            own = [readings[place] for place in places]
            self._readers.append((places, TopicColumns(recording, name, own)))
        self._held: list[_Held | None] = [None] * len(self._readers)
        self._last: tuple[int, np.ndarray] | None = None
        # Stamp and arrival of the last pace message.
        self._before: tuple[int, int] | None = None

    @staticmethod
    def reads(recording: Recording, topics: dict[str, str], feature_map: FeatureMap) -> bool:
        """Tell whether each message of a pace topic gives one row: the map has fields only."""
        if feature_map.rate is not None or feature_map.table_topics:
            return False
        pace = recording.topics[topics[topic_key(feature_map.pace)]]
        has_fields = any(
            topic_key(reading.topic) == topic_key(feature_map.pace)
            for _, reading in feature_map.readings
        )
        return has_fields or pace.msgtype != 'sensor_msgs/msg/PointCloud2'

    def rows(self, block: Block) -> Iterator[RowBlock]:
        """Yield the rows at the block's pace messages, all at once.

        Raises:
            OccError: a message is damaged, or lacks a field that the map asks for.
        """
        paces = np.flatnonzero(block.topics == 0)
        places, columns = self._readers[0]
        own, stamps = columns.read(block, paces)
        times = block.times[paces]
        read = np.full((len(paces), self._width), np.nan)
        # Header stamps of what is read, 0 for none.
        read_stamps = np.zeros(read.shape, dtype=np.int64)
        read[:, places], read_stamps[:, places] = own, stamps[:, None]
        for number in range(1, len(self._readers)):
            self._fill(read, read_stamps, number, block, paces, stamps)
        values = self._transform(read, read_stamps, np.where(stamps == 0, times, stamps))
        values[self._set_back(stamps, times)] = np.nan
        news = ~self._repeats(values, stamps)
        yield RowBlock(values[news], np.where(stamps == 0, times, stamps)[news], times[news])

    def _transform(
        self, read: np.ndarray, read_stamps: np.ndarray, row_times: np.ndarray
    ) -> np.ndarray:
        if not self._transforms.has_memory:
            # Then it does not matter that these are rows in time, not robots of one row.
            return self._transforms.apply(read, (), 0)
        rows = [
            self._transforms.apply(read[row : row + 1], [stamp or None for stamp in stamps], time)
            for row, (stamps, time) in enumerate(
                zip(read_stamps.tolist(), row_times.tolist(), strict=True)
            )
        ]
        return np.concatenate(rows) if rows else self._transforms.apply(read, (), 0)

    def _fill(
        self,
        values: np.ndarray,
        value_stamps: np.ndarray,
        number: int,
        block: Block,
        paces: np.ndarray,
        stamps: np.ndarray,
    ) -> None:
        """Put a topic's held values into the rows, of its last message before each of them."""
        places, columns = self._readers[number]
        rows = np.flatnonzero(block.topics == number)
        latest = np.searchsorted(rows, paces) - 1
        # The block's last message is held for the next block.
        used = np.unique(np.append(latest[latest >= 0], len(rows) - 1)) if len(rows) else rows
        read, read_stamps = columns.read(block, rows[used])
        read_times = block.times[rows[used]]
        held = self._held[number]
        if held is None:
            held = _Held(np.full(len(places), np.nan), 0, 0)
            # No age is allowed of what is not there.
            allowed = np.where(latest < 0, -1, self._max_age_ns)
        else:
            allowed = np.full(len(latest), self._max_age_ns)
        at = np.where(latest < 0, 0, 1 + np.searchsorted(used, latest))
        either = np.vstack([held.values, read])
        other_stamps = np.append(held.stamp, read_stamps)[at]
        other_times = np.append(held.time, read_times)[at]
        by_arrival = (stamps == 0) | (other_stamps == 0)
        ages = np.where(by_arrival, block.times[paces] - other_times, stamps - other_stamps)
        fresh = np.abs(ages) <= allowed
        taken = either[at]
        taken[~fresh] = np.nan
        values[:, places] = taken
        value_stamps[:, places] = np.where(fresh, other_stamps, 0)[:, None]
        if len(rows):
            self._held[number] = _Held(read[-1], int(read_stamps[-1]), int(read_times[-1]))

    def _set_back(self, stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return (m,) whether time went back at a pace message by more than a value may age."""
        if not len(stamps):
            return np.zeros(0, dtype=bool)
        stamp, time = self._before or (stamps[0], times[0])
        self._before = int(stamps[-1]), int(times[-1])
        before, earlier = np.append(stamp, stamps[:-1]), np.append(time, times[:-1])
        by_arrival = (stamps == 0) | (before == 0)
        return np.where(by_arrival, earlier - times, before - stamps) > self._max_age_ns

    def _repeats(self, values: np.ndarray, stamps: np.ndarray) -> np.ndarray:
        repeat = np.zeros(len(stamps), dtype=bool)
        if not len(stamps):
            return repeat
        stamp, row = self._last or (0, np.empty(values.shape[1]))
        before = np.append(stamp, stamps[:-1])
        for place in np.flatnonzero((stamps != 0) & (stamps == before)):
            other = values[place - 1] if place else row
            repeat[place] = np.array_equal(values[place], other, equal_nan=True)
        self._last = int(stamps[-1]), values[-1]
        return repeat


@dataclass(frozen=True, eq=False)
class _Held:
    """A topic's last message: its values, stamp (0 for none) and arrival."""

    values: np.ndarray
    stamp: int
    time: int


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

    It does what :class:`~occ_constraints_pkg.bags.fields.MessageReader` does to each message.
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
