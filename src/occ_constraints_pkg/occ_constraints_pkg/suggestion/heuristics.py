# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Heuristics: which features each message type, or the structure of an unknown one, suggests."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.fields import field_names
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.suggestion.inspection import (
    MOST_ELEMENTS,
    Series,
    TopicInspection,
    identifier,
)
from occ_constraints_pkg.suggestion.meanings import (
    ROLES,
    Meaning,
    Role,
    is_command,
    is_turning,
    meaning_of,
    names_a_hazard,
    words_of,
)
from occ_constraints_pkg.suggestion.statistics import FeatureStatistics

_SECTORS = 8
# A scan that covers at least this many degrees is taken to look all around.
_ALL_AROUND = 350.0
_NICE = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
# Columns of our own tables that are not sensor values.
_STEP_COLUMNS = {'reward', 'terminated', 'truncated', 'episode', 'true_cost'}
# Of a type that is not known, so many numbers without a meaning are suggested, and no more.
_MOST_NUMBERS = 8
_DEEPEST = 4
_COMMON = re.compile(r'(std|sensor|geometry|nav|trajectory|shape|stereo)_msgs/')
_CONSTANT = re.compile(r'^u?int8\s+([A-Z][A-Z_0-9]*)\s*=\s*(\d+)', re.MULTILINE)
# In the order in which their entries are written.
KINDS = (
    *(
        'table',
        'Odometry',
        'LaserScan',
        'Range',
        'Imu',
        'pose',
        'velocity',
        'motion',
        'joints',
        'force',
    ),
    *('position', 'error', 'numbers', 'battery', 'command'),
)
# More than this many rad or rad/s are degrees.
_MOST_ANGLE, _MOST_SPEED = 7.0, 500.0
_DEGREES = 'its values look like degrees; allowed is SI, which a step {scale: 0.0174533} makes'


@dataclass
class Candidate:
    """One entry of a suggested map.

    Attributes:
        entry: its keys.
        topic: which it is read from.
        kind: one of :data:`KINDS`.
        aside: why it is written as a comment only; empty for an entry in use.
        remark: what a reader should know about it.
        seen: statistics of its features on the first recording, then on the next; empty if they
            could not be computed.
        role: what it measures; None where the values alone decide on steps.
        group: features that are one family if they behave alike; empty for none.
        once: of candidates with the same word here, one is used.
        replaced_by: the candidate that is used instead.
        part_of: what another candidate, with this word in ``once``, tells as well.
        moves: whether a vector changes, be its length as it may.
        is_extra: whether it is not worth a comment when it never changes.
        is_flag: whether the field is a flag or whole number that may stay the same, as a bumper's.
        is_doubtful: whether its meaning is not known.
        is_brief: whether its name and the reason are enough of a comment when it is set aside.
        is_dull: whether it was set aside because it never changes.
        family_seen: of a family, the statistics of all members.
        name: what it is called where no other candidate is.
    """

    entry: dict[str, Any]
    topic: TopicInspection
    kind: str
    aside: str = ''
    remark: str = ''
    seen: tuple[FeatureStatistics, ...] = ()
    role: Role | None = None
    group: str = ''
    once: str = ''
    replaced_by: Candidate | None = None
    part_of: str = ''
    moves: bool = False
    is_extra: bool = False
    is_flag: bool = False
    is_doubtful: bool = False
    is_brief: bool = False
    is_dull: bool = False
    family_seen: tuple[FeatureStatistics, ...] = ()
    name: str = ''

    def __post_init__(self) -> None:
        self.name = self.name or self.entry['name']


def candidates_of(topic: TopicInspection) -> Iterator[Candidate]:
    """Yield the features that the type of a topic, or its structure, suggests."""
    if topic.silence:
        return
    heuristic = _HEURISTICS.get(topic.msgtype)
    if topic.msgtype in ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2'):
        yield from _LARGE[topic.msgtype](topic)
    elif heuristic is not None:
        yield from heuristic(topic, '')
    else:
        yield from _limited(topic, _structure(topic, topic.sample, ''))


