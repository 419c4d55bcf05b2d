# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From messages to rows of features, in one way for live topics and for recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.datasets.collected import CollectedRows
from occ_constraints_pkg.datasets.blocks import BlockExtractor, RowBlock
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.fields import header_stamp_ns
from occ_constraints_pkg.features.latest import Held, TopicReader
from occ_constraints_pkg.features.lateness import late_words, lateness_of
from occ_constraints_pkg.datasets.manifest import select
from occ_constraints_pkg.rosbag.recording import RawMessage, Recording
from occ_constraints_pkg.rosbag.storage import Block
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.transforms import RowTransforms
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
        note: why all values are missing, if it is not for the messages; else empty.
    """

    stamp_ns: int
    values: np.ndarray
    table: Table | None
    repeat: bool
    note: str = ''


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
        for place, (_, reading) in enumerate(self._readings):
            groups[topic_key(reading.topic)].append(place)
        self.pace_key = topic_key(feature_map.pace)
        rate = feature_map.rate
        self._clock = None if rate is None else _Clock(rate, self._max_age_ns)
        self._readers = {
            key: TopicReader(places, [self._readings[place] for place in places])
            for key, places in groups.items()
        }
        self._transforms = RowTransforms(feature_map)
        self._held: dict[str, Held] = {}
        self._now: Held | None = None
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
        held = Held(message, header_stamp_ns(message), receive_time_ns)
        if key in self._lateness:
            lag = self._lateness[key].lag_ns(held.stamp, *(sent or (receive_time_ns,)))
            if lag > self._max_lag_ns:
                self._late[key] = lag
            else:
                self._late.pop(key, None)
        if key == self.pace_key:
            others = self._fresh(held, {key}) if self._held else {}
            return self._row(held, {key: held, **others})
        self._held[key] = held
        if self._clock is None or not self._clock.is_due(held.stamp, receive_time_ns):
            return None
        return self._row(held, self._fresh(held, set()))

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
            held = self._held.get(topic_key(topic))
            if topic_key(topic) != self.pace_key:
                ages[topic] = held.age_ns(now.stamp, now.arrival) if now and held else None
        return ages

    def _fresh(self, now: Held, besides: set[str]) -> dict[str, Held]:
        """Return what is held of each topic and not too old at the message ``now``."""
        return {
            key: held
            for key, held in self._held.items()
            if key not in besides and held.age_ns(now.stamp, now.arrival) <= self._max_age_ns
        }

    def _row(self, now: Held, parts: dict[str, Held]) -> FeatureRows:
        """Compute the features from the messages in ``parts``."""
        back_ns = 0 if self._now is None else self._now.ahead_ns(now.stamp, now.arrival)
        self._now = now
        for key, held in parts.items():
            held.read(self._readers[key])
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
            # Whatever is held is of another time. Stamps of tables only tell steps apart.
            values, note = np.full_like(values, np.nan), f'time went back by {back_ns * 1e-9:.3g} s'
        elif self._late:
            topic, lag = next(iter(self._late.items()))
            note = late_words(topic, lag, self._max_lag_ns)
            values = np.full_like(values, np.nan)
        repeat = now.stamp is not None and now.stamp == last_stamp
        repeat = repeat and np.array_equal(values, last_values, equal_nan=True)
        self._last = now.stamp, values
        return FeatureRows(row_ns, values, table, repeat, note)

    def _gathered(self, now: Held, parts: dict[str, Held]) -> tuple[np.ndarray, list[int | None]]:
        """Return (rows, readings) of several topics, and each reading's stamp."""
        count = max((len(held.values) for held in parts.values()), default=1)
        if self.pace_key:
            count = len(now.values)
        read = np.full((count, len(self._readings)), np.nan)
        stamps: list[int | None] = [None] * len(self._readings)
        for key, held in parts.items():
            if len(held.values) not in (1, count):
                raise OccError(
                    f'topic {key!r} holds {len(held.values)} rows and '
                    + (f'the pace topic {self.pace_key!r}' if self.pace_key else 'another')
                    + f' {count}; allowed are 1 or as many'
                )
            places = self._readers[key].places
            read[:, places] = held.values
            for place in places:
                stamps[place] = held.stamp
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
        due = due or now // self._period_ns > last // self._period_ns
        if due:
            self._last_ns = now
        return due


