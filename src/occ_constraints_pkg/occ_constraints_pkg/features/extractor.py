# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From messages to rows of features, in one way for live topics and for recordings."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.fields import TopicReader, header_stamp_ns
from occ_constraints_pkg.features.lateness import describe_lateness, lateness_of
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.transforms import RowTransforms


@dataclass(frozen=True)
class FeatureRows:
    """The features at one message of the trigger topic, which the map calls ``pace``.

    Attributes:
        stamp_ns: the message's header stamp, or its arrival where it has none.
        values: (rows, k) float64, one row per robot; NaN where a value is missing or stale.
        table: the pace message as a table, when it is one.
        repeat: whether header stamp and values are those of the row before: a simulation repeats
            its last observation when nothing answers it. Whoever counts rows skips it. Other values
            under the same stamp are new, from a sensor whose clock has stopped.
        note: why all values are missing, if it is not for the messages; else empty.
    """

    stamp_ns: int
    values: np.ndarray
    table: Table | None
    repeat: bool
    note: str = ''


_UNREAD = np.empty((0, 0))


class LatestValue:
    """The last message of a topic, with its values once they have been asked for.

    Attributes:
        message: of rosbags or rclpy, or a :class:`TableMessage`.
        stamp: its header stamp in ns; None without one.
        arrival: when it came, in ns.
        values: (rows, readings) float64; empty until :meth:`read`.
        table: the message as a table, if it is one.
    """

    def __init__(self, message: Any, stamp: int | None, arrival: int) -> None:
        self.message, self.stamp, self.arrival = message, stamp, arrival
        self.values = _UNREAD
        self.table: Table | None = None

    def read(self, reader: TopicReader) -> None:
        """Set ``values``, and ``table`` for a table."""
        if self.values is _UNREAD:
            self.values, self.table = reader.read(self.message)

    def age_ns(self, stamp: int | None, arrival: int) -> int:
        """Return the distance to the message of the row; the future is as far as the past.

        That a clock has jumped back shows in nothing else.
        """
        return abs(self.ahead_ns(stamp, arrival))

    def ahead_ns(self, stamp: int | None, arrival: int) -> int:
        """Return by how much this message is of a later time than another one."""
        if stamp is None or self.stamp is None:
            return self.arrival - arrival
        return self.stamp - stamp


