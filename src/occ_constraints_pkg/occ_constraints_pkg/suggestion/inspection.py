# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Inspection of a recording: the rate of each topic, its clock, the numbers in its messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.fields import field_names, header_stamp_ns
from occ_constraints_pkg.rosbag.recording import Recording

# Packages whose messages are about the ROS graph or for viewers, not about the robot's state.
_NOT_SENSORS = frozenset(
    (
        *('action_msgs', 'bond', 'diagnostic_msgs', 'lifecycle_msgs', 'map_msgs', 'rcl_interfaces'),
        *('rosbag2_interfaces', 'rosgraph_msgs', 'statistics_msgs', 'tf2_msgs'),
        *('visualization_msgs', 'rmw_dds_common', 'foxglove_msgs', 'stereo_msgs'),
    )
)
# Larger messages of unknown types are images, maps and the like; decoding them takes long.
_SMALL_BYTES = 1024
_KNOWN_LARGE = ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2')


@dataclass
class ScanShape:
    """What all scans of a topic have in common, or at worst.

    Attributes:
        least_beams: fewest beams.
        first: smallest angle of any beam, in degrees.
        last: largest angle of any beam.
        step: largest angle between neighbouring beams.
        range_max: largest greatest range, in m.
        counts: of all ranges, how many are zero, infinite, NaN, positive but below the scan's
            smallest range, and any of these or not.
        openness: for each scan the clearance of its most open eighth, in m, with what was not
            measured at the greatest range.
    """

    least_beams: int
    first: float
    last: float
    step: float
    range_max: float
    counts: np.ndarray
    openness: list[float] = field(default_factory=list)


@dataclass
class TopicInspection:
    """What a recording has of a topic.

    Attributes:
        name: as recorded, with leading slash.
        msgtype: message type.
        count: messages recorded.
        decoded: whether its messages were decoded; the rest stays empty otherwise.
        problem: why they could not be decoded; empty if they could or nobody tried.
        period_s: median time between messages, by header stamps or arrival; NaN for one message.
        slow_period_s: the 99th percentile of these times.
        is_stamped: whether the messages carry a header stamp.
        jumps: how often a stamp lies before that of the message before.
        first_jump_s: seconds from the topic's first message to the first such jump.
        frames: ``frame_id`` of the headers.
        numbers: paths of the scalar fields with the values of the first message.
        integers: those of them that are whole numbers or flags by type.
        sample: the first message.
        scan: for a LaserScan.
    """

    name: str
    msgtype: str
    count: int
    decoded: bool = False
    problem: str = ''
    period_s: float = math.nan
    slow_period_s: float = math.nan
    is_stamped: bool = False
    jumps: int = 0
    first_jump_s: float = math.nan
    frames: set[str] = field(default_factory=set)
    numbers: dict[str, float] = field(default_factory=dict)
    integers: set[str] = field(default_factory=set)
    sample: Any = None
    scan: ScanShape | None = None

    @property
    def key(self) -> str:
        """The name without leading slash, as feature maps write it."""
        return self.name.lstrip('/')

    @property
    def rate(self) -> float:
        """Messages per second; NaN for one message."""
        return 1.0 / self.period_s if self.period_s > 0.0 else math.nan


def inspect_topics(
    recording: Recording, *, progress: Callable[[int, int], None] | None = None
) -> dict[str, TopicInspection]:
    """Inspect the topics of a recording, reading it once.

    Args:
        recording: what to read.
        progress: called with (messages read, messages in all).

    Returns:
        All topics by name, sorted.

    Raises:
        OccError: the recording is damaged.
    """
    topics = {
        name: TopicInspection(name, info.msgtype, info.count)
        for name, info in recording.topics.items()
    }
    wanted = [
        name
        for name, topic in topics.items()
        if topic.count
        and topic.msgtype.partition('/')[0] not in _NOT_SENSORS
        and recording.topics[name].serialization == 'cdr'
    ]
    arrivals: dict[str, list[int]] = {name: [] for name in wanted}
    stamps: dict[str, list[int]] = {name: [] for name in wanted}
    total = sum(topics[name].count for name in wanted)
    for number, raw in enumerate(recording.messages(wanted)):
        topic = topics[raw.topic]
        is_small = len(raw.data) <= _SMALL_BYTES or topic.msgtype in _KNOWN_LARGE
        if not topic.problem and is_small:
            try:
                message = recording.decode(raw)
            except OccError as error:
                topic.problem = str(error)
            else:
                _inspect_message(topic, message)
                stamp = header_stamp_ns(message)
                if stamp is not None:
                    stamps[raw.topic].append(stamp)
                arrivals[raw.topic].append(raw.log_time_ns)
        if progress is not None:
            progress(number + 1, total)
    for name in wanted:
        topics[name].is_stamped = bool(stamps[name])
        _measure_periods(topics[name], np.array(stamps[name] or arrivals[name], dtype=np.int64))
    return topics


def _measure_periods(topic: TopicInspection, times_ns: np.ndarray) -> None:
    steps = np.diff(times_ns) * 1e-9
    back = np.flatnonzero(steps < 0)
    topic.jumps = len(back)
    if len(back):
        topic.first_jump_s = float(times_ns[back[0]] - times_ns[0]) * 1e-9
    forward = steps[steps > 0]
    if len(forward):
        topic.period_s = float(np.median(forward))
        topic.slow_period_s = float(np.percentile(forward, 99))


def _inspect_message(topic: TopicInspection, message: Any) -> None:
    if not topic.decoded:
        topic.decoded, topic.sample = True, message
        for path, value in _scalars(message):
            topic.numbers[path] = float(value)
            if not isinstance(value, float):
                topic.integers.add(path)
    header = getattr(message, 'header', None)
    if header is not None:
        topic.frames.add(header.frame_id)
    if topic.msgtype == 'sensor_msgs/msg/LaserScan' and len(message.ranges):
        _inspect_scan(topic, message)


def _inspect_scan(topic: TopicInspection, message: Any) -> None:
    ranges = np.asarray(message.ranges, dtype=np.float64)
    count = len(ranges)
    ends = np.degrees(
        [message.angle_min, message.angle_min + (count - 1) * message.angle_increment]
    )
    shape = topic.scan
    if shape is None:
        shape = topic.scan = ScanShape(count, math.inf, -math.inf, 0.0, 0.0, np.zeros(5))
    shape.least_beams = min(shape.least_beams, count)
    shape.first, shape.last = min(shape.first, *ends), max(shape.last, *ends)
    shape.step = max(shape.step, abs(math.degrees(message.angle_increment)))
    shape.range_max = max(shape.range_max, float(message.range_max))
    seen = [ranges == 0.0, np.isinf(ranges), np.isnan(ranges)]
    seen += [(ranges > 0.0) & (ranges < message.range_min), np.ones(count, dtype=bool)]
    shape.counts += [np.count_nonzero(part) for part in seen]
    clear = np.where(seen[0] | seen[1] | seen[2], float(message.range_max), ranges)
    parts = np.array_split(clear, min(8, count))
    shape.openness.append(max(float(part.min()) for part in parts))


def _scalars(message: Any, path: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the scalar fields below a message with their paths; not those of headers."""
    for name in field_names(message):
        value, place = getattr(message, name), f'{path}{name}'
        if isinstance(value, bool | int | float | np.generic):
            yield place, value
        elif name not in ('header', 'stamp') and field_names(value):
            yield from _scalars(value, f'{place}.')