def extract(
    paths: Sequence[str | Path],
    feature_map: FeatureMap,
    *,
    max_lag: float = 0.0,
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
        max_lag: seconds that a message may come late, by its log time; 0 for any. See
            :class:`FeatureExtractor`.
        progress: called with the number of messages of needed topics so far, and the number in
            all recordings.
        provenance: whether the sources tell hashes, for which the files are read once more, and
            not only names.

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
        part, start = CollectedRows(), recording.start_ns
        if BlockExtractor.reads(recording, topics, feature_map):
            blocks = BlockExtractor(recording, topics, feature_map, max_lag)
        else:
            blocks = _MessageExtractor(recording, topics, feature_map, max_lag)
        for block in recording.blocks(list(topics.values())):
            for rows in blocks.rows(block):
                part.add(rows, rows.times_ns - start, selection)
            done += len(block)
            if progress is not None:
                progress(done, total)
        if not part.values:
            pace = topics.get(topic_key(feature_map.pace))
            raise OccError(
                f'{recording.path} has no message on '
                + (f'{pace!r}, which sets the pace' if pace else f'any of {", ".join(topics)}')
                + f'{part.where}; allowed is one or more'
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
        times_ns=np.concatenate([times for part in parts for times in part.times]),
        recordings=np.repeat(np.arange(len(parts)), [len(part.episodes) for part in parts]),
        sources=tuple(
            (recording.fingerprint() if provenance else {'name': recording.name})
            | selection.to_document()
            for recording, selection in zip(recordings, selections, strict=True)
        ),
        warnings=tuple(warnings),
        origins=np.concatenate([origins for part in parts for origins in part.origins]),
    )


def rows_of(
    recording: Recording,
    extractor: FeatureExtractor,
    tick: Callable[[], None] | None = None,
) -> Iterator[FeatureRows]:
    """Push a recording's messages into a fresh extractor; yield all rows, repeats too.

    Args:
        recording: what to read.
        extractor: it says what to compute.
        tick: called after each message of a needed topic.

    Raises:
        OccError: the recording cannot be read, or lacks a topic, field or column of the map.
    """
    pusher = _Pusher(recording, extractor)
    topics = [recording.find(topic_key(name)) for name in extractor.feature_map.topics]
    for raw in recording.messages(topics):
        if tick is not None:
            tick()
        if (rows := pusher.push(raw)) is not None:
            yield rows


class _Pusher:
    """Pushes recorded messages, but decodes only those that can influence a row."""

    def __init__(self, recording: Recording, extractor: FeatureExtractor) -> None:
        self._recording, self._extractor = recording, extractor
        self._latest: dict[str, RawMessage] = {}

    def push(self, raw: RawMessage) -> FeatureRows | None:
        pace = self._extractor.pace_key
        if pace and topic_key(raw.topic) not in (pace, *self._extractor.timed):
            # Of the messages between two of the pace topic, only the last of a topic counts, but
            # for their lateness.
            self._latest[raw.topic] = raw
            return None
        for held in self._latest.values():
            self._decode(held)
        self._latest.clear()
        return self._decode(raw)

    def _decode(self, raw: RawMessage) -> FeatureRows | None:
        return self._extractor.push(raw.topic, self._recording.decode(raw), raw.log_time_ns)


class _MessageExtractor:
    """Computes rows message by message, in the way of live topics; for tables and fixed rates."""

    def __init__(
        self,
        recording: Recording,
        topics: dict[str, str],
        feature_map: FeatureMap,
        max_lag: float,
    ) -> None:
        self._recording = recording
        self._names = list(topics.values())
        self._pusher = _Pusher(recording, FeatureExtractor(feature_map, max_lag))

    def rows(self, block: Block) -> Iterator[RowBlock]:
        """Yield the rows that each message gives."""
        for row, number in enumerate(block.topics.tolist()):
            raw = self._recording.raw(block, row, self._names[number])
            rows = self._pusher.push(raw)
            if rows is not None and not rows.repeat:
                count = len(rows.values)
                yield RowBlock(
                    rows.values,
                    np.full(count, rows.stamp_ns, dtype=np.int64),
                    np.full(count, raw.log_time_ns, dtype=np.int64),
                    rows.table,
                )
