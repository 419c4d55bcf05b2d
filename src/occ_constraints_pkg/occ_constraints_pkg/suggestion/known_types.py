# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which features each known message type suggests."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.suggestion.candidate import (
    MOST_ANGLE,
    Candidate,
    elements_of,
    entry_of,
    label_of,
    looks_like_degrees,
    plain_entry,
    vector_moves,
)
from occ_constraints_pkg.suggestion.inspection import Series, TopicInspection, identifier
from occ_constraints_pkg.suggestion.meanings import is_command, is_turning, slides
from occ_constraints_pkg.suggestion.nice_numbers import nice_above, nice_below

_SECTORS = 8
# Altitudes by satellite are off by as much, more or less of it from day to day.
_SATELLITE_ERROR_M = 10.0
# A scan that covers at least this many degrees is taken to look all around.
_ALL_AROUND = 350.0
# Columns of our own tables that are not sensor values.
_STEP_COLUMNS = {'reward', 'terminated', 'truncated', 'episode', 'true_cost'}


def _magnitude(item: Candidate) -> Candidate:
    """Let only the absolute value count, without a lower bound."""
    item.entry['transform'], item.entry['bounds'] = ['abs'], [0, None]
    return item


def _odometry(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    twist = f'{path}twist.twist'
    yield plain_entry(topic, 'speed', f'{twist}.linear.x', 'm/s', 'Odometry')
    yield plain_entry(topic, 'side_speed', f'{twist}.linear.y', 'm/s', 'Odometry')
    turn = _magnitude(plain_entry(topic, 'turn_rate', f'{twist}.angular.z', 'rad/s', 'Odometry'))
    turn.remark = 'the same to the left and to the right; delete abs to tell them apart'
    yield turn
    change = plain_entry(
        topic, 'acceleration', f'{twist}.linear.x', 'm/s^2', 'Odometry', transform=['rate']
    )
    change.aside = 'the rate of change of a measured speed is noisy'
    yield change
    climb = entry_of(topic, 'vertical_speed', f'{twist}.linear.z', 'vertical speed', 'Odometry')
    climb.is_extra, climb.once = True, 'vertical_speed'
    yield climb
    yield from _pose(topic, f'{path}pose.pose.')


def _pose(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    kind = 'Odometry' if topic.msgtype == 'nav_msgs/msg/Odometry' else 'pose'
    if is_command(topic.name):
        kind = 'command'
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
        item = plain_entry(topic, name, f'{path}{place}', unit, kind)
        item.aside = reason
        yield item
    height = entry_of(topic, 'height', f'{path}position.z', 'height', kind)
    height.is_extra, height.once = True, 'height'
    height.remark = 'above the origin of its frame'
    yield height
    yield from orientation_of(topic, f'{path}orientation', kind)


def orientation_of(
    topic: TopicInspection, field_path: str, kind: str, **more: Any
) -> Iterator[Candidate]:
    """Yield angles of a body; of a pose roll and pitch are used, of others the tilt."""
    has_pose = kind in ('Odometry', 'pose') and not more
    for name in ('tilt', 'roll', 'pitch'):
        item = entry_of(topic, name, f'{field_path}|{name}', 'tilt', kind, **more)
        item.is_extra, item.once = True, name
        if name == 'tilt':
            item.remark = 'the angle between upright and the body, in whatever direction'
            item.aside = 'roll and pitch tell it' if has_pose else ''
        elif not has_pose:
            item.aside = 'tilt tells it, in whatever direction'
        yield item


def _laser_scan(topic: TopicInspection) -> Iterator[Candidate]:
    scan = topic.scan
    if scan is None:
        return
    cap = nice_below(min(scan.range_max, float(np.percentile(scan.openness(), 10))))
    entry: dict[str, Any] = {'name': 'clearance', 'topic': topic.key, 'field': 'ranges'}
    body: list[list[float]] = []
    if not scan.fault:
        if scan.last - scan.first + scan.step < _ALL_AROUND:
            # Half a degree more on both sides, so that the last sector includes the last beam.
            entry['degrees'] = [math.floor(scan.first - 0.5), math.ceil(scan.last + 0.5)]
        entry['sectors'] = max(min(_SECTORS, scan.least_beams // 2), 2)
        if body := scan.body():
            entry['exclude_degrees'] = body
    entry |= {'reduce': 'min', 'missing': 'max_range'}
    if math.isfinite(scan.code):
        least = min(nice_above(scan.code * 1.5), scan.range_min)
        entry['range_limits'] = [least, float(f'{scan.range_max:.6g}')]
    entry |= {'transform': [{'clip': [0, cap]}], 'unit': 'm', 'bounds': [0, cap]}
    zero, infinite, nan, _, beams = scan.counts
    shares = [
        f'{number / beams:.0%} {word}'
        for number, word in ((infinite, 'Inf'), (zero, '0'), (nan, 'NaN'))
        if number
    ]
    where = 'in any direction' if scan.fault else 'in each sector'
    remark = (
        f'the closest return {where}. More than {cap:g} m counts as {cap:g} m, so that no '
        'rule forbids open space.'
    )
    if shares:
        remark += f' Of the ranges, {", ".join(shares)}, which is read as nothing in range.'
    if body:
        places = ', '.join(f'{low:g} to {high:g}' for low, high in body)
        remark += f' From {places} degrees the scanner sees the robot itself, which is left out.'
    item = Candidate(entry, topic, 'LaserScan', remark=remark)
    if scan.fault and scan.step:
        item.aside = f'the scan has {scan.fault}'
    yield item


def _imu(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    for axis in 'xy':
        push = plain_entry(
            topic, f'acceleration_{axis}', f'{path}linear_acceleration.{axis}', 'm/s^2', 'Imu'
        )
        push.remark = 'the same to both sides; delete abs to tell them apart'
        yield _magnitude(push)
    turn = _magnitude(plain_entry(topic, 'gyro_z', f'{path}angular_velocity.z', 'rad/s', 'Imu'))
    turn.once = 'gyro_z'
    yield turn
    for name, axis in (('roll_rate', 'x'), ('pitch_rate', 'y')):
        item = entry_of(topic, name, f'{path}angular_velocity.{axis}', 'turn rate', 'Imu')
        item.is_extra = True
        yield item
    whole = entry_of(
        topic, 'acceleration_norm', f'{path}linear_acceleration|norm', 'acceleration', 'Imu'
    )
    whole.remark = 'with gravity; a collision or a fall shows in it, in any direction'
    whole.is_extra = True
    yield whole
    unknown = topic.series.get(f'{path}orientation_covariance[0]')
    if unknown is None or unknown.low != -1.0:
        yield from orientation_of(topic, f'{path}orientation', 'Imu')


def _twist(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    if is_command(f'{topic.name}.{path}'):
        turn = _magnitude(
            plain_entry(topic, 'commanded_turn_rate', f'{path}angular.z', 'rad/s', 'command')
        )
        yield plain_entry(topic, 'commanded_speed', f'{path}linear.x', 'm/s', 'command')
        yield turn
        return
    speed = entry_of(topic, 'speed', f'{path}linear|norm', 'velocity', 'velocity')
    speed.once, speed.moves = 'speed', vector_moves(topic, f'{path}linear')
    yield speed
    climb = entry_of(topic, 'vertical_speed', f'{path}linear.z', 'vertical speed', 'velocity')
    turn = entry_of(topic, 'turn_rate', f'{path}angular.z', 'turn rate', 'velocity')
    for item in (climb, turn):
        item.is_extra, item.once = True, item.entry['name']
        yield item


def _wrench(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    if is_command(f'{topic.name}.{path}'):
        return
    stem = topic.stem
    for part, role in (('force', 'force'), ('torque', 'torque')):
        item = entry_of(topic, f'{stem}_{part}', f'{path}{part}|norm', role, 'force')
        item.remark = f'the norm of the {part}, whatever its direction'
        item.coupled = topic.name
        yield item


def _battery(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    for name, part, role in (
        ('voltage', 'voltage', 'voltage'),
        ('percentage', 'percentage', 'charge'),
        ('current', 'current', 'current'),
        ('temperature', 'temperature', 'temperature'),
    ):
        series = topic.series.get(f'{path}{part}')
        if series is None or not series.finite.size:
            continue
        item = entry_of(topic, f'battery_{name}', f'{path}{part}', role, 'battery')
        if role in ('voltage', 'charge'):
            item.once = f'{topic.name} {name}'
        yield item


def _range(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    item = plain_entry(topic, f'range_{topic.stem}', f'{path}range', 'm', 'Range')
    top = topic.series[f'{path}max_range'].high
    if not path and 0.0 < top < math.inf:
        item.entry |= {
            'missing': 'max_range',
            'transform': [{'clip': [0, top]}],
            'bounds': [0, top],
        }
        item.remark = 'nothing in range counts as the maximum range'
    yield item


def _fix(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    height = entry_of(topic, 'altitude', f'{path}altitude', 'height', 'position')
    height.remark = 'above the ellipsoid: valid at this place only'
    height.once = 'height'
    height.aside = altitude_flaw(topic.series[f'{path}altitude'])
    yield height
    state = entry_of(topic, f'{topic.stem}_fix', f'{path}status.status', 'flag', 'position')
    state.entry |= {'transform': [{'clip': [-1, 0]}], 'bounds': [-1, 0]}
    state.remark = '-1: no fix, which no rule allows if there always was one'
    state.is_flag = True
    yield state
    for name in ('latitude', 'longitude'):
        item = plain_entry(topic, name, f'{path}{name}', '1', 'position')
        item.aside = 'a coordinate on the map: rules about it are valid only at this place'
        yield item


def altitude_flaw(series: Series) -> str:
    """Say why an altitude by satellite is no feature; empty for one of something that flies."""
    if not series.high - series.low > _SATELLITE_ERROR_M:
        return (
            f'it stays within {_SATELLITE_ERROR_M:g} m, by which satellite altitudes are off from '
            'day to day'
        )
    if series.only_rises:
        return 'it only rises or only falls here, so its limits were not seen'
    return ''


def _joint_state(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    commanded = is_command(topic.name)
    for part, role in (
        ('position', 'joint position'),
        ('velocity', 'joint speed'),
        ('effort', 'effort'),
    ):
        for place, series in elements_of(topic, f'{path}{part}'):
            name = f'{part}_{identifier(label_of(place))}'
            item = entry_of(topic, name, place, role, 'command' if commanded else 'joints')
            item.group = part
            if part != 'position':
                item.coupled = label_of(place)
            if part != 'effort' and slides(place):
                item.entry['unit'] = 'm' if part == 'position' else 'm/s'
            if not series.finite.size:
                item.aside = 'it was never measured'
            elif part == 'position' and (
                is_turning(place) or series.only_rises or _turns_on(series)
            ):
                item.aside = 'it turns on and on, as wheels do'
            yield item


def _turns_on(series: Series) -> bool:
    """Tell whether a joint turned by more than twice around; degrees would jump less smoothly."""
    return series.high - series.low > 4.0 * math.pi and not looks_like_degrees(series, MOST_ANGLE)


def _controller_state(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    for part, unit in (('positions', 'rad'), ('velocities', 'rad/s')):
        for place, _ in elements_of(topic, f'{path}error.{part}'):
            name = f'{part.removesuffix("s")}_error_{identifier(label_of(place))}'
            item = entry_of(topic, name, place, 'error', 'error')
            item.entry['unit'] = unit
            item.group = f'{part}_error'
            yield item


def _ackermann(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    kind = 'command' if is_command(topic.name) or topic.stem.startswith('drive') else 'velocity'
    word = 'commanded_' if kind == 'command' else ''
    yield plain_entry(topic, f'{word}speed', f'{path}speed', 'm/s', kind)
    yield plain_entry(topic, f'{word}steering_angle', f'{path}steering_angle', 'rad', kind)


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


LARGE: dict[str, Callable[[TopicInspection], Iterator[Candidate]]] = {
    'sensor_msgs/msg/LaserScan': _laser_scan,
    'sensor_msgs/msg/PointCloud2': _point_cloud,
}
HEURISTICS: dict[str, Callable[[TopicInspection, str], Iterator[Candidate]]] = {
    'nav_msgs/msg/Odometry': _odometry,
    'sensor_msgs/msg/Imu': _imu,
    'sensor_msgs/msg/Range': _range,
    'sensor_msgs/msg/BatteryState': _battery,
    'sensor_msgs/msg/JointState': _joint_state,
    'sensor_msgs/msg/NavSatFix': _fix,
    'geometry_msgs/msg/Twist': _twist,
    'geometry_msgs/msg/TwistStamped': lambda topic, path: _twist(topic, f'{path}twist.'),
    'geometry_msgs/msg/TwistWithCovariance': lambda topic, path: _twist(topic, f'{path}twist.'),
    'geometry_msgs/msg/TwistWithCovarianceStamped': (
        lambda topic, path: _twist(topic, f'{path}twist.twist.')
    ),
    'geometry_msgs/msg/Wrench': _wrench,
    'geometry_msgs/msg/WrenchStamped': lambda topic, path: _wrench(topic, f'{path}wrench.'),
    'geometry_msgs/msg/Pose': _pose,
    'geometry_msgs/msg/PoseStamped': lambda topic, path: _pose(topic, f'{path}pose.'),
    'geometry_msgs/msg/PoseWithCovariance': lambda topic, path: _pose(topic, f'{path}pose.'),
    'geometry_msgs/msg/PoseWithCovarianceStamped': (
        lambda topic, path: _pose(topic, f'{path}pose.pose.')
    ),
    'control_msgs/msg/JointTrajectoryControllerState': _controller_state,
    'ackermann_msgs/msg/AckermannDrive': _ackermann,
    'ackermann_msgs/msg/AckermannDriveStamped': (
        lambda topic, path: _ackermann(topic, f'{path}drive.')
    ),
}
