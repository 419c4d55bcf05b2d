# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From messages to rows of features, in one way for live topics and for recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.bags.columns import BlockExtractor, RowBlock
from occ_constraints_pkg.bags.dataset import Dataset
from occ_constraints_pkg.bags.feature_map import FeatureMap, FeatureSource, topic_key
from occ_constraints_pkg.bags.fields import FieldReader, header_stamp_ns
from occ_constraints_pkg.bags.manifest import Selection, select
from occ_constraints_pkg.bags.recording import RawMessage, Recording
from occ_constraints_pkg.bags.storage import Block
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import OccError


@dataclass(frozen=True)
class FeatureRows:
    """The features at one message of the pace topic.

    Attributes:
        stamp_ns: the message's header stamp, or its arrival where it has none.
        values: (rows, k) float64, one row per robot; NaN where a value is missing or stale.
        table: the pace message as a table, when it is one.
        repeat: whether header stamp and values are those of the row before: a simulation repeats
            its last observation when nothing answers it. Whoever counts rows skips it. Other values
            under the same stamp are news, from a sensor whose clock stands still.
    """

    stamp_ns: int
    values: np.ndarray
    table: Table | None
    repeat: bool


class FeatureExtractor:
    """Aligns messages in time and computes features; used live and offline alike.

    The rows depend on nothing but the map and the sequence of calls to :meth:`push`, so a
    recording that is played in its own order yields what the live topics yielded.

    Args:
        feature_map: what to compute.
    """

    def __init__(self, feature_map: FeatureMap) -> None:
        self.feature_map = feature_map
        self._max_age_ns = round(feature_map.max_age * 1e9)
        groups: dict[str, list[int]] = {topic_key(feature_map.pace): []}
        for place, source in enumerate(feature_map.features):
            groups.setdefault(topic_key(source.topic), []).append(place)
        self._pace = topic_key(feature_map.pace)
        self._readers = {
            key: _TopicReader(places, [feature_map.features[place] for place in places])
            for key, places in groups.items()
        }
        self._held: dict[str, _Held] = {}
        self._last: tuple[int | None, np.ndarray] = (None, np.empty((0, 0)))

    def push(self, topic: str, message: Any, receive_time_ns: int) -> FeatureRows | None:
        """Take one message; return rows if it is of the pace topic.

        Args:
            topic: the topic's name as in the feature map, with or without leading slash; a
                message of a topic that the map does not use is ignored.
            message: a message of ``rosbags`` or ``rclpy``.
            receive_time_ns: when it arrived, on the same clock for all topics.

        Raises:
            OccError: the message lacks a field or column that the map asks for, or the tables
                of two topics have different numbers of rows.
        """
        key = topic_key(topic)
        reader = self._readers.get(key)
        if reader is None:
            return None
        stamp = header_stamp_ns(message)
        if key != self._pace:
            self._held[key] = _Held(message, stamp, receive_time_ns)
            return None
        values, table = reader.read(message)
        if len(reader.places) < len(self.feature_map.features):
            own, values = values, np.full((len(values), len(self.feature_map.features)), np.nan)
            values[:, reader.places] = own
            for other, held in self._held.items():
                if held.age_ns(stamp, receive_time_ns) <= self._max_age_ns:
                    self._fill(values, other, held)
        last_stamp, last_values = self._last
        repeat = stamp is not None and stamp == last_stamp
        repeat = repeat and np.array_equal(values, last_values, equal_nan=True)
        self._last = stamp, values
        return FeatureRows(receive_time_ns if stamp is None else stamp, values, table, repeat)

    def _fill(self, values: np.ndarray, key: str, held: _Held) -> None:
        """Put a held topic's features into ``values``, one row for all or row by row."""
        reader = self._readers[key]
        if held.values is None:
            held.values, _ = reader.read(held.message)
        if len(held.values) not in (1, len(values)):
            raise OccError(
                f'topic {key!r} holds {len(held.values)} rows and the pace topic '
                f'{self._pace!r} {len(values)}; allowed are 1 or as many'
            )
        values[:, reader.places] = held.values


class _Held:
    """The last message of a topic, with its values once they have been asked for."""

    def __init__(self, message: Any, stamp: int | None, arrival: int) -> None:
        self.message, self.stamp, self.arrival = message, stamp, arrival
        self.values: np.ndarray | None = None

    def age_ns(self, stamp: int | None, arrival: int) -> int:
        """Return the distance to the pace message; one from the future is as far off as a past one.

        That a clock has jumped back shows in nothing else.
        """
        if stamp is None or self.stamp is None:
            return abs(arrival - self.arrival)
        return abs(stamp - self.stamp)


