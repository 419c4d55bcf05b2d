# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Inspection of a recording: the rate of each topic, its clock, the numbers in its messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occ_constraints_pkg.datasets.topic_columns import TopicColumns
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.fields import field_names
from occ_constraints_pkg.features.paths import number_in
from occ_constraints_pkg.rosbag.definition_bounds import WIDE_TEXT
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block
from occ_constraints_pkg.suggestion.scans import ScanShape
from occ_constraints_pkg.wording import count_of

# Packages whose messages are about the ROS graph or for viewers, not about the robot's state.
_NOT_SENSORS = frozenset(
    (
        *('action_msgs', 'bond', 'lifecycle_msgs', 'map_msgs', 'rcl_interfaces'),
        *('rosbag2_interfaces', 'rosgraph_msgs', 'statistics_msgs', 'tf2_msgs'),
        *('visualization_msgs', 'rmw_dds_common', 'foxglove_msgs', 'stereo_msgs'),
    )
)
# Its texts hold numbers.
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_BRACKETS = {'[', ']'}
# Larger messages of unknown types are images, maps and the like; decoding them takes long.
_SMALL_BYTES = 1 << 14
_KNOWN_LARGE = ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2')
# So many messages of a topic are decoded, evenly spread over the recording.
_DECODED = 2000
# Longer arrays are images, maps or clouds; their elements are not looked at one by one.
MOST_ELEMENTS = 40
# Fewer messages are too few to suggest features from.
LEAST_MESSAGES = 10
# Stamps that jump ahead by more are of a clock that was set.
_LONG_JUMP_S = 86_400.0


