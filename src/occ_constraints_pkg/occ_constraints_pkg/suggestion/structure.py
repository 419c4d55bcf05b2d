# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which features the messages of a topic suggest, by their type or, unknown, by their structure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from occ_constraints_pkg.features.fields import field_names
from occ_constraints_pkg.suggestion.candidate import (
    DEGREES,
    MOST_ANGLE,
    Candidate,
    elements_of,
    entry_of,
    looks_like_degrees,
    plain_entry,
    vector_moves,
)
from occ_constraints_pkg.suggestion.inspection import (
    DIAGNOSTICS,
    MOST_ELEMENTS,
    Series,
    TopicInspection,
    identifier,
)
from occ_constraints_pkg.suggestion.known_types import (
    HEURISTICS,
    LARGE,
    altitude_flaw,
    orientation_of,
)
from occ_constraints_pkg.suggestion.meanings import (
    ROLES,
    Meaning,
    Role,
    is_command,
    meaning_of,
    names_a_hazard,
    words_of,
)

# Of a type that is not known, so many numbers without a meaning are suggested, and no more.
_MOST_NUMBERS = 8
_DEEPEST = 4
_COMMON = re.compile(r'(std|sensor|geometry|nav|trajectory|shape|stereo)_msgs/')
_CONSTANT = re.compile(r'^u?int8\s+([A-Z][A-Z_0-9]*)\s*=\s*(\d+)', re.MULTILINE)
# What moves a joint, and how fast.
_DYNAMIC = [ROLES[role] for role in ('joint speed', 'effort', 'torque', 'current', 'drive')]
# No robot is as fast, in m/s.
_MOST_SPEED = 500.0


def candidates_of(topic: TopicInspection) -> Iterator[Candidate]:
    """Yield the features that the type of a topic, or its structure, suggests."""
    if topic.silence:
        return
    heuristic = HEURISTICS.get(topic.msgtype)
    if topic.msgtype in ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/PointCloud2'):
        yield from LARGE[topic.msgtype](topic)
    elif topic.msgtype == DIAGNOSTICS:
        yield from _diagnostics(topic)
    elif heuristic is not None:
        yield from heuristic(topic, '')
    else:
        yield from _limited(topic, _structure(topic, topic.sample, ''))


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
        elif msgtype in HEURISTICS:
            yield from HEURISTICS[msgtype](topic, f'{place}.')
        elif msgtype == 'geometry_msgs/msg/Quaternion':
            yield from orientation_of(topic, place, 'motion')
        elif {'x', 'y', 'z'} <= set(field_names(value)):
            yield from _vector(topic, place)
        elif depth < _DEEPEST:
            yield from _structure(topic, value, f'{place}.', depth + 1)


def _diagnostics(topic: TopicInspection) -> Iterator[Candidate]:
    """Yield what the texts of diagnostics hold, where their keys tell what it is."""
    for place, series in topic.series.items():
        names = re.findall(r'=([^\]]*)\]', place)
        meaning = meaning_of(names[1], '', '', series)
        role = ROLES[meaning.role or 'number']
        item = plain_entry(
            topic, identifier('_'.join(names)).lower(), place, role.unit, _kind(meaning)
        )
        item.role, item.aside, item.is_brief = role, meaning.reason, True
        if meaning.role in ('number', 'flag') or meaning.is_command:
            item.aside = 'its key does not tell what it is'
        yield item


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
        role = replace(role, unit='1', resolution=0.0, harmless=0.0)
    unit = _unit(path, meaning, role, series)
    item = plain_entry(topic, _name(topic, path), path, unit, _kind(meaning))
    item.role, item.aside, item.group = role, meaning.reason, group
    item.is_flag, item.is_brief = meaning.role == 'flag', True
    item.is_doubtful = meaning.role == 'number'
    leaf = path.rpartition('.')[2]
    item.part_of = {'vx': 'speed', 'vy': 'speed', 'vz': 'vertical_speed'}.get(leaf, '')
    if not meaning.reason and not item.is_flag:
        item.remark = 'its message type does not tell the unit'
    if role is ROLES['height'] and not item.aside and _is_by_satellite(topic, path):
        item.aside = altitude_flaw(series)
    if series.share < 1.0 and '=' not in path:
        item.aside = item.aside or 'not every message has it'
    yield item


