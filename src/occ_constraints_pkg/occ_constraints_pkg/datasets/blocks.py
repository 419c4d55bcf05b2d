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

from occ_constraints_pkg.datasets.topic_columns import TopicColumns, Walk
from occ_constraints_pkg.features.feature_map import Channel, FeatureMap, topic_key
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
        ages_ns: (n, readings) how far each reading's message is from the row, in ns; NaN before
            the first one. Empty where it was not asked for.
    """

    values: np.ndarray
    stamps_ns: np.ndarray
    times_ns: np.ndarray
    table: Table | None = None
    ages_ns: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))


class BlockExtractor:
    """Computes rows from one recording's blocks, in their order.

    Args:
        recording: decodes what is not read here.
        topics: topic as :func:`topic_key` writes it, to its name in the recording; the pace first,
            in the order of the blocks' numbers.
        feature_map: what to compute; :meth:`reads` must say that it can be.
        max_lag: see :class:`~occ_constraints_pkg.features.extractor.FeatureExtractor`.
        with_ages: whether rows tell how old their values are.
    """

    def __init__(
        self,
        recording: Recording,
        topics: dict[str, str],
        feature_map: FeatureMap,
        max_lag: float = 0.0,
        *,
        with_ages: bool = False,
    ) -> None:
        self._with_ages = with_ages
        self._width = len(feature_map.readings)
        self._max_age_ns = round(feature_map.max_age * 1e9)
        self._transforms = RowTransforms(feature_map)
        self._walks: dict[str, Walk] = {}
        self._channels = [
            _Channel(item, recording, topics, feature_map, self._walks)
            for item in feature_map.channels
        ]
        self._max_lag_ns = round(max_lag * 1e9)
        lateness = lateness_of(feature_map, self._max_lag_ns)
        # Of each topic, what reads its stamps alone, and whether its last message came too late.
        self._timed = [
            (lateness[key], TopicColumns(recording, name, ()))
            for key, name in topics.items()
            if lateness
        ]
        self._was_late = [False] * len(self._timed)
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
        self._walks.clear()
        paces = np.flatnonzero(block.topics == 0)
        pace, *others = self._channels
        own, stamps = pace.columns.read(block, paces)
        times = block.times[paces]
        read = np.full((len(paces), self._width), np.nan)
        # Header stamps of what is read, 0 for none.
        read_stamps = np.zeros(read.shape, dtype=np.int64)
        read[:, pace.places], read_stamps[:, pace.places] = own, stamps[:, None]
        ages = np.zeros((len(paces), self._width if self._with_ages else 0))
        for channel in others:
            own_ages = channel.fill(read, read_stamps, block, paces, stamps)
            if self._with_ages:
                ages[:, channel.places] = own_ages[:, None]
        values = self._transform(read, read_stamps, np.where(stamps == 0, times, stamps))
        values[self._set_back(stamps, times) | self._late(block, paces)] = np.nan
        news = ~self._repeats(values, stamps)
        row_times = np.where(stamps == 0, times, stamps)
        yield RowBlock(values[news], row_times[news], times[news], ages_ns=ages[news])

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

    def check_names(self) -> None:
        """Do nothing if all names that the map asks for have come, in topics that have.

        Raises:
            DataError: one has not.
        """
        for channel in self._channels:
            if channel.columns.unnamed is not None:
                raise channel.columns.unnamed

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


class _Channel:
    """One channel of a map in a recording's blocks, with its latest values.

    Attributes:
        places: indices of its readings among those of the map.
        columns: reads them.
    """

    def __init__(
        self,
        channel: Channel,
        recording: Recording,
        topics: dict[str, str],
        feature_map: FeatureMap,
        walks: dict[str, Walk],
    ) -> None:
        self.places = list(channel.places)
        own = [feature_map.readings[place] for place in self.places]
        # Channels with names read all messages of their topic, and mostly the same of them.
        shared = walks if channel.names else None
        self.columns = TopicColumns(recording, topics[channel.key], own, shared)
        self._channel = channel
        self._number = list(topics).index(channel.key)
        self._latest: _LatestValues | None = None

    def fill(
        self,
        values: np.ndarray,
        value_stamps: np.ndarray,
        block: Block,
        paces: np.ndarray,
        stamps: np.ndarray,
    ) -> np.ndarray:
        """Put the latest values into the rows, from the last message up to each of them.

        Returns:
            (n,) how old they are in ns; NaN before the first message.
        """
        rows = np.flatnonzero(block.topics == self._number)
        named = None
        if self._channel.names:
            named = self.columns.read_named(block, rows)
            rows = rows[named[2]]
        latest = np.searchsorted(rows, paces, side='right') - 1
        if named is not None:
            used = np.arange(len(rows))
            read, read_stamps = (part[named[2]] for part in named[:2])
        else:
            # The block's last message is the latest value when the next block begins.
            last = len(rows) - 1
            used = np.unique(np.append(latest[latest >= 0], last)) if len(rows) else rows
            read, read_stamps = self.columns.read(block, rows[used])
        read_times = block.times[rows[used]]
        before, max_age_ns = self._latest, self._channel.max_age_ns
        if before is None:
            before = _LatestValues(np.full(len(self.places), np.nan), 0, 0)
            # No age is allowed of what is not there.
            allowed = np.where(latest < 0, -1, max_age_ns)
        else:
            allowed = np.full(len(latest), max_age_ns)
        at = np.where(latest < 0, 0, 1 + np.searchsorted(used, latest))
        either = np.vstack([before.values, read])
        other_stamps = np.append(before.stamp, read_stamps)[at]
        other_times = np.append(before.time, read_times)[at]
        by_arrival = (stamps == 0) | (other_stamps == 0) | self._channel.is_by_arrival
        ages = np.where(by_arrival, block.times[paces] - other_times, stamps - other_stamps)
        fresh = np.abs(ages) <= allowed
        taken = either[at]
        taken[~fresh] = np.nan
        values[:, self.places] = taken
        value_stamps[:, self.places] = np.where(fresh, other_stamps, 0)[:, None]
        if len(rows):
            self._latest = _LatestValues(read[-1], int(read_stamps[-1]), int(read_times[-1]))
        return np.where(allowed < 0, np.nan, np.abs(ages))


@dataclass(frozen=True, eq=False)
class _LatestValues:
    """A channel's last message: its values, stamp (0 for none) and arrival."""

    values: np.ndarray
    stamp: int
    time: int
