# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Features of recordings by blocks: what pushing message by message gives, many times as fast.

:class:`~occ_constraints_pkg.features.extractor.FeatureExtractor` states what a row is; this module
computes the same bits from serialized messages. Whatever it does not understand, be it a field, a
transform or a damaged message, is decoded and read one message at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from occ_constraints_pkg.datasets.topic_columns import TopicColumns
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.lateness import lateness_of
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.transforms import RowTransforms
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block


@dataclass(frozen=True, eq=False)
class RowBlock:
    """Rows of features at messages of the pace topic, without repeats.

    Attributes:
        values: (n, k) float64; NaN where a value is missing or stale.
        stamps_ns: (n,) header stamps, or arrivals where there are none.
        times_ns: (n,) when the pace messages were logged.
        table: the pace message as a table, when it is one.
        messages: (n,) numbers of the pace messages in the block; empty for tables.
    """

    values: np.ndarray
    stamps_ns: np.ndarray
    times_ns: np.ndarray
    table: Table | None = None
    messages: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.intp))


class BlockExtractor:
    """Computes rows from one recording's blocks, in their order.

    Args:
        recording: decodes what is not read here.
        topics: topic as :func:`topic_key` writes it, to its name in the recording; the pace first,
            in the order of the blocks' numbers.
        feature_map: what to compute; :meth:`reads` must say that it can be.
        max_lag: see :class:`~occ_constraints_pkg.features.extractor.FeatureExtractor`.
    """

    def __init__(
        self,
        recording: Recording,
        topics: dict[str, str],
        feature_map: FeatureMap,
        max_lag: float = 0.0,
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
        self._max_lag_ns = round(max_lag * 1e9)
        lateness = lateness_of(feature_map, self._max_lag_ns)
        # Of each topic, what reads its stamps alone, and whether its last message came too late.
        self._timed = [
            (lateness[key], TopicColumns(recording, name, ()))
            for key, name in topics.items()
            if lateness
        ]
        self._was_late = [False] * len(self._timed)
        self._latest: list[_LatestValues | None] = [None] * len(self._readers)
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
        values[self._set_back(stamps, times) | self._late(block, paces)] = np.nan
        news = ~self._repeats(values, stamps)
        row_times = np.where(stamps == 0, times, stamps)
        yield RowBlock(values[news], row_times[news], times[news], messages=paces[news])

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
        """Put a topic's latest values into the rows, from its last message before each of them."""
        places, columns = self._readers[number]
        rows = np.flatnonzero(block.topics == number)
        latest = np.searchsorted(rows, paces) - 1
        # The block's last message is the latest value when the next block begins.
        used = np.unique(np.append(latest[latest >= 0], len(rows) - 1)) if len(rows) else rows
        read, read_stamps = columns.read(block, rows[used])
        read_times = block.times[rows[used]]
        latest_values = self._latest[number]
        if latest_values is None:
            latest_values = _LatestValues(np.full(len(places), np.nan), 0, 0)
            # No age is allowed of what is not there.
            allowed = np.where(latest < 0, -1, self._max_age_ns)
        else:
            allowed = np.full(len(latest), self._max_age_ns)
        at = np.where(latest < 0, 0, 1 + np.searchsorted(used, latest))
        either = np.vstack([latest_values.values, read])
        other_stamps = np.append(latest_values.stamp, read_stamps)[at]
        other_times = np.append(latest_values.time, read_times)[at]
        by_arrival = (stamps == 0) | (other_stamps == 0)
        ages = np.where(by_arrival, block.times[paces] - other_times, stamps - other_stamps)
        fresh = np.abs(ages) <= allowed
        taken = either[at]
        taken[~fresh] = np.nan
        values[:, places] = taken
        value_stamps[:, places] = np.where(fresh, other_stamps, 0)[:, None]
        if len(rows):
            self._latest[number] = _LatestValues(
                read[-1], int(read_stamps[-1]), int(read_times[-1])
            )

    def _set_back(self, stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return (m,) whether time went back at a pace message by more than a value may age."""
        if not len(stamps):
            return np.zeros(0, dtype=bool)
        stamp, time = self._before or (stamps[0], times[0])
        self._before = int(stamps[-1]), int(times[-1])
        before, earlier = np.append(stamp, stamps[:-1]), np.append(time, times[:-1])
        by_arrival = (stamps == 0) | (before == 0)
        return np.where(by_arrival, earlier - times, before - stamps) > self._max_age_ns

    def _late(self, block: Block, paces: np.ndarray) -> np.ndarray:
        """Return (m,) whether a topic's last message up to each pace message came too late."""
        late = np.zeros(len(paces), dtype=bool)
        for number, (lateness, columns) in enumerate(self._timed):
            rows = np.flatnonzero(block.topics == number)
            stamps, times = columns.read(block, rows)[1].tolist(), block.times[rows].tolist()
            own = [self._was_late[number]]
            own += [
                lateness.lag_ns(stamp or None, time) > self._max_lag_ns
                for stamp, time in zip(stamps, times, strict=True)
            ]
            self._was_late[number] = own[-1]
            late |= np.array(own)[np.searchsorted(rows, paces, side='right')]
        return late

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
class _LatestValues:
    """A topic's last message: its values, stamp (0 for none) and arrival."""

    values: np.ndarray
    stamp: int
    time: int