def _is_by_satellite(topic: TopicInspection, path: str) -> bool:
    """Tell whether a number stands beside a latitude."""
    place = path.rpartition('.')[0]
    return any(
        {'lat', 'latitude'} & set(words_of(other.rpartition('.')[2]))
        for other in topic.series
        if other.rpartition('.')[0] == place
    )


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
    largest = max(abs(series.low), abs(series.high))
    is_raw = role.unit == 'm/s' and largest > _MOST_SPEED
    # A position may be of whatever moves.
    is_raw |= role is ROLES['joint position'] and largest > MOST_ANGLE
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
    elements = list(elements_of(topic, path))
    # Elements with names are no axes.
    size = max(lengths) if f'{path}[0]' in topic.series else 0
    if len(lengths) == 1 and size == 4 and (order := _quaternion_order(topic, path)):
        yield from orientation_of(topic, path, 'motion', order=order)
    elif len(lengths) == 1 and size == 3 and not words & {'rpy', 'euler'} and _is_vector(words):
        yield from _vector(topic, path)
    elif words & {'rpy', 'euler'} and size == 3:
        tilt = entry_of(topic, 'tilt', f'{path}[0:2]|norm', 'tilt', 'motion')
        tilt.once, tilt.is_extra = 'tilt', True
        tilt.moves = any(series.high - series.low > 0.01 for _, series in elements[:2])
        tilt.remark = 'the norm of roll and pitch'
        if any(looks_like_degrees(series, MOST_ANGLE) for _, series in elements[:2]):
            tilt.aside = DEGREES
        yield tilt
    else:
        for place, _ in [*elements, *elements_of(topic, path, rare=True)]:
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
        item = entry_of(topic, 'turn_rate', f'{path}|norm', 'turn rate', kind)
        item.once = 'rotation'
        found.append(item)
    elif own & {'accelerometer'} or (is_change and 'angular' not in own):
        item = entry_of(topic, 'acceleration_norm', f'{path}|norm', 'acceleration', kind)
        item.once = 'acceleration_norm'
        found.append(item)
    elif own & {'velocity', 'vel', 'speed', 'linear', 'twist'} and not is_change:
        item = entry_of(topic, 'speed', f'{path}|norm', 'velocity', kind)
        climb = entry_of(topic, 'vertical_speed', z, 'vertical speed', kind)
        if down:
            climb.entry['transform'] = [{'scale': -1.0}]
        item.once, climb.once, climb.is_extra = 'speed', 'vertical_speed', True
        found += [item, climb]
    elif own & {'force', 'torque'}:
        part = 'force' if 'force' in own else 'torque'
        found.append(entry_of(topic, _name(topic, path), f'{path}|norm', part, 'force'))
    elif own & {'error'}:
        found.append(entry_of(topic, _name(topic, path), f'{path}|norm', 'error', 'error'))
    elif words & {'position', 'pos', 'point', 'odometry', 'pose', 'xyz', 'translation'}:
        height = entry_of(topic, 'altitude' if down else 'height', z, 'height', kind)
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
        item.moves = item.entry['field'].endswith('|norm') and vector_moves(topic, path)
        yield item


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
            for item in _number(topic, place, group=_name(topic, f'{path}.{found[1]}')):
                if item.role in _DYNAMIC:
                    item.coupled = f'{topic.name} {place.rpartition(".")[0]}'
                yield item


def _events(topic: TopicInspection, path: str) -> Iterator[Candidate]:
    """Yield how many dangers a list of them reports, of each kind that the type names."""
    kinds = _kinds_of(topic, path)
    for name, selector in kinds or [(topic.stem, '')]:
        item = entry_of(topic, name, f'{path}{selector}|count', 'flag', 'numbers')
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