class _TopicReader:
    """Reads all features that one topic gives."""

    def __init__(self, places: list[int], sources: list[FeatureSource]) -> None:
        self.places = places
        self._sources = sources
        self._fields = [FieldReader(source) for source in sources if source.column is None]
        self._absolute = [i for i, source in enumerate(sources) if source.transform == 'abs']
        self._names: tuple[str, ...] | None = None
        self._columns = np.empty(0, dtype=np.intp)

    def read(self, message: Any) -> tuple[np.ndarray, Table | None]:
        """Return (rows, features of this topic) float64, and the message as table if it is one."""
        if self._fields or not (self._sources or hasattr(message, 'point_step')):
            return np.array([[field.read(message) for field in self._fields]]), None
        if not hasattr(message, 'point_step'):
            source = self._sources[0]
            raise OccError(
                f'feature {source.name!r} asks for column {source.column!r} of topic '
                f'{source.topic!r}, whose messages are {type(message).__name__}; '
                'allowed is a table (sensor_msgs/msg/PointCloud2)'
            )
        table = Table.from_message(message)
        if table.names != self._names:
            self._columns = np.array([self._find(table, s) for s in self._sources], dtype=np.intp)
            self._names = table.names
        values = table.values[:, self._columns].astype(np.float64, copy=False)
        if self._absolute:
            values[:, self._absolute] = np.abs(values[:, self._absolute])
        return values, table

    @staticmethod
    def _find(table: Table, source: FeatureSource) -> int:
        try:
            return table.names.index(source.column)
        except ValueError:
            hint = did_you_mean(source.column, table.names) or ';'
            raise OccError(
                f'feature {source.name!r} asks for column {source.column!r} of topic '
                f'{source.topic!r}, which the table does not have{hint} '
                f'its columns are {", ".join(table.names)}'
            ) from None


def extract(
    paths: Sequence[str | Path],
    feature_map: FeatureMap,
    *,
    progress: Callable[[int, int], None] | None = None,
    provenance: bool = True,
) -> Dataset:
    """Compute the features of recordings.

    Repeated pace messages are skipped. A recording is one episode; where the pace is a table with
    a column ``episode``, each robot's episodes are told apart; and each stretch that a manifest
    selects is an episode. Only messages that can influence a row are decoded, and of them only the
    fields that the map asks for.

    Args:
        paths: rosbag2 directories, storage files, or manifests that list some.
        feature_map: what to compute.
        progress: called with the number of messages of needed topics so far, and the number in
            all recordings.
        provenance: whether to fill in the sources, for whose hashes the files are read once more.

    Raises:
        OccError: no recordings; one cannot be read, lacks a topic, field or column of the map, or
            has no message on the pace topic in the parts to use.
    """
    selections = select(paths)
    recordings = [Recording(selection.path) for selection in selections]
    if not recordings:
        raise OccError('there are no recordings to extract features from; allowed are one or more')
    wanted = [
        {topic_key(name): recording.find(topic_key(name)) for name in feature_map.topics}
        for recording in recordings
    ]
    total = sum(
        recording.topics[topic].count
        for recording, topics in zip(recordings, wanted, strict=True)
        for topic in topics.values()
    )
    done, parts, episodes, warnings = 0, [], 0, []
    for recording, topics, selection in zip(recordings, wanted, selections, strict=True):
        part = _Part()
        if BlockExtractor.reads(recording, topics, feature_map):
            blocks = BlockExtractor(recording, topics, feature_map)
        else:
            blocks = _MessageExtractor(recording, topics, feature_map)
        for block in recording.blocks(list(topics.values())):
            for rows in blocks.rows(block):
                part.add(rows, rows.times_ns - recording.start_ns, selection)
            done += len(block)
            if progress is not None:
                progress(done, total)
        if not part.values:
            raise OccError(
                f'{recording.path} has no message on {topics[topic_key(feature_map.pace)]!r}, '
                f'which sets the pace{part.where}; allowed is one or more'
            )
        episodes += part.number_episodes(episodes, str(recording.path))
        warnings += recording.warnings
        warnings += part.unused(selection, str(recording.path))
        parts.append(part)
    costs = [cost for part in parts for cost in part.costs]
    return Dataset(
        names=feature_map.names,
        values=np.concatenate([values for part in parts for values in part.values]),
        stamps_ns=np.concatenate([stamps for part in parts for stamps in part.stamps]),
        episodes=np.concatenate([part.episodes for part in parts]),
        true_cost=np.concatenate(costs) if any(part.has_cost for part in parts) else None,
        sources=tuple(
            recording.fingerprint() | selection.to_document()
            for recording, selection in zip(recordings, selections, strict=True)
            if provenance
        ),
        warnings=tuple(warnings),
    )


