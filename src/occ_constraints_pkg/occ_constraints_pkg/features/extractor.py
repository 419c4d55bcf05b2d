# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From messages to rows of features, in one way for live topics and for recordings."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import Channel, FeatureMap, topic_key
from occ_constraints_pkg.features.fields import NotNamedError, TopicReader, header_stamp_ns
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
    """The last message of a channel, with its values once they have been asked for.

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

    def age_ns(self, now: LatestValue, *, is_by_arrival: bool = False) -> int:
        """Return the distance to the message of the row; the future is as far as the past.

        That a clock has jumped back shows in nothing else.
        """
        return abs(self.arrival - now.arrival if is_by_arrival else self.ahead_ns(now))

    def ahead_ns(self, other: LatestValue) -> int:
        """Return by how much this message is of a later time than another one."""
        if other.stamp is None or self.stamp is None:
            return self.arrival - other.arrival
        return self.stamp - other.stamp


class _LatestOfChannel:
    """A channel with its latest value.

    Attributes:
        channel: which readings it is about.
        reader: reads them.
        latest: the last message that has all its names; None before.
        unnamed: what the last message lacked, as long as no message has had it.
    """

    def __init__(self, channel: Channel, feature_map: FeatureMap) -> None:
        self.channel = channel
        readings = [feature_map.readings[place] for place in channel.places]
        self.reader = TopicReader(list(channel.places), readings)
        self.latest: LatestValue | None = None
        self.unnamed: NotNamedError | None = None

    def take(self, message: LatestValue) -> None:
        """Make a message the latest one, unless it says nothing of this channel."""
        if self.channel.names:
            try:
                message.read(self.reader)
            except NotNamedError as error:
                self.unnamed = error if self.latest is None else None
                return
            self.unnamed = None
        self.latest = message

    def valid_at(self, now: LatestValue) -> LatestValue | None:
        """Return the latest value if it is valid at another message."""
        latest, channel = self.latest, self.channel
        if latest is None:
            return None
        age_ns = latest.age_ns(now, is_by_arrival=channel.is_by_arrival)
        return latest if age_ns <= channel.max_age_ns else None


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
        self._width = len(feature_map.readings)
        self.pace_key = topic_key(feature_map.pace)
        rate = feature_map.rate
        self._clock = None if rate is None else _Clock(rate, self._max_age_ns)
        self._channels = [_LatestOfChannel(item, feature_map) for item in feature_map.channels]
        self._of_topic: dict[str, list[_LatestOfChannel]] = {}
        for channel in self._channels:
            self._of_topic.setdefault(channel.channel.key, []).append(channel)
        self._transforms = RowTransforms(feature_map)
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
        channels = self._of_topic.get(key)
        if channels is None:
            return None
        stamp = header_stamp_ns(message)
        for channel in channels:
            channel.take(LatestValue(message, stamp, receive_time_ns))
        now = LatestValue(message, stamp, receive_time_ns)
        if key in self._lateness:
            lag = self._lateness[key].lag_ns(stamp, *(sent or (receive_time_ns,)))
            if lag > self._max_lag_ns:
                self._late[key] = lag
            else:
                self._late.pop(key, None)
        if key == self.pace_key:
            return self._row(now)
        if self._clock is None or not self._clock.is_due(stamp, receive_time_ns):
            return None
        return self._row(now)

    @property
    def listened_to(self) -> Set[str]:
        """Topics of which every message is needed: to know how late it is, or what it names."""
        named = {item.channel.key for item in self._channels if item.channel.names}
        return self._lateness.keys() | named

    @property
    def fault(self) -> str:
        """Which name that the map asks for no message has had so far; empty if none is missing."""
        return next((str(item.unnamed) for item in self._channels if item.unnamed), '')

    def check_names(self) -> None:
        """Do nothing if all names that the map asks for have come, in topics that have.

        Raises:
            DataError: one has not; the sentence says which there are.
        """
        for channel in self._channels:
            if channel.unnamed is not None:
                raise channel.unnamed

    def ages_ns(self) -> list[int | None]:
        """Return how far each reading's value was from the last row, in ns; None where none came.

        They are in the order of the map's readings.
        """
        ages: list[int | None] = [None] * self._width
        for channel in self._channels:
            latest, item = channel.latest, channel.channel
            if self._now is not None and latest is not None:
                for place in item.places:
                    ages[place] = latest.age_ns(self._now, is_by_arrival=item.is_by_arrival)
        return ages

    def newest(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (k,) what the newest messages say of each feature before its steps, and after.

        Of several robots the first; NaN where nothing was read so far.
        """
        count = len(self.feature_map.features)
        read, values = np.full(self._width, np.nan), self._last[1]
        for channel in self._channels:
            if channel.latest is not None and len(channel.latest.values):
                read[channel.reader.columns] = channel.latest.values[0]
        return read[:count], values[0] if len(values) else np.full(count, np.nan)

    def _row(self, now: LatestValue) -> FeatureRows:
        """Compute the features from the latest values that are valid at a message."""
        back_ns = 0 if self._now is None else self._now.ahead_ns(now)
        self._now = now
        parts = []
        for channel in self._channels:
            if (latest := channel.valid_at(now)) is not None:
                latest.read(channel.reader)
                parts.append((channel, latest))
        row_ns = now.arrival if now.stamp is None else now.stamp
        # The pace topic's channel without names comes first.
        pace = parts[0][1] if self.pace_key else None
        stamps: list[int | None]
        if pace is not None and len(self._channels) == 1:
            read, stamps = pace.values, [now.stamp] * self._width
        else:
            read, stamps = self._gathered(pace, parts)
        table = None if pace is None else pace.table
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
        self, pace: LatestValue | None, parts: list[tuple[_LatestOfChannel, LatestValue]]
    ) -> tuple[np.ndarray, list[int | None]]:
        """Return (rows, readings) of several channels, and each reading's stamp."""
        if pace is not None:
            count = len(pace.values)
        else:
            count = max((len(latest.values) for _, latest in parts), default=1)
        read = np.full((count, self._width), np.nan)
        stamps: list[int | None] = [None] * self._width
        for channel, latest in parts:
            if len(latest.values) not in (1, count):
                raise DataError(
                    f'topic {channel.channel.key!r} holds {len(latest.values)} rows and '
                    + (f'the pace topic {self.pace_key!r}' if self.pace_key else 'another')
                    + f' {count}; allowed are 1 or as many'
                )
            columns = channel.reader.columns
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
