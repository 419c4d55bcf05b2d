# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From recordings to rows of features: a dataset, or row by row as live topics would give them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from occ_constraints_pkg.datasets.blocks import BlockExtractor, RowBlock
from occ_constraints_pkg.datasets.clocks import DAY_NS
from occ_constraints_pkg.datasets.dataset import ORIGIN, Dataset
from occ_constraints_pkg.datasets.manifest import Selection, select
from occ_constraints_pkg.datasets.source_doubts import source_doubts
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.extractor import FeatureExtractor, FeatureRows
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.rosbag.recording import RawMessage, Recording
from occ_constraints_pkg.rosbag.storage import Block


def extract(
    paths: Sequence[str | Path | Selection],
    feature_map: FeatureMap,
    *,
    max_lag: float = 0.0,
    namespace: str = '',
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
        namespace: of the robot in the recordings, see :meth:`.FeatureMap.in_namespace`.
        progress: called with the number of messages of needed topics so far, and the number in
            all recordings.
        provenance: whether the sources tell hashes, for which the files are read once more, and
            not only names.

    Raises:
        OccError: no recordings; one cannot be read, lacks a topic, field or column of the map, or
            has no message on the pace topic in the parts to use.
    """
    feature_map = feature_map.in_namespace(namespace)
    selections = select(paths)
    recordings = [Recording(selection.path) for selection in selections]
    if not recordings:
        raise DataError('there are no recordings to extract features from; allowed are one or more')
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
        part, start = _CollectedRows(), recording.start_ns
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
        blocks.check_names()
        if not part.values:
            pace = topics.get(topic_key(feature_map.pace))
            raise DataError(
                f'{recording.path} has no message on '
                + (f'{pace!r}, which sets the pace' if pace else f'any of {", ".join(topics)}')
                + f'{part.where}; allowed is one or more'
            )
        warnings += part.time_by_stamps(str(recording.path))
        warnings += part.leap(str(recording.path))
        episodes += part.number_episodes(episodes, str(recording.path))
        warnings += recording.warnings
        if part.is_mostly_missing:
            warnings += source_doubts(recording, feature_map)
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
    extractor.check_names()


class _Pusher:
    """Pushes recorded messages, but decodes only those that can influence a row."""

    def __init__(self, recording: Recording, extractor: FeatureExtractor) -> None:
        self._recording, self._extractor = recording, extractor
        self._latest: dict[str, RawMessage] = {}

    def push(self, raw: RawMessage) -> FeatureRows | None:
        pace = self._extractor.pace_key
        if pace and topic_key(raw.topic) not in (pace, *self._extractor.listened_to):
            # Of the messages between two of the pace topic, only the last of a topic counts, but
            # for their lateness and for names that not every message has.
            self._latest[raw.topic] = raw
            return None
        for message in self._latest.values():
            self._decode(message)
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
        self._extractor = FeatureExtractor(feature_map, max_lag)
        self._pusher = _Pusher(recording, self._extractor)

    def check_names(self) -> None:
        """Do nothing if all names that the map asks for have come; see `FeatureExtractor`."""
        self._extractor.check_names()

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


class _CollectedRows:
    """The rows of one recording while they are collected.

    Attributes:
        values, stamps, times, origins, costs: arrays of each block of rows, as a dataset has them.
        episodes: (n,) set by :meth:`number_episodes`.
        has_cost: whether some rows came with a true cost.
        where: what to add to a sentence that no row was there.
    """

    def __init__(self) -> None:
        self.values: list[np.ndarray] = []
        self.stamps: list[np.ndarray] = []
        self.times: list[np.ndarray] = []
        self.origins: list[np.ndarray] = []
        self.costs: list[np.ndarray] = []
        self.episodes = np.empty(0, dtype=np.int64)
        self.has_cost = False
        self.where = ''
        self._first_ns = 0
        self._is_table = False
        self._episodes: list[np.ndarray] = []
        self._met: set[tuple[str, int]] = set()
        self._last_ns = 0

    def add(self, rows: RowBlock, times_ns: np.ndarray, selection: Selection) -> None:
        """Add those rows that lie in a stretch to use; their times are from the first message."""
        stretches = selection.stretches(times_ns)
        for key in ('include', 'exclude'):
            for number, (low, high) in enumerate(getattr(selection, key)):
                if ((low <= times_ns) & (times_ns < high)).any():
                    self._met.add((key, number))
        count = len(rows.values)
        self._last_ns = max(self._last_ns, int(times_ns.max())) if count else self._last_ns
        columns = () if rows.table is None else rows.table.names
        has_cost, has_episodes = 'true_cost' in columns, 'episode' in columns
        nothing = np.zeros(count)
        robots = np.arange(count) if has_episodes else nothing
        numbers = rows.table.column('episode').astype(np.float64) if has_episodes else nothing
        cost = rows.table.column('true_cost') if has_cost else np.full(count, np.nan)
        origins = np.empty(count, dtype=ORIGIN)
        origins['time_ns'] = rows.times_ns
        # Rows of a table are of one message, others of one message each.
        origins['row'] = 0 if rows.table is None else np.arange(count)
        self._is_table = rows.table is not None
        if rows.table is not None:
            # A simulation steps faster or slower than it is recorded.
            self._first_ns = self._first_ns or int(rows.stamps_ns[0])
            times_ns = rows.stamps_ns - self._first_ns
        used = stretches >= 0
        if not used.any():
            self.where = ', in the intervals to use' if count else self.where
            return
        self.has_cost = self.has_cost or has_cost
        self.values.append(rows.values[used])
        self.stamps.append(rows.stamps_ns[used])
        self.times.append(times_ns[used])
        self.origins.append(origins[used])
        self.costs.append(cost[used].astype(np.float64))
        self._episodes.append(np.stack([robots, numbers, stretches], axis=1)[used])

    def leap(self, where: str) -> list[str]:
        """Return a sentence if a stamp leaps ahead by more than a day, as a clock that is set."""
        stamps = np.concatenate(self.stamps)
        steps = np.diff(stamps)
        if self._is_table or not len(steps) or steps.max() <= DAY_NS:
            return []
        at = int(steps.argmax())
        return [
            f'{where}: the stamps leap ahead by {steps[at] / DAY_NS:.3g} days after '
            f'{(stamps[at] - stamps[0]) * 1e-9:.3g} s'
        ]

    @property
    def is_mostly_missing(self) -> bool:
        """Whether some feature is missing in most rows, for which there must be a reason."""
        missing = sum(np.isnan(values).sum(axis=0) for values in self.values)
        return bool((missing > sum(map(len, self.values)) / 2).any())

    def time_by_stamps(self, where: str) -> list[str]:
        """Take times from the header stamps where all rows were logged at once; say so."""
        logged = [int(time) for times in self.times for time in (times.min(), times.max())]
        first = min(int(stamps.min()) for stamps in self.stamps)
        last = max(int(stamps.max()) for stamps in self.stamps)
        if self._is_table or first == last or min(logged) != max(logged):
            return []
        self.times = [stamps - first for stamps in self.stamps]
        return [
            f'{where}: all messages that give rows have the same log time; times are those of '
            'their header stamps'
        ]

    def unused(self, selection: Selection, where: str) -> list[str]:
        """Return a sentence for each time of a manifest that makes no difference to the rows."""
        parts = selection.to_document()
        sentences = [
            f'{where}: no row lies in the interval {json.dumps(interval)} s, '
            f'which the manifest {key}s'
            for key in ('include', 'exclude')
            for number, interval in enumerate(parts.get(key, ()))
            if (key, number) not in self._met
        ]
        return sentences + [
            f'{where}: the last row is at {self._last_ns / 1e9:g} s, before the episode that the '
            f'manifest begins at {time / 1e9:g} s'
            for time in selection.episodes
            if time > self._last_ns
        ]

    def number_episodes(self, first: int, where: str) -> int:
        """Number the episodes from ``first`` on; return how many there are.

        Raises:
            OccError: the column ``episode`` holds something that is not finite.
        """
        triples = np.concatenate(self._episodes)
        if not np.isfinite(triples).all():
            raise DataError(f"{where} has values that are not finite in the column 'episode'")
        # Sorting rows takes longer than reading them, and mostly there is little to sort by.
        varying = (triples != triples[0]).any(axis=0)
        if varying.sum() < 2:
            keys, axis = triples[:, varying.argmax()], None
        else:
            keys, axis = triples, 0
        unique, inverse = np.unique(keys, axis=axis, return_inverse=True)
        self.episodes = inverse.reshape(-1).astype(np.int64) + first
        return len(unique)
