# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Heuristics: which features each message type suggests."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.suggestion.inspection import TopicInspection
from occ_constraints_pkg.suggestion.statistics import FeatureStatistics

_SECTORS = 8
# A scan that covers at least this many degrees is taken to look all around.
_ALL_AROUND = 350.0
# Fewer messages are too few to suggest features from.
_LEAST_MESSAGES = 10
_NICE = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
# Columns of our own tables that are not sensor values.
_STEP_COLUMNS = {'reward', 'terminated', 'truncated', 'episode', 'true_cost'}
_MOST_NUMBERS = 8
_COMMON = re.compile(r'(std|sensor|geometry|nav|trajectory|shape|stereo)_msgs/')
# In the order in which their entries are written.
KINDS = ('table', 'Odometry', 'LaserScan', 'Range', 'Imu', 'numbers', 'command')


@dataclass
class Candidate:
    """One entry of a suggested map.

    Attributes:
        entry: its keys.
        topic: which it is read from.
        kind: one of :data:`KINDS`.
        aside: why it is written as a comment only; empty for an entry in use.
        remark: what a reader should know about it.
        seen: statistics of its features on the recording; empty if they could not be computed.
    """

    entry: dict[str, Any]
    topic: TopicInspection
    kind: str
    aside: str = ''
    remark: str = ''
    seen: tuple[FeatureStatistics, ...] = ()

    @property
    def is_flag(self) -> bool:
        """Whether the field is a whole number or a flag by type, as that of a bumper."""
        return self.entry.get('field') in self.topic.integers


def candidates_of(topic: TopicInspection) -> Iterator[Candidate]:
    """Yield the features that the type of a topic suggests."""
    if not topic.decoded:
        return
    kind = topic.msgtype.rpartition('/')[2]
    heuristic = _HEURISTICS.get(topic.msgtype)
    few = '' if topic.count >= _LEAST_MESSAGES else f'only {topic.count} messages'
    for item in heuristic(topic) if heuristic else _numbers(topic):
        item.kind = item.kind or (kind if kind in KINDS else 'numbers')
        item.aside = item.aside or few
        yield item


def _entry(topic: TopicInspection, name: str, field_path: str, unit: str, **more: Any) -> Candidate:
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': unit, **more}
    return Candidate(entry, topic, '')