class _MessageExtractor:
    """Computes rows message by message, in the way of live topics; for tables."""

    def __init__(
        self, recording: Recording, topics: dict[str, str], feature_map: FeatureMap
    ) -> None:
        self._recording = recording
        self._names = list(topics.values())
        self._extractor = FeatureExtractor(feature_map)
        self._latest: dict[int, RawMessage] = {}

    def rows(self, block: Block) -> Iterator[RowBlock]:
        """Yield the rows of each pace message."""
        for row, number in enumerate(block.topics.tolist()):
            raw = self._recording.raw(block, row, self._names[number])
            if number:
                # Of the messages between two of the pace topic, only the last of a topic counts.
                self._latest[number] = raw
                continue
            for held in self._latest.values():
                self._push(held)
            self._latest.clear()
            rows = self._push(raw)
            if not rows.repeat:
                count = len(rows.values)
                yield RowBlock(
                    rows.values,
                    np.full(count, rows.stamp_ns, dtype=np.int64),
                    np.full(count, raw.log_time_ns, dtype=np.int64),
                    rows.table,
                )

    def _push(self, raw: RawMessage) -> FeatureRows | None:
        return self._extractor.push(raw.topic, self._recording.decode(raw), raw.log_time_ns)


class _Part:
    """The rows of one recording while they are collected."""

    def __init__(self) -> None:
        self.values: list[np.ndarray] = []
        self.stamps: list[np.ndarray] = []
        self.costs: list[np.ndarray] = []
        self.episodes = np.empty(0, dtype=np.int64)
        self.has_cost = False
        self.where = ''
        self._episodes: list[np.ndarray] = []
        self._included: set[int] = set()

    def add(self, rows: RowBlock, times_ns: np.ndarray, selection: Selection) -> None:
        """Add those rows that lie in a stretch to use; their times are from the first message."""
        stretches = selection.stretches(times_ns)
        for number, (low, high) in enumerate(selection.include):
            if ((low <= times_ns) & (times_ns < high)).any():
                self._included.add(number)
        count = len(rows.values)
        columns = () if rows.table is None else rows.table.names
        has_cost, has_episodes = 'true_cost' in columns, 'episode' in columns
        nothing = np.zeros(count)
        robots = np.arange(count) if has_episodes else nothing
        numbers = rows.table.column('episode').astype(np.float64) if has_episodes else nothing
        cost = rows.table.column('true_cost') if has_cost else np.full(count, np.nan)
        used = stretches >= 0
        if not used.any():
            self.where = ', in the intervals to use' if count else self.where
            return
        self.has_cost = self.has_cost or has_cost
        self.values.append(rows.values[used])
        self.stamps.append(rows.stamps_ns[used])
        self.costs.append(cost[used].astype(np.float64))
        self._episodes.append(np.stack([robots, numbers, stretches], axis=1)[used])

    def unused(self, selection: Selection, where: str) -> list[str]:
        """Return a sentence for each interval in which there is no row."""
        return [
            f'{where}: no row lies in the interval from {low / 1e9} to {high / 1e9} s, which the '
            'manifest includes'
            for number, (low, high) in enumerate(selection.include)
            if number not in self._included
        ]

    def number_episodes(self, first: int, where: str) -> int:
        """Number the episodes from ``first`` on; return how many there are.

        Raises:
            OccError: the column ``episode`` holds something that is not finite.
        """
        triples = np.concatenate(self._episodes)
        if not np.isfinite(triples).all():
            raise OccError(f"{where} has values that are not finite in the column 'episode'")
        # Sorting rows takes longer than reading them, and mostly there is little to sort by.
        varying = (triples != triples[0]).any(axis=0)
        if varying.sum() < 2:
            keys, axis = triples[:, varying.argmax()], None
        else:
            keys, axis = triples, 0
        unique, inverse = np.unique(keys, axis=axis, return_inverse=True)
        self.episodes = inverse.reshape(-1).astype(np.int64) + first
        return len(unique)