class FeatureExtractor:
    """Aligns messages in time and computes features; used live and offline alike.

    The rows depend on nothing but the map and the sequence of calls to :meth:`push`, so a
    recording that is played in its own order yields what the live topics yielded.

    Attributes:
        feature_map: what is computed.
        pace_key: the pace topic without leading slash; empty with a fixed rate.

    Args:
        feature_map: what to compute.
        max_lag: seconds that a message may come late, see
            :class:`~occ_constraints_pkg.features.lateness.Lateness`; while the last message of a
            topic came later, all values are missing. 0 for any. Stamps of tables only tell steps
            apart and are not looked at.
    """

    def __init__(self, feature_map: FeatureMap, max_lag: float = 0.0) -> None:
        self.feature_map = feature_map
        self._max_lag_ns = round(max_lag * 1e9)
        self._lateness = lateness_of(feature_map, self._max_lag_ns)
        # The lag in ns of those topics whose last message came too late.
        self._late: dict[str, int] = {}
        self._max_age_ns = round(feature_map.max_age * 1e9)
        self._readings = feature_map.readings
        groups: dict[str, list[int]] = {topic_key(topic): [] for topic in feature_map.topics}
        for index, (_, reading) in enumerate(self._readings):
            groups[topic_key(reading.topic)].append(index)
        self.pace_key = topic_key(feature_map.pace)
        rate = feature_map.rate
        self._clock = None if rate is None else _Clock(rate, self._max_age_ns)
        self._readers = {
            key: TopicReader(columns, [self._readings[column] for column in columns])
            for key, columns in groups.items()
        }
        self._transforms = RowTransforms(feature_map)
        self._latest: dict[str, LatestValue] = {}
        self._now: LatestValue | None = None
        self._episodes = np.empty(0)
        self._last: tuple[int | None, np.ndarray] = (None, np.empty((0, 0)))

    def push(
        self,
        topic: str,
        message: Any,
        receive_time_ns: int,
        sent: tuple[int, int] | None = None,
    ) -> FeatureRows | None:
        """Take one message; return rows if it gives some, see :class:`FeatureMap`.

        Args:
            topic: the topic's name as in the feature map, with or without leading slash; a
                message of a topic that the map does not use is ignored.
            message: a message of ``rosbags`` or ``rclpy``, or a :class:`TableMessage`.
            receive_time_ns: when it arrived, on the same clock for all topics.
            sent: when it was published, by its publisher's system clock, and when it arrived, on a
                clock that never jumps, in ns; None where that is not known.

        Raises:
            OccError: the message lacks a field or column that the map asks for, or the tables
                of two topics have different numbers of rows.
        """
        key = topic_key(topic)
        if key not in self._readers:
            return None
        latest = LatestValue(message, header_stamp_ns(message), receive_time_ns)
        if key in self._lateness:
            lag = self._lateness[key].lag_ns(latest.stamp, *(sent or (receive_time_ns,)))
            if lag > self._max_lag_ns:
                self._late[key] = lag
            else:
                self._late.pop(key, None)
        if key == self.pace_key:
            others = self._fresh(latest, {key}) if self._latest else {}
            return self._row(latest, {key: latest, **others})
        self._latest[key] = latest
        if self._clock is None or not self._clock.is_due(latest.stamp, receive_time_ns):
            return None
        return self._row(latest, self._fresh(latest, set()))

    @property
    def timed(self) -> Set[str]:
        """Topics of which every message is needed, to know how late it is."""
        return self._lateness.keys()

    def ages_ns(self) -> dict[str, int | None]:
        """Return how far each topic's value was from the last row, in ns; None where none came.

        Topics are those of the map; the one that sets the pace is not among them.
        """
        now, ages = self._now, {}
        for topic in self.feature_map.topics:
            latest = self._latest.get(topic_key(topic))
            if topic_key(topic) != self.pace_key:
                ages[topic] = latest.age_ns(now.stamp, now.arrival) if now and latest else None
        return ages

    def _fresh(self, now: LatestValue, besides: set[str]) -> dict[str, LatestValue]:
        """Return the latest value of each topic that is valid at the message ``now``."""
        return {
            key: latest
            for key, latest in self._latest.items()
            if key not in besides and latest.age_ns(now.stamp, now.arrival) <= self._max_age_ns
        }

    def _row(self, now: LatestValue, parts: dict[str, LatestValue]) -> FeatureRows:
        """Compute the features from the messages in ``parts``."""
        back_ns = 0 if self._now is None else self._now.ahead_ns(now.stamp, now.arrival)
        self._now = now
        for key, value in parts.items():
            value.read(self._readers[key])
        row_ns = now.arrival if now.stamp is None else now.stamp
        if self.pace_key and len(self._readers) == 1:
            read, stamps = now.values, [now.stamp] * len(self._readings)
        else:
            read, stamps = self._gathered(now, parts)
        table = now.table if self.pace_key else None
        values = self._transforms.apply(read, stamps, row_ns, self._restarted(table))
        last_stamp, last_values = self._last
        note = ''
        if back_ns > self._max_age_ns and table is None:
            # The latest values are of another time. Stamps of tables only tell steps apart.
            values, note = np.full_like(values, np.nan), f'time went back by {back_ns * 1e-9:.3g} s'
        elif self._late:
            topic, lag = next(iter(self._late.items()))
            note = describe_lateness(topic, lag, self._max_lag_ns)
            values = np.full_like(values, np.nan)
        repeat = now.stamp is not None and now.stamp == last_stamp
        repeat = repeat and np.array_equal(values, last_values, equal_nan=True)
        self._last = now.stamp, values
        return FeatureRows(row_ns, values, table, repeat, note)

    def _gathered(
        self, now: LatestValue, parts: dict[str, LatestValue]
    ) -> tuple[np.ndarray, list[int | None]]:
        """Return (rows, readings) of several topics, and each reading's stamp."""
        count = max((len(latest.values) for latest in parts.values()), default=1)
        if self.pace_key:
            count = len(now.values)
        read = np.full((count, len(self._readings)), np.nan)
        stamps: list[int | None] = [None] * len(self._readings)
        for key, latest in parts.items():
            if len(latest.values) not in (1, count):
                raise DataError(
                    f'topic {key!r} holds {len(latest.values)} rows and '
                    + (f'the pace topic {self.pace_key!r}' if self.pace_key else 'another')
                    + f' {count}; allowed are 1 or as many'
                )
            columns = self._readers[key].columns
            read[:, columns] = latest.values
            for column in columns:
                stamps[column] = latest.stamp
        return read, stamps

    def _restarted(self, table: Table | None) -> np.ndarray | None:
        """Tell which rows of a table are of another episode than before."""
        if table is None or 'episode' not in table.names:
            return None
        episodes, self._episodes = self._episodes, table.column('episode').copy()
        return None if len(episodes) != len(self._episodes) else episodes != self._episodes


class _Clock:
    """Says which messages give a row at a fixed rate: the first in each period."""

    def __init__(self, rate: float, max_age_ns: int) -> None:
        self._period_ns = max(round(1e9 / rate), 1)
        self._max_age_ns = max_age_ns
        self._has_stamps = False
        self._last_ns: int | None = None

    def is_due(self, stamp: int | None, arrival: int) -> bool:
        if stamp is None and self._has_stamps:
            return False
        now = arrival if stamp is None else stamp
        last, begins = self._last_ns, stamp is not None and not self._has_stamps
        self._has_stamps = self._has_stamps or stamp is not None
        # Stamps of different topics are not in order; only a larger step back is a clock set back.
        was_set_back = last is not None and now < last - self._max_age_ns
        due = last is None or begins or was_set_back
        if not due and last is not None:
            due = now // self._period_ns > last // self._period_ns
        if due:
            self._last_ns = now
        return due