@dataclass
class Series:
    """The values of one number in those messages of a topic that were decoded.

    Attributes:
        parts: (n,) float64 of each recording.
        is_integer: whether it is a whole number by type.
        is_flag: whether it is true or false by type.
        share: share of the messages that have it.
    """

    parts: list[np.ndarray]
    is_integer: bool = False
    is_flag: bool = False
    share: float = 1.0

    @property
    def values(self) -> np.ndarray:
        """All of them."""
        return self.parts[0] if len(self.parts) == 1 else np.concatenate(self.parts)

    @property
    def finite(self) -> np.ndarray:
        """Those of them that are finite."""
        values = self.values
        return values[np.isfinite(values)]

    @property
    def low(self) -> float:
        """The smallest finite one; NaN without one."""
        return float(self.finite.min()) if self.finite.size else math.nan

    @property
    def high(self) -> float:
        """The largest finite one; NaN without one."""
        return float(self.finite.max()) if self.finite.size else math.nan

    @property
    def is_constant(self) -> bool:
        """Whether no two of them differ."""
        return not self.low < self.high

    @property
    def only_rises(self) -> bool:
        """Whether it only rises in each recording, or only falls, and in many steps."""
        steps = [np.diff(part) for part in self.parts if len(part) > 1]
        if not steps or not all(np.count_nonzero(part) > max(len(part) // 10, 5) for part in steps):
            return False
        return any(all((sign * part >= 0).all() for part in steps) for sign in (1, -1))


@dataclass
class TopicInspection:
    """What a recording has of a topic, or several recordings have.

    Attributes:
        name: as recorded, with leading slash.
        msgtype: message type.
        count: messages recorded.
        serialization: how the messages are encoded.
        decoded: whether its messages were decoded; the rest stays empty otherwise.
        problem: why they could not be decoded; empty if they could or nobody tried.
        bytes: size of the largest message that was looked at.
        period_s: median time between messages, by header stamps or arrival; NaN for one message.
        slow_period_s: the 99th percentile of these times.
        is_stamped: whether the messages carry a header stamp.
        offset_s: by how much stamps are ahead of log times, as a rule; NaN without stamps.
        jumps: how often a stamp lies before that of the message before.
        first_jump_s: seconds from the topic's first message to the first such jump.
        leap_s: the longest step ahead of stamps, if it is too long to be a gap; else 0.
        burst_share: share of the messages that were logged at the same time as the one before.
        frames: ``frame_id`` of the headers.
        series: values of the numbers by the path of their field.
        lengths: by the path of a sequence, in how many of the messages it had how many elements.
        definition: text of the definition as stored.
        definitions: parsed definitions of the type and its parts, by type name.
        sample: the first message.
        scan: for a LaserScan.
        missing_in: names of recordings without it.
    """

    name: str
    msgtype: str
    count: int
    serialization: str = 'cdr'
    decoded: bool = False
    problem: str = ''
    bytes: int = 0
    period_s: float = math.nan
    slow_period_s: float = math.nan
    is_stamped: bool = False
    offset_s: float = math.nan
    jumps: int = 0
    first_jump_s: float = math.nan
    leap_s: float = 0.0
    burst_share: float = 0.0
    frames: set[str] = field(default_factory=set)
    series: dict[str, Series] = field(default_factory=dict)
    lengths: dict[str, set[int]] = field(default_factory=dict)
    definition: str = ''
    definitions: Mapping[str, Any] = field(default_factory=dict)
    sample: Any = None
    scan: ScanShape | None = None
    missing_in: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """The name without leading slash, as feature maps write it."""
        return self.name.lstrip('/')

    @property
    def package(self) -> str:
        """The package that defines the type."""
        return self.msgtype.partition('/')[0]

    @property
    def stem(self) -> str:
        """The last part of the name, as an identifier."""
        return identifier(self.key.rpartition('/')[2])

    @property
    def rate(self) -> float:
        """Messages per second; NaN for one message."""
        return 1.0 / self.period_s if self.period_s > 0.0 else math.nan

    @property
    def silence(self) -> str:
        """Why no feature can be read from the topic; empty if one could be."""
        if not self.count:
            return 'it has no message'
        if self.serialization != 'cdr':
            return f'its messages are encoded as {self.serialization!r}; allowed is cdr'
        if self.package in _NOT_SENSORS:
            return f'{self.package} is about the ROS graph or for viewers, not about the robot'
        if self.problem:
            return self.problem
        if not self.decoded:
            return f'its messages have up to {self.bytes} bytes, as those of images and maps have'
        if self.missing_in:
            return f'it is not in {", ".join(self.missing_in)}'
        if self.count < LEAST_MESSAGES:
            return f'it has {count_of(self.count, "message")}, fewer than {LEAST_MESSAGES}'
        return ''


def identifier(text: str) -> str:
    """Return text with all that a feature's name may not have as underscores."""
    name = ''.join(mark if mark.isascii() and mark.isalnum() else '_' for mark in text).strip('_')
    while '__' in name:
        name = name.replace('__', '_')
    return name if name[:1].isalpha() else f'n{name}'


def inspect_topics(
    recording: Recording, *, progress: Callable[[int, int], None] | None = None
) -> dict[str, TopicInspection]:
    """Inspect the topics of a recording, reading it once.

    Stamps and log times are those of all messages; of a topic with many messages, the numbers are
    those of some, evenly spread.

    Args:
        recording: what to read.
        progress: called with (messages read, messages in all).

    Returns:
        All topics by name, sorted.

    Raises:
        OccError: the recording is damaged.
    """
    topics = {
        name: TopicInspection(name, info.msgtype, info.count, info.serialization)
        for name, info in recording.topics.items()
    }
    wanted = [
        name
        for name, topic in topics.items()
        if topic.count and topic.serialization == 'cdr' and topic.package not in _NOT_SENSORS
    ]
    looks = [_Look(recording, topics[name]) for name in wanted]
    total, done = sum(topics[name].count for name in wanted), 0
    for block in recording.blocks(wanted):
        for place, look in enumerate(looks):
            look.add(block, np.flatnonzero(block.topics == place))
        done += len(block)
        if progress is not None:
            progress(done, total)
    for look in looks:
        look.finish()
    return topics


def merged(
    inspections: Sequence[dict[str, TopicInspection]], names: Sequence[str]
) -> dict[str, TopicInspection]:
    """Return what several recordings have of each topic, as one inspection.

    Args:
        inspections: of each recording, what :func:`inspect_topics` returns.
        names: of the recordings.
    """
    if len(inspections) == 1:
        return dict(inspections[0])
    topics: dict[str, TopicInspection] = {}
    for name in sorted(set().union(*inspections)):
        found = [topics_of[name] for topics_of in inspections if name in topics_of]
        topics[name] = _joined(found)
        topics[name].missing_in = tuple(
            recording
            for recording, topics_of in zip(names, inspections, strict=True)
            if name not in topics_of
        )
    return topics


def _joined(found: Sequence[TopicInspection]) -> TopicInspection:
    first = next((topic for topic in found if topic.decoded), found[0])
    other = [topic for topic in found if topic is not first]
    if len({topic.msgtype for topic in found}) > 1:
        first.decoded = False
        first.problem = 'its type differs between the recordings: ' + ', '.join(
            sorted({topic.msgtype for topic in found})
        )
        return first
    for topic in other:
        first.count += topic.count
        first.problem = first.problem or topic.problem
        first.jumps += topic.jumps
        first.leap_s = max(first.leap_s, topic.leap_s)
        first.burst_share = max(first.burst_share, topic.burst_share)
        first.slow_period_s = float(np.nanmax([first.slow_period_s, topic.slow_period_s]))
        first.frames |= topic.frames
        for path, series in topic.series.items():
            if path in first.series:
                first.series[path].parts += series.parts
                first.series[path].share = min(first.series[path].share, series.share)
        for path, lengths in topic.lengths.items():
            first.lengths.setdefault(path, set()).update(lengths)
        if first.scan is not None and topic.scan is not None:
            first.scan.join(topic.scan)
    return first


class _Look:
    """Looks at one topic's messages, block by block."""

    def __init__(self, recording: Recording, topic: TopicInspection) -> None:
        self._recording, self._topic = recording, topic
        self._seen = self._decoded = 0
        # Not every third, say: several publishers may take turns on a topic.
        self._is_chosen = np.ones(topic.count, dtype=bool)
        if topic.count > _DECODED:
            self._is_chosen = np.random.default_rng(0).random(topic.count) < _DECODED / topic.count
        self._is_chosen[0] = True
        self._arrivals: list[np.ndarray] = []
        self._stamps: list[np.ndarray] = []
        self._numbers: dict[str, list[float]] = {}
        self._columns: TopicColumns | None = None
        try:
            topic.definition = recording.topics[topic.name].definition
            topic.definitions = recording.fields(topic.name)
            self._columns = TopicColumns(recording, topic.name, ())
        except OccError as error:
            topic.problem = str(error)

    def add(self, block: Block, rows: np.ndarray) -> None:
        """Look at the messages with these numbers."""
        topic = self._topic
        if topic.problem or self._columns is None or not len(rows):
            return
        sizes = (block.ends - block.starts)[rows]
        topic.bytes = max(topic.bytes, int(sizes.max()))
        try:
            stamps = self._columns.read(block, rows)[1]
            is_known = topic.msgtype in _KNOWN_LARGE
            chosen = self._is_chosen[self._seen : self._seen + len(rows)]
            for place in np.flatnonzero(chosen).tolist():
                if is_known or sizes[place] <= _SMALL_BYTES:
                    raw = self._recording.raw(block, int(rows[place]), topic.name)
                    self._take(self._recording.decode(raw))
        except OccError as error:
            topic.problem, topic.decoded = str(error), False
            return
        self._stamps.append(stamps)
        self._arrivals.append(block.times[rows])
        self._seen += len(rows)

    def _take(self, message: Any) -> None:
        topic = self._topic
        if not topic.decoded:
            topic.decoded, topic.sample = True, message
        self._decoded += 1
        numbers = _numbers(message, topic.lengths)
        if topic.msgtype == DIAGNOSTICS:
            numbers = _diagnostic_numbers(message)
        for path, value in numbers:
            values = self._numbers.get(path)
            if values is None:
                values = self._numbers[path] = []
                is_flag = isinstance(value, bool | np.bool_)
                topic.series[path] = Series(
                    [], not is_flag and not isinstance(value, float | np.floating), is_flag
                )
            values.append(float(value))
        header = getattr(message, 'header', None)
        if header is not None:
            topic.frames.add(getattr(header, 'frame_id', ''))
        if topic.msgtype == 'sensor_msgs/msg/LaserScan' and len(message.ranges):
            topic.scan = topic.scan or ScanShape(len(message.ranges))
            topic.scan.add(message)

    def finish(self) -> None:
        """Put what was found together."""
        topic = self._topic
        if not self._arrivals:
            return
        arrivals, stamps = np.concatenate(self._arrivals), np.concatenate(self._stamps)
        for path, values in self._numbers.items():
            topic.series[path].parts = [np.array(values)]
            topic.series[path].share = len(values) / self._decoded
        is_set = stamps != 0
        topic.is_stamped = bool(is_set.any())
        if topic.is_stamped:
            topic.offset_s = float(np.median((stamps - arrivals)[is_set])) * 1e-9
        if len(arrivals) > 1:
            topic.burst_share = float((np.diff(arrivals) == 0).mean())
        self._measure_periods(stamps[is_set] if topic.is_stamped else arrivals)

    def _measure_periods(self, times_ns: np.ndarray) -> None:
        topic, steps = self._topic, np.diff(times_ns) * 1e-9
        back = np.flatnonzero(steps < 0)
        topic.jumps = len(back)
        if len(back):
            topic.first_jump_s = float(times_ns[back[0]] - times_ns[0]) * 1e-9
        forward = steps[steps > 0]
        if len(forward):
            topic.period_s = float(np.median(forward))
            topic.slow_period_s = float(np.percentile(forward, 99))
            topic.leap_s = float(forward.max()) if forward.max() > _LONG_JUMP_S else 0.0


def _numbers(
    message: Any,
    lengths: dict[str, set[int]],
    path: str = '',
    outer: tuple[str, list[str]] = ('', []),
) -> Iterator[tuple[str, Any]]:
    """Yield the numbers below a message with their paths; not those of headers and long arrays.

    Elements of an array beside a list of names, or below one, have their name in the path.
    """
    names = field_names(message)
    for name in names:
        if _is_texts(getattr(message, name)):
            outer = name, getattr(message, name)
            break
    for name in names:
        value, place = getattr(message, name), f'{path}{name}'
        if isinstance(value, bool | int | float | np.generic):
            yield place, value
        elif isinstance(value, np.ndarray | list) and not _is_texts(value):
            length = len(value)
            lengths.setdefault(place, set()).add(length)
            if not 0 < length <= MOST_ELEMENTS:
                continue
            labels: Sequence[Any] = range(length)
            if len(outer[1]) == length:
                labels = [f'{outer[0]}={label}' for label in outer[1]]
            for label, item in zip(labels, value, strict=True):
                if isinstance(item, bool | int | float | np.generic):
                    yield f'{place}[{label}]', item
                elif not isinstance(item, str | bytes):
                    yield from _numbers(item, lengths, f'{place}[{label}].')
        elif getattr(value, '__msgtype__', '') == WIDE_TEXT:
            continue
        elif name not in ('header', 'stamp') and field_names(value) not in ([], ['sec', 'nanosec']):
            yield from _numbers(value, lengths, f'{place}.', outer)


def _diagnostic_numbers(message: Any) -> Iterator[tuple[str, float]]:
    """Yield the numbers that the texts of a DiagnosticArray hold, with their paths."""
    for status in message.status[:MOST_ELEMENTS]:
        for item in status.values[:MOST_ELEMENTS]:
            number = number_in(item.value)
            if number is not None and not _BRACKETS & {*status.name, *item.key} and item.key:
                yield f'status[name={status.name}].values[key={item.key}].value', number


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], str)
