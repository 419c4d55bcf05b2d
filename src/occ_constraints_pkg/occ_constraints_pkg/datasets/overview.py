# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a recording holds at a glance: topics, rates, gaps, clocks, and what can be learned from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from occ_constraints_pkg.datasets.clocks import ClockReadings, clock_warnings
from occ_constraints_pkg.datasets.topic_columns import TopicColumns
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block

# Deeper parts hold nothing that anybody would take for a feature.
_MOST_LEVELS = 8


@dataclass(frozen=True)
class TopicOverview:
    """One topic of a recording.

    Attributes:
        name: as recorded.
        msgtype: message type.
        count: number of messages.
        rate: messages per second, from its first to its last; NaN where that is no time.
        gap_s: longest time between two messages, by log time; NaN with fewer than two.
        gap_at_s: when that began, from the first message of the recording on.
        has_definition: whether the recording holds the definition of its type.
        problem: why its messages cannot be read; empty if they can.
        numbers: how many fields are single numbers.
        arrays: how many are arrays of numbers or of messages.
        clock: what its header stamps say; None where it has none.
    """

    name: str
    msgtype: str
    count: int
    rate: float
    gap_s: float
    gap_at_s: float
    has_definition: bool
    problem: str
    numbers: int
    arrays: int
    clock: ClockReadings | None

    @property
    def is_learnable(self) -> bool:
        """Whether features can be read of it."""
        return bool(not self.problem and self.count and self.numbers + self.arrays)


@dataclass(frozen=True)
class RecordingOverview:
    """A recording at a glance.

    Attributes:
        path: of the recording.
        files: names of its storage files.
        size: of these in bytes.
        start_ns: log time of the first message.
        duration_s: from there to the last one.
        topics: sorted by name.
        warnings: one sentence for each thing that is missing, damaged or odd.
    """

    path: str
    files: tuple[str, ...]
    size: int
    start_ns: int
    duration_s: float
    topics: tuple[TopicOverview, ...]
    warnings: tuple[str, ...]


def overview_of(
    recording: Recording, progress: Callable[[int, int], None] | None = None
) -> RecordingOverview:
    """Look through a recording.

    Args:
        recording: what to look through.
        progress: called with (messages read, messages in all).

    Raises:
        OccError: the recording is damaged.
    """
    topics = [_Topic(recording, name) for name in recording.topics]
    read = [topic for topic in topics if not recording.topics[topic.name].conflict]
    total, done = sum(recording.topics[topic.name].count for topic in read), 0
    for block in recording.blocks([topic.name for topic in read]):
        for number, topic in enumerate(read):
            topic.add(block, np.flatnonzero(block.topics == number))
        done += len(block)
        if progress is not None:
            progress(done, total)
    start = recording.start_ns
    found = tuple(topic.overview(start) for topic in topics)
    ends = [int(topic.times.max()) for topic in topics if len(topic.times)]
    clocks = {topic.name: topic.clock for topic in found if topic.clock is not None}
    return RecordingOverview(
        path=str(recording.path),
        files=tuple(file.name for file in recording.files),
        size=sum(file.stat().st_size for file in recording.files),
        start_ns=start,
        duration_s=(max(ends, default=start) - start) * 1e-9,
        topics=found,
        warnings=(*recording.warnings, *_without_time(total, ends, start), *clock_warnings(clocks)),
    )


def _without_time(count: int, ends: list[int], start_ns: int) -> list[str]:
    if count > 1 and max(ends, default=start_ns) == start_ns:
        return [f'all messages have the log time {start_ns} ns: only header stamps tell the time']
    return []


class _Topic:
    """What was read of one topic.

    Attributes:
        name: of the topic.
        times: (n,) log times of its messages so far, in ns.
    """

    def __init__(self, recording: Recording, name: str) -> None:
        self.name = name
        self._info = recording.topics[name]
        self._problem = recording.problem(name)
        self._numbers = self._arrays = 0
        self._columns: TopicColumns | None = None
        self._times: list[np.ndarray] = []
        self._stamps: list[np.ndarray] = []
        if not self._problem:
            definitions = recording.fields(name)
            self._numbers, self._arrays = _count_fields(definitions, self._info.msgtype)
            columns = TopicColumns(recording, name, ())
            self._columns = columns if columns.has_stamps else None

    @property
    def times(self) -> np.ndarray:
        return np.concatenate(self._times) if self._times else np.empty(0, dtype=np.int64)

    def add(self, block: Block, rows: np.ndarray) -> None:
        """Take this topic's messages of a block."""
        if not len(rows):
            return
        self._times.append(block.times[rows])
        if self._columns is None:
            return
        try:
            self._stamps.append(self._columns.read(block, rows)[1])
        except OccError as error:
            self._problem, self._columns = str(error), None
            self._stamps.clear()

    def overview(self, start_ns: int) -> TopicOverview:
        times = self.times
        steps = np.diff(times)
        widest = int(steps.argmax()) if len(steps) else 0
        span = int(times[-1] - times[0]) if len(steps) else 0
        clock = None
        if self._stamps:
            clock = ClockReadings.of(np.concatenate(self._stamps), times)
        return TopicOverview(
            name=self.name,
            msgtype=self._info.msgtype,
            count=self._info.count,
            rate=1e9 * len(steps) / span if span else math.nan,
            gap_s=float(steps[widest]) * 1e-9 if len(steps) else math.nan,
            gap_at_s=float(times[widest] - start_ns) * 1e-9 if len(steps) else math.nan,
            has_definition=bool(self._info.definition.strip()),
            problem=self._problem,
            numbers=self._numbers,
            arrays=self._arrays,
            clock=clock,
        )


def _count_fields(definitions: Mapping[str, Any], msgtype: str, level: int = 0) -> tuple[int, int]:
    """Return how many numbers and arrays the messages of a type have, but for their stamps."""
    numbers = arrays = 0
    if level > _MOST_LEVELS or msgtype not in definitions:
        return 0, 0
    for _, (kind, argument) in definitions[msgtype][1]:
        if kind == Nodetype.NAME:
            if argument in ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time'):
                continue
            part = _count_fields(definitions, argument, level + 1)
            numbers, arrays = numbers + part[0], arrays + part[1]
        elif kind == Nodetype.BASE:
            numbers += argument[0] != 'string'
        else:
            element = argument[0]
            arrays += element[0] == Nodetype.NAME or element[1][0] != 'string'
    return numbers, arrays
