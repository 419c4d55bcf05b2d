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
from occ_constraints_pkg.bags.feature_map import FeatureMap, FeatureSource, topic_key
from occ_constraints_pkg.bags.fields import FieldReader, header_stamp_ns, unmeasured
from occ_constraints_pkg.bags.recording import Recording
from occ_constraints_pkg.bags.storage import Block
from occ_constraints_pkg.bags.table import Table

_RANGE_MAX = ('range_max',)
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
        self._width = len(feature_map.features)
        self._max_age_ns = round(feature_map.max_age * 1e9)
        self._readers = []
        for key, name in topics.items():
            places = [
                place
                for place, source in enumerate(feature_map.features)
                if topic_key(source.topic) == key
            ]
            sources = [feature_map.features[place] for place in places]
            self._readers.append((places, TopicColumns(recording, name, sources)))
        self._held: list[_Held | None] = [None] * len(self._readers)
        self._last: tuple[int, np.ndarray] | None = None

    @staticmethod
    def reads(recording: Recording, topics: dict[str, str], feature_map: FeatureMap) -> bool:
        """Tell whether the map has fields only, so that each pace message gives one row."""
        if any(source.column is not None for source in feature_map.features):
            return False
        pace = recording.topics[topics[topic_key(feature_map.pace)]]
        has_fields = any(
            topic_key(source.topic) == topic_key(feature_map.pace)
            for source in feature_map.features
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
        values = np.full((len(paces), self._width), np.nan)
        values[:, places] = own
        for number in range(1, len(self._readers)):
            self._fill(values, number, block, paces, stamps)
        news = ~self._repeats(values, stamps)
        yield RowBlock(values[news], np.where(stamps == 0, times, stamps)[news], times[news])

    def _fill(
        self, values: np.ndarray, number: int, block: Block, paces: np.ndarray, stamps: np.ndarray
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
        if len(rows):
            self._held[number] = _Held(read[-1], int(read_stamps[-1]), int(read_times[-1]))

    def _repeats(self, values: np.ndarray, stamps: np.ndarray) -> np.ndarray:
        repeat = np.zeros(len(stamps), dtype=bool)
        if not len(stamps):
            return repeat
        stamp, row = self._last or (0, np.empty(self._width))
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
    """Reads all features that one topic gives, from many messages at a time.

    Args:
        recording: where the topic's type is defined.
        topic: its name in the recording.
        sources: the features; each has a field.
    """

    def __init__(self, recording: Recording, topic: str, sources: Sequence[FeatureSource]) -> None:
        self._recording, self._topic = recording, topic
        self._sources = sources
        self._readers = [FieldReader(source) for source in sources]
        definitions = recording.fields(topic)
        msgtype = recording.topics[topic].msgtype
        paths: list[Path] = [reader.path for reader in self._readers]
        self._stamp = len(paths) if _has_stamp(definitions, msgtype) else None
        paths += _STAMP if self._stamp is not None else ()
        self._range_max = None
        if any(source.missing == 'max_range' for source in sources):
            self._range_max = len(paths)
            paths.append(_RANGE_MAX)
        try:
            self._fields = CdrFields(definitions, msgtype, paths)
            kinds = self._fields.kinds
            known = self._range_max is None or kinds[self._range_max] == 'number'
            if not (known and all(map(_is_understood, sources, kinds))):
                self._fields = None
        except UnreadableError:
            self._fields = None

    def read(self, block: Block, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (m, features) float64 values and (m,) header stamps in ns, 0 for none.

        Args:
            block: holds the messages.
            rows: (m,) which of its messages to read; all are of this topic.

        Raises:
            OccError: a message is damaged or lacks a field.
        """
        if not len(rows):
            return np.empty((0, len(self._sources))), np.empty(0, dtype=np.int64)
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
        values = np.empty((len(rows), len(self._sources)))
        stamps = np.zeros(len(rows), dtype=np.int64)
        for place, row in enumerate(rows.tolist()):
            message = self._recording.decode(self._recording.raw(block, row, self._topic))
            values[place] = [reader.read(message) for reader in self._readers]
            stamps[place] = header_stamp_ns(message) or 0
        return values, stamps

    def _finish(self, found: list[list[Group]], count: int) -> tuple[np.ndarray, np.ndarray]:
        values, shared = np.empty((count, len(self._sources))), {}
        furthest = None if self._range_max is None else _column(found[self._range_max])
        for place, source in enumerate(self._sources):
            for group in found[place]:
                limit = None if furthest is None else furthest[group.rows]
                values[group.rows, place] = _numbers(source, group, limit, shared)
        stamps = np.zeros(count, dtype=np.int64)
        if self._stamp is not None:
            # A float64 holds each 32-bit number exactly.
            seconds, rest = (
                _column(found[self._stamp + part]).astype(np.int64) for part in range(2)
            )
            stamps = seconds * 1_000_000_000 + rest
        return values, stamps


def _column(groups: list[Group]) -> np.ndarray:
    return groups[0].values[:, 0].astype(np.float64)


def _has_stamp(definitions: dict[str, Any], msgtype: str) -> bool:
    """Tell whether the type begins the way to a stamp as std_msgs/msg/Header has it."""
    for name in _STAMP[0][:-1]:
        field = dict(definitions[msgtype][1] if msgtype in definitions else ()).get(name)
        if field is None or not isinstance(field[1], str):
            return False
        msgtype = field[1]
    return msgtype in definitions and {'sec', 'nanosec'} <= dict(definitions[msgtype][1]).keys()


def _is_understood(source: FeatureSource, kind: str) -> bool:
    """Tell whether :func:`_numbers` does all that the source says, to a field of that kind."""
    told = FeatureSource(
        source.name,
        source.topic,
        source.field,
        unit=source.unit,
        low=source.low,
        high=source.high,
        reduce=source.reduce,
        transform=source.transform,
        missing=source.missing,
        family=source.family,
    )
    if told != source or source.missing not in ('unknown', 'max_range'):
        return False
    if source.transform == 'yaw':
        return kind == 'vector' and source.reduce is None
    fits = kind == 'number' if source.reduce is None else kind != 'number'
    return (
        fits
        and source.transform in (None, 'abs')
        and source.reduce in (None, 'min', 'max', 'mean', 'norm')
    )


def _numbers(
    source: FeatureSource, group: Group, furthest: np.ndarray | None, shared: dict[int, Any]
) -> np.ndarray:
    """Do to all rows of a group what :class:`FieldReader` does to a value: (m,) float64."""
    if source.transform == 'yaw':
        return _yaws(group.values)
    if source.reduce is not None:
        numbers = _reduced(source, group, furthest, shared)
    else:
        numbers = group.values[:, 0].astype(np.float64)
        if source.missing == 'max_range':
            numbers = np.where(unmeasured(numbers), furthest, numbers)
    return np.abs(numbers) if source.transform == 'abs' else numbers


def _reduced(
    source: FeatureSource, group: Group, furthest: np.ndarray | None, shared: dict[int, Any]
) -> np.ndarray:
    if group.start == group.stop:
        return np.full(len(group.rows), np.nan)
    part = slice(group.start, group.stop)
    base, blind = group.base, None
    if source.missing == 'max_range':
        # Several features mostly lie in one array, of which this is done once.
        if id(base) not in shared:
            # As float32, when both are, is exact.
            limit = furthest.astype(base.dtype)
            limit = limit if np.array_equal(limit, furthest, equal_nan=True) else furthest
            filled = np.where(unmeasured(base), limit[:, None], base)
            shared[id(base)] = filled, (base > 0) | (base == -np.inf)
        base, says_something = shared[id(base)]
        blind = ~says_something[:, part].any(axis=1)
    numbers = base[:, part]
    match source.reduce:
        case 'min':
            result = numbers.min(axis=1)
        case 'max':
            result = numbers.max(axis=1)
        case 'mean':
            result = numbers.astype(np.float64).mean(axis=1)
        case _:
            # Row by row, for along an axis NumPy sums the squares in another order.
            result = np.array([np.linalg.norm(row) for row in numbers.astype(np.float64)])
    return result if blind is None else np.where(blind, np.nan, result)


def _yaws(quaternions: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternions.T.astype(np.float64)
    sines, cosines = 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z
    # The arctangent of NumPy may differ from that of math in the last bit.
    angles = map(math.atan2, sines.tolist(), cosines.tolist())
    unset = (sines == 0.0) & (cosines == 0.0)
    return np.where(unset, np.nan, list(angles))