def _odometry(topic: TopicInspection) -> Iterator[Candidate]:
    yield _entry(topic, 'speed', 'twist.twist.linear.x', 'm/s')
    yield _entry(topic, 'side_speed', 'twist.twist.linear.y', 'm/s')
    turn = _entry(topic, 'turn_rate', 'twist.twist.angular.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    turn.remark = 'the same to the left and to the right; delete abs to tell them apart'
    yield turn
    change = _entry(topic, 'acceleration', 'twist.twist.linear.x', 'm/s^2', transform=['rate'])
    change.aside = 'the rate of change of a measured speed is noisy'
    yield change
    yield from _pose(topic, 'pose.pose')


def _pose(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    frame = ', '.join(sorted(topic.frames)) or '(none)'
    reason = (
        f'coordinates in the frame {frame!r}: rules about them are valid only in this '
        'environment and for this origin of the frame'
        + (', and a map frame jumps when the robot relocalizes' if 'map' in topic.frames else '')
    )
    for name, place, unit in (
        ('position_x', 'position.x', 'm'),
        ('position_y', 'position.y', 'm'),
        ('heading', 'orientation|yaw', 'rad'),
    ):
        item = _entry(topic, name, f'{path}.{place}', unit)
        item.aside = reason
        yield item


def _laser_scan(topic: TopicInspection) -> Iterator[Candidate]:
    scan = topic.scan
    if scan is None:
        return
    count = max(min(_SECTORS, scan.least_beams // 2), 2)
    cap = nice_below(min(scan.range_max, float(np.percentile(scan.openness, 10))))
    entry: dict[str, Any] = {'name': 'clearance', 'topic': topic.key, 'field': 'ranges'}
    if scan.last - scan.first + scan.step < _ALL_AROUND:
        # Half a degree more on both sides, so that the last sector includes the last beam.
        entry['degrees'] = [math.floor(scan.first - 0.5), math.ceil(scan.last + 0.5)]
    entry |= {
        'sectors': count,
        'reduce': 'min',
        'missing': 'max_range',
        'transform': [{'clip': [0, cap]}],
        'unit': 'm',
        'bounds': [0, cap],
    }
    zero, infinite, nan, _, beams = scan.counts
    shares = [
        f'{number / beams:.0%} {word}'
        for number, word in ((infinite, 'Inf'), (zero, '0'), (nan, 'NaN'))
        if number
    ]
    remark = (
        f'the closest return in each sector. More than {cap:g} m counts as {cap:g} m, so that no '
        'rule forbids open space.'
    )
    if shares:
        remark += f' Of the ranges, {", ".join(shares)}, which is read as nothing in range.'
    yield Candidate(entry, topic, '', remark=remark)


def _imu(topic: TopicInspection) -> Iterator[Candidate]:
    yield _entry(topic, 'acceleration_x', 'linear_acceleration.x', 'm/s^2')
    yield _entry(topic, 'acceleration_y', 'linear_acceleration.y', 'm/s^2')
    turn = _entry(topic, 'gyro_z', 'angular_velocity.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    yield turn


def _twist(topic: TopicInspection) -> Iterator[Candidate]:
    path = 'twist.' if topic.msgtype.endswith('Stamped') else ''
    turn = _entry(topic, 'commanded_turn_rate', f'{path}angular.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    for item in (_entry(topic, 'commanded_speed', f'{path}linear.x', 'm/s'), turn):
        item.kind = 'command'
        yield item


def _range(topic: TopicInspection) -> Iterator[Candidate]:
    name = re.sub(r'\W', '_', topic.key.rpartition('/')[2])
    top = float(topic.sample.max_range)
    item = _entry(topic, f'range_{name}', 'range', 'm', missing='max_range')
    if 0.0 < top < math.inf:
        item.entry['transform'] = [{'clip': [0, top]}]
        item.entry['bounds'] = [0, top]
    item.remark = 'nothing in range counts as the maximum range'
    yield item


def _point_cloud(topic: TopicInspection) -> Iterator[Candidate]:
    try:
        table = Table.from_message(topic.sample)
    except OccError:
        return
    columns = [name for name in table.names if name not in _STEP_COLUMNS]
    # A cloud of points, and what our own nodes publish besides observations.
    if {'x', 'y', 'z'} <= set(columns) or 'verdict' in columns or 'evaluated' in columns:
        return
    taken: set[str] = set()
    for column in columns:
        name = re.sub(r'\W', '_', column).lstrip('_0123456789') or 'column'
        if name in taken:
            continue
        taken.add(name)
        entry = {'name': name, 'topic': topic.key, 'column': column, 'unit': '1'}
        stem = re.fullmatch(r'(.+)_\d+', column)
        if stem and sum(other.startswith(f'{stem[1]}_') for other in columns) > 1:
            entry['family'] = stem[1]
        yield Candidate(entry, topic, 'table')


def _numbers(topic: TopicInspection) -> Iterator[Candidate]:
    """Yield the numbers of a small message of another type."""
    if not 0 < len(topic.numbers) <= _MOST_NUMBERS:
        return
    stem = re.sub(r'\W', '_', topic.key.rpartition('/')[2])
    for path in topic.numbers:
        leaf = path.replace('.', '_')
        name = leaf if leaf.startswith(stem) else f'{stem}_{leaf}'
        item = _entry(topic, name, path, '1')
        item.kind = 'numbers'
        item.remark = 'its message type is not known here, so check the unit'
        if _COMMON.match(topic.msgtype):
            item.aside = f'the meaning of a {topic.msgtype} is not known'
        yield item


_HEURISTICS: dict[str, Callable[[TopicInspection], Iterator[Candidate]]] = {
    'nav_msgs/msg/Odometry': _odometry,
    'sensor_msgs/msg/LaserScan': _laser_scan,
    'sensor_msgs/msg/Imu': _imu,
    'sensor_msgs/msg/Range': _range,
    'sensor_msgs/msg/PointCloud2': _point_cloud,
    'geometry_msgs/msg/Twist': _twist,
    'geometry_msgs/msg/TwistStamped': _twist,
    'geometry_msgs/msg/PoseStamped': lambda topic: _pose(topic, 'pose'),
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda topic: _pose(topic, 'pose.pose'),
}


def nice_below(value: float) -> float:
    """Return the largest nice number that is not above ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    # Single-precision ranges lie a little below the number that is meant.
    found = [nice * power for nice in _NICE if nice * power <= value * (1.0 + 1e-6)]
    return float(f'{max(found, default=power):.6g}')