def _entry(
    topic: TopicInspection, name: str, field_path: str, role: str, kind: str, **more: Any
) -> Candidate:
    what = ROLES[role]
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': what.unit, **more}
    return Candidate(entry, topic, kind, role=what)


def _plain(
    topic: TopicInspection, name: str, field_path: str, unit: str, kind: str, **more: Any
) -> Candidate:
    """Return a candidate whose steps the values alone decide."""
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': unit, **more}
    return Candidate(entry, topic, kind)


def _magnitude(item: Candidate) -> Candidate:
    """Let only the absolute value count, without a lower bound."""
    item.entry['transform'], item.entry['bounds'] = ['abs'], [0, None]
    return item


# What messages say ------------------------------------------------------------------------------


def _odometry(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    twist = f'{path}twist.twist'
    yield _plain(topic, 'speed', f'{twist}.linear.x', 'm/s', 'Odometry')
    yield _plain(topic, 'side_speed', f'{twist}.linear.y', 'm/s', 'Odometry')
    turn = _magnitude(_plain(topic, 'turn_rate', f'{twist}.angular.z', 'rad/s', 'Odometry'))
    turn.remark = 'the same to the left and to the right; delete abs to tell them apart'
    yield turn
    change = _plain(
        topic, 'acceleration', f'{twist}.linear.x', 'm/s^2', 'Odometry', transform=['rate']
    )
    change.aside = 'the rate of change of a measured speed is noisy'
    yield change
    climb = _entry(topic, 'vertical_speed', f'{twist}.linear.z', 'vertical speed', 'Odometry')
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
        item = _plain(topic, name, f'{path}{place}', unit, kind)
        item.aside = reason
        yield item
    height = _entry(topic, 'height', f'{path}position.z', 'height', kind)
    height.is_extra, height.once = True, 'height'
    height.remark = 'above the origin of its frame'
    yield height
    yield from _orientation(topic, f'{path}orientation', kind)


def _orientation(
    topic: TopicInspection, field_path: str, kind: str, **more: Any
) -> Iterator[Candidate]:
    """Yield angles of a body; of a pose roll and pitch are used, of others the tilt."""
    has_pose = kind in ('Odometry', 'pose') and not more
    for name in ('tilt', 'roll', 'pitch'):
        item = _entry(topic, name, f'{field_path}|{name}', 'tilt', kind, **more)
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
        yield _plain(
            topic, f'acceleration_{axis}', f'{path}linear_acceleration.{axis}', 'm/s^2', 'Imu'
        )
    turn = _magnitude(_plain(topic, 'gyro_z', f'{path}angular_velocity.z', 'rad/s', 'Imu'))
    turn.once = 'gyro_z'
    yield turn
    for name, axis in (('roll_rate', 'x'), ('pitch_rate', 'y')):
        item = _entry(topic, name, f'{path}angular_velocity.{axis}', 'turn rate', 'Imu')
        item.is_extra = True
        yield item
    whole = _entry(
        topic, 'acceleration_norm', f'{path}linear_acceleration|norm', 'acceleration', 'Imu'
    )
    whole.remark = 'with gravity; a collision or a fall shows in it, in any direction'
    whole.is_extra = True
    yield whole
    unknown = topic.series.get(f'{path}orientation_covariance[0]')
    if unknown is None or unknown.low != -1.0:
        yield from _orientation(topic, f'{path}orientation', 'Imu')


def _twist(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    if is_command(f'{topic.name}.{path}'):
        turn = _magnitude(
            _plain(topic, 'commanded_turn_rate', f'{path}angular.z', 'rad/s', 'command')
        )
        yield _plain(topic, 'commanded_speed', f'{path}linear.x', 'm/s', 'command')
        yield turn
        return
    speed = _entry(topic, 'speed', f'{path}linear|norm', 'velocity', 'velocity')
    speed.once, speed.moves = 'speed', _moves(topic, f'{path}linear')
    yield speed
    climb = _entry(topic, 'vertical_speed', f'{path}linear.z', 'vertical speed', 'velocity')
    turn = _entry(topic, 'turn_rate', f'{path}angular.z', 'turn rate', 'velocity')
    for item in (climb, turn):
        item.is_extra, item.once = True, item.entry['name']
        yield item


def _wrench(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    if is_command(f'{topic.name}.{path}'):
        return
    stem = topic.stem
    for part, role in (('force', 'force'), ('torque', 'torque')):
        item = _entry(topic, f'{stem}_{part}', f'{path}{part}|norm', role, 'force')
        item.remark = f'the norm of the {part}, whatever its direction'
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
        item = _entry(topic, f'battery_{name}', f'{path}{part}', role, 'battery')
        if role in ('voltage', 'charge'):
            item.once = f'{topic.name} {name}'
        yield item


def _range(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    item = _plain(topic, f'range_{topic.stem}', f'{path}range', 'm', 'Range')
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
    height = _entry(topic, 'altitude', f'{path}altitude', 'height', 'position')
    height.remark = 'above the ellipsoid: valid at this place only'
    height.once = 'height'
    if topic.series[f'{path}altitude'].only_rises:
        height.aside = 'it only rises or only falls here, so its limits were not seen'
    yield height
    state = _entry(topic, f'{topic.stem}_fix', f'{path}status.status', 'flag', 'position')
    state.entry |= {'transform': [{'clip': [-1, 0]}], 'bounds': [-1, 0]}
    state.remark = '-1: no fix, which no rule allows if there always was one'
    state.is_flag = True
    yield state
    for name in ('latitude', 'longitude'):
        item = _plain(topic, name, f'{path}{name}', '1', 'position')
        item.aside = 'a coordinate on the map: rules about it are valid only at this place'
        yield item


def _joint_state(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    commanded = is_command(topic.name)
    for part, role in (
        ('position', 'joint position'),
        ('velocity', 'joint speed'),
        ('effort', 'effort'),
    ):
        for place, series in _elements(topic, f'{path}{part}'):
            name = f'{part}_{identifier(_label(place))}'
            item = _entry(topic, name, place, role, 'command' if commanded else 'joints')
            item.group = part
            if not series.finite.size:
                item.aside = 'it was never measured'
            elif part == 'position' and (
                is_turning(place) or series.only_rises or _turns_on(series)
            ):
                item.aside = 'it turns on and on, as wheels do'
            yield item


def _turns_on(series: Series) -> bool:
    """Tell whether a joint turned by more than twice around; degrees would jump less smoothly."""
    return series.high - series.low > 4.0 * math.pi and not _looks_like_degrees(series, _MOST_ANGLE)


def _looks_like_degrees(series: Series, most: float) -> bool:
    finite = series.finite
    return bool(finite.size) and most < float(np.percentile(np.abs(finite), 99)) <= 720.0


def _controller_state(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    for part, unit in (('positions', 'rad'), ('velocities', 'rad/s')):
        for place, _ in _elements(topic, f'{path}error.{part}'):
            name = f'{part.removesuffix("s")}_error_{identifier(_label(place))}'
            item = _entry(topic, name, place, 'error', 'error')
            item.entry['unit'] = unit
            item.group = f'{part}_error'
            yield item


def _elements(topic: TopicInspection, path: str) -> Iterator[tuple[str, Series]]:
    """Yield the elements of an array of numbers that were seen, by their paths.

    Those by number have to be in every message; those by name need not.
    """
    for place, series in topic.series.items():
        if series.share < 1.0 and '=' not in place:
            continue
        if place.startswith(f'{path}[') and place.endswith(']') and '.' not in place[len(path) :]:
            yield place, series


def _label(place: str) -> str:
    """Return what stands in the last brackets, without the name of the list of names."""
    return place[place.rindex('[') + 1 : -1].rpartition('=')[2]


def _ackermann(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    kind = 'command' if is_command(topic.name) or topic.stem.startswith('drive') else 'velocity'
    word = 'commanded_' if kind == 'command' else ''
    yield _plain(topic, f'{word}speed', f'{path}speed', 'm/s', kind)
    yield _plain(topic, f'{word}steering_angle', f'{path}steering_angle', 'rad', kind)


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


# What structure says ----------------------------------------------------------------------------


def _structure(
    topic: TopicInspection, message: Any, path: str, depth: int = 0
) -> Iterator[Candidate]:
    """Yield the numbers of a message whose type is not known, by its parts and their names."""
    for name in field_names(message):
        value, place = getattr(message, name), f'{path}{name}'
        msgtype = getattr(value, '__msgtype__', '')
        if name == 'header' or msgtype.startswith('builtin_interfaces/'):
            continue
        if place in topic.series:
            yield from _number(topic, place)
        elif place in topic.lengths:
            yield from _array(topic, place, value)
        elif msgtype in _HEURISTICS:
            yield from _HEURISTICS[msgtype](topic, f'{place}.')
        elif msgtype == 'geometry_msgs/msg/Quaternion':
            yield from _orientation(topic, place, 'motion')
        elif {'x', 'y', 'z'} <= set(field_names(value)):
            yield from _vector(topic, place)
        elif depth < _DEEPEST:
            yield from _structure(topic, value, f'{place}.', depth + 1)


def _name(topic: TopicInspection, path: str) -> str:
    """Return a name for a field: that of its topic and its own."""
    told = re.sub(r'\b(data|value)\b|\w+=', '', path)
    leaf = re.sub(r'[^A-Za-z0-9]+', '_', told).strip('_')
    if leaf.startswith(topic.stem):
        return leaf
    return f'{topic.stem}_{leaf}' if leaf else topic.stem


def _number(topic: TopicInspection, path: str, *, group: str = '') -> Iterator[Candidate]:
    """Yield one number of a message."""
    series = topic.series[path]
    meaning = meaning_of(path, topic.name, topic.msgtype, series)
    role = ROLES[meaning.role or 'number']
    if meaning.role == 'acceleration':
        # In m/s^2 or in multiples of gravity.
        role = replace(role, unit='1', resolution=0.0)
    unit = _unit(path, meaning, role, series)
    item = _plain(topic, _name(topic, path), path, unit, _kind(meaning))
    item.role, item.aside, item.group = role, meaning.reason, group
    item.is_flag, item.is_brief = meaning.role == 'flag', True
    item.is_doubtful = meaning.role == 'number'
    leaf = path.rpartition('.')[2]
    item.part_of = {'vx': 'speed', 'vy': 'speed', 'vz': 'vertical_speed'}.get(leaf, '')
    if not meaning.reason and not item.is_flag:
        item.remark = 'its message type does not tell the unit'
    if series.share < 1.0 and '=' not in path:
        item.aside = item.aside or f'only {series.share:.0%} of the messages have it'
    yield item


def _kind(meaning: Meaning) -> str:
    if meaning.is_command:
        return 'command'
    return {
        **dict.fromkeys(('voltage', 'charge', 'current', 'power'), 'battery'),
        **dict.fromkeys(('force', 'torque', 'effort'), 'force'),
        'error': 'error',
    }.get(meaning.role, 'numbers')


def _unit(path: str, meaning: Meaning, role: Role, series: Series) -> str:
    words = set(words_of(path))
    if words & {'ma', 'mv', 'mah', 'deg', 'degrees', 'cm', 'mm'} or not meaning.role:
        return '1'
    # No robot is as fast: a motor's own unit.
    is_raw = role.unit == 'm/s' and max(abs(series.low), abs(series.high)) > _MOST_SPEED
    return '1' if is_raw else role.unit


def _array(topic: TopicInspection, path: str, value: Any) -> Iterator[Candidate]:
    """Yield what an array of numbers or of messages suggests."""
    lengths = topic.lengths[path]
    words = set(words_of(path))
    if words & {'covariance', 'variance', 'var', 'cov'}:
        return
    if max(lengths) and len(value) and field_names(value[0]):
        yield from _messages(topic, path)
        return
    if not lengths <= set(range(1, MOST_ELEMENTS + 1)):
        if 0 in lengths and names_a_hazard(f'{topic.stem} {topic.msgtype} {path}'):
            yield from _events(topic, path)
        return
    elements = list(_elements(topic, path))
    size = max(lengths)
    if len(lengths) == 1 and size == 4 and (order := _quaternion_order(topic, path)):
        yield from _orientation(topic, path, 'motion', order=order)
    elif len(lengths) == 1 and size == 3 and not words & {'rpy', 'euler'} and _is_vector(words):
        yield from _vector(topic, path)
    elif words & {'rpy', 'euler'} and size == 3:
        tilt = _entry(topic, 'tilt', f'{path}[0:2]|norm', 'tilt', 'motion')
        tilt.once, tilt.is_extra = 'tilt', True
        tilt.moves = any(series.high - series.low > 0.01 for _, series in elements[:2])
        tilt.remark = 'the norm of roll and pitch'
        if any(_looks_like_degrees(series, _MOST_ANGLE) for _, series in elements[:2]):
            tilt.aside = _DEGREES
        yield tilt
    else:
        for place, _ in elements:
            yield from _number(topic, place, group=_name(topic, path))


def _is_vector(words: set[str]) -> bool:
    return bool(
        words
        & {
            *('velocity', 'vel', 'speed', 'acceleration', 'accel', 'accelerometer', 'gyroscope'),
            *('gyro', 'angular', 'rates', 'force', 'torque', 'position', 'pos', 'xyz', 'linear'),
            *('error', 'acc'),
        }
    )


def _quaternion_order(topic: TopicInspection, path: str) -> str:
    """Return the order of four numbers that are a quaternion; empty if they are none."""
    if not set(words_of(path)) & {'q', 'quaternion', 'quat', 'orientation', 'attitude'}:
        return ''
    parts = np.array([topic.series[f'{path}[{index}]'].values for index in range(4)])
    norms = np.linalg.norm(parts, axis=0)
    if not np.all(np.abs(norms[np.isfinite(norms)] - 1.0) < 0.05) or not np.isfinite(norms).any():
        return ''
    # The scalar part is the large one of a robot that stands upright; wxyz is what float arrays of
    # autopilots and legged robots have.
    first, last = np.nanmedian(np.abs(parts[0])), np.nanmedian(np.abs(parts[3]))
    return 'xyzw' if last > 0.9 and first < 0.3 else 'wxyz'


def _vector(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    """Yield what a vector of three numbers suggests, by its name."""
    words = set(words_of(path)) | set(words_of(topic.stem))
    own = set(words_of(path))
    is_array = f'{path}[2]' in topic.series
    x, z = (f'{path}[0]', f'{path}[2]') if is_array else (f'{path}.x', f'{path}.z')
    if x not in topic.series:
        return
    # The autopilot PX4 counts down as positive.
    down = topic.package == 'px4_msgs'
    kind, commanded = 'motion', is_command(f'{topic.name}.{path}')
    found: list[Candidate] = []
    if own & {'covariance', 'variance', 'var', 'delta', 'bias', 'offset'}:
        return
    if not own - {'vector', 'data'}:
        own = words
    is_change = bool(own & {'acceleration', 'accel', 'acc'})
    if own & {'angular', 'gyroscope', 'gyro', 'rates', 'omega'} and not is_change:
        item = _entry(topic, 'turn_rate', f'{path}|norm', 'turn rate', kind)
        item.once = 'rotation'
        found.append(item)
    elif own & {'accelerometer'} or (is_change and 'angular' not in own):
        item = _entry(topic, 'acceleration_norm', f'{path}|norm', 'acceleration', kind)
        item.once = 'acceleration_norm'
        found.append(item)
    elif own & {'velocity', 'vel', 'speed', 'linear', 'twist'} and not is_change:
        item = _entry(topic, 'speed', f'{path}|norm', 'velocity', kind)
        climb = _entry(topic, 'vertical_speed', z, 'vertical speed', kind)
        if down:
            climb.entry['transform'] = [{'scale': -1.0}]
        item.once, climb.once, climb.is_extra = 'speed', 'vertical_speed', True
        found += [item, climb]
    elif own & {'force', 'torque'}:
        part = 'force' if 'force' in own else 'torque'
        found.append(_entry(topic, _name(topic, path), f'{path}|norm', part, 'force'))
    elif own & {'error'}:
        found.append(_entry(topic, _name(topic, path), f'{path}|norm', 'error', 'error'))
    elif words & {'position', 'pos', 'point', 'odometry', 'pose', 'xyz', 'translation'}:
        height = _entry(topic, 'altitude' if down else 'height', z, 'height', kind)
        height.once, height.is_extra = 'height', True
        if down:
            height.entry['transform'] = [{'scale': -1.0}]
            height.remark = 'PX4 counts down as positive, hence the scale'
        found.append(height)
    for item in found:
        if commanded:
            item.kind = 'command'
            item.name = item.entry['name'] = f'commanded_{item.name}'
            item.once = ''
        item.is_extra = True
        item.moves = item.entry['field'].endswith('|norm') and _moves(topic, path)
        yield item


def _moves(topic: TopicInspection, path: str) -> bool:
    """Tell whether some part of a vector changes by more than noise."""
    return any(
        series.high - series.low > 0.01
        for place, series in topic.series.items()
        if place.startswith((f'{path}[', f'{path}.'))
    )


def _messages(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    """Yield the numbers of the elements of an array of messages, a family for each field."""
    lengths = topic.lengths[path]
    if len(lengths) != 1:
        if names_a_hazard(f'{topic.stem} {topic.msgtype} {path}'):
            yield from _events(topic, path)
        return
    pattern = re.compile(re.escape(path) + r'\[[^\]]*\]\.(.+)')
    for place in list(topic.series):
        found = pattern.fullmatch(place)
        if found and '.' not in found[1]:
            yield from _number(topic, place, group=_name(topic, f'{path}.{found[1]}'))


def _events(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    """Yield how many dangers a list of them reports, of each kind that the type names."""
    kinds = _kinds_of(topic, path)
    for name, selector in kinds or [(topic.stem, '')]:
        item = _entry(topic, name, f'{path}{selector}|count', 'flag', 'numbers')
        item.is_flag = True
        yield item


def _kinds_of(topic: TopicInspection, path: str) -> list[tuple[str, str]]:
    """Return the kinds of dangers in a list by the constants of its elements, with selectors."""
    node = dict(topic.definitions[topic.msgtype][1]).get(path)
    while node is not None and not isinstance(node[1], str):
        node = node[1][0]
    if node is None or node[1] not in topic.definitions:
        return []
    codes = [
        name for name, kind in topic.definitions[node[1]][1] if kind[1][0] in ('uint8', 'int8')
    ]
    # What follows the line with the type's name is its own definition.
    short = node[1].replace('/msg/', '/')
    text = topic.definition.partition(f'MSG: {short}\n')[2].partition('\n===')[0]
    return [
        (name.lower(), f'[{codes[0]}={value}]')
        for name, value in _CONSTANT.findall(text)
        if len(codes) == 1 and names_a_hazard(name)
    ]


def _limited(topic: TopicInspection, items: Iterable[Candidate]) -> Iterator[Candidate]:
    """Set aside numbers without a meaning where there are many, or where the type should tell."""
    found = list(items)
    doubtful = [item for item in found if item.is_doubtful and not item.aside]
    for item in doubtful:
        if _COMMON.match(topic.msgtype) and topic.package != 'std_msgs':
            item.aside = f'the meaning of a {topic.msgtype} is not known'
        elif len(doubtful) > _MOST_NUMBERS:
            item.aside = (
                f'one of {len(doubtful)} numbers of a {topic.msgtype}, whose meaning is not known'
            )
    yield from found


_LARGE: dict[str, Callable[[TopicInspection], Iterator[Candidate]]] = {
    'sensor_msgs/msg/LaserScan': _laser_scan,
    'sensor_msgs/msg/PointCloud2': _point_cloud,
}
_HEURISTICS: dict[str, Callable[[TopicInspection, str], Iterator[Candidate]]] = {
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


def nice_below(value: float) -> float:
    """Return the largest nice number that is not above ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    # Single-precision ranges lie a little below the number that is meant.
    found = [nice * power for nice in _NICE if nice * power <= value * (1.0 + 1e-6)]
    return float(f'{max(found, default=power):.6g}')


def nice_above(value: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    found = [nice * power for nice in (1.0, 2.0, 5.0, 10.0) if nice * power >= value * (1.0 - 1e-6)]
    return float(f'{min(found):.6g}')
