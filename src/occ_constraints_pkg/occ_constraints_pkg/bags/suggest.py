# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A first feature map for a recording: sensible features of the message types that robots use."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.bags.feature_map import FeatureMap
from occ_constraints_pkg.bags.recording import Recording
from occ_constraints_pkg.bags.survey import TopicSurvey, survey
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.bags.yields import FeatureYield, MapYield, inspect
from occ_constraints_pkg.errors import OccError

_SECTORS = 8
# A scan that covers at least this many degrees is taken to look all around.
_ALL_AROUND = 350.0
# A feature that is missing in a larger share of the rows is suggested in a comment only.
_MISSING_SHARE = 0.2
# Of a value that stays the same for this share of the recording, and this long, one should know.
_STILL_SHARE, _STILL_S = 0.3, 2.0
# Fewer messages say little about what is demonstrated.
_LEAST_MESSAGES = 10
# What changes by less is noise, for example of a simulation, and not a movement.
_NOISE = 0.002
_RESOLUTIONS = {'m/s': 0.01, 'rad/s': 0.01, 'm/s^2': 0.1, 'm': 0.01, 'rad': 0.01}
_NICE = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
# Columns of our own tables that are not sensors.
_STEP_COLUMNS = {'reward', 'terminated', 'truncated', 'episode', 'true_cost'}
_MOST_NUMBERS = 8
_COMMON = re.compile(r'(std|sensor|geometry|nav|trajectory|shape|stereo)_msgs/')
# What sets the pace, first choice first; what is not named here comes last.
_PACES = ('table', 'LaserScan', 'Odometry', 'Imu', 'Range', 'numbers', 'command')
# In which order they are written.
_ORDER = ('table', 'Odometry', 'LaserScan', 'Range', 'Imu', 'numbers', 'command')


@dataclass
class Candidate:
    """One entry of a suggested map.

    Attributes:
        entry: its keys.
        topic: where it comes from.
        kind: one of the kinds that may set the pace.
        aside: why it is written as a comment only; empty for an entry in use.
        remark: what a reader should know of it.
        seen: what its features were on the recording; empty if they could not be computed.
    """

    entry: dict[str, Any]
    topic: TopicSurvey
    kind: str
    aside: str = ''
    remark: str = ''
    seen: tuple[FeatureYield, ...] = ()

    @property
    def is_flag(self) -> bool:
        """Whether the field is a whole number or a flag by type, as that of a bumper."""
        return self.entry.get('field') in self.topic.integers


@dataclass(frozen=True)
class Suggestion:
    """A suggested map.

    Attributes:
        name: the recording's.
        pace: topic that sets the pace.
        max_age: seconds.
        candidates: entries in use and entries set aside.
        unused: topics of which no entry speaks.
        warnings: one sentence each.
        seen: what the entries in use yield on the recording.
    """

    name: str
    pace: TopicSurvey
    max_age: float
    candidates: tuple[Candidate, ...]
    unused: tuple[TopicSurvey, ...]
    warnings: tuple[str, ...]
    seen: MapYield


def suggest(
    recording: Recording, *, progress: Callable[[int, int], None] | None = None
) -> Suggestion:
    """Look through a recording and suggest features.

    Args:
        recording: what to read; twice.
        progress: called with (messages read, messages in all), for each reading anew.

    Raises:
        OccError: the recording is damaged, or has no topic of which a feature can be suggested.
    """
    topics = survey(recording, progress=progress)
    candidates = [item for topic in topics.values() for item in _candidates(topic)]
    candidates.sort(key=lambda item: _ORDER.index(item.kind))
    _set_aside(candidates)
    if not any(not item.aside for item in candidates):
        raise OccError(
            f'{recording.path} has no topic of which features can be suggested (velocities of an '
            'Odometry, ranges of a LaserScan, accelerations of an Imu, a Twist or a table, ten '
            'messages or more); its topics are '
            + ', '.join(f'{topic.name} ({topic.msgtype})' for topic in topics.values())
        )
    _rename(candidates)
    used = [item for item in candidates if not item.aside]
    _inspect(recording, candidates, *_alignment(used), progress)
    used = [item for item in candidates if not item.aside]
    if not used:
        reasons = '; '.join(f'{item.entry["name"]}: {item.aside}' for item in candidates)
        raise OccError(f'{recording.path} has no feature that can be used: {reasons}')
    pace, max_age = _alignment(used)
    seen = inspect(recording, _map(used, pace, max_age), progress=progress)
    named = {item.topic.name for item in candidates}
    return Suggestion(
        name=recording.name,
        pace=pace,
        max_age=max_age,
        candidates=tuple(candidates),
        unused=tuple(topic for name, topic in topics.items() if name not in named),
        warnings=(*recording.warnings, *_warnings(candidates, topics, pace, seen)),
        seen=seen,
    )


def _candidates(topic: TopicSurvey) -> Iterator[Candidate]:
    """Yield what the type of a topic suggests."""
    if not topic.decoded:
        return
    kind = topic.msgtype.rpartition('/')[2]
    recipe = _RECIPES.get(topic.msgtype)
    few = '' if topic.count >= _LEAST_MESSAGES else f'only {topic.count} messages'
    for item in recipe(topic) if recipe else _numbers(topic):
        item.kind = item.kind or (kind if kind in _ORDER else 'numbers')
        item.aside = item.aside or few
        yield item


def _entry(topic: TopicSurvey, name: str, field_path: str, unit: str, **more: Any) -> Candidate:
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': unit, **more}
    return Candidate(entry, topic, '')


def _odometry(topic: TopicSurvey) -> Iterator[Candidate]:
    yield _entry(topic, 'speed', 'twist.twist.linear.x', 'm/s')
    yield _entry(topic, 'side_speed', 'twist.twist.linear.y', 'm/s')
    turn = _entry(topic, 'turn_rate', 'twist.twist.angular.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    turn.remark = 'to the left or to the right alike; delete abs to tell them apart'
    yield turn
    change = _entry(topic, 'acceleration', 'twist.twist.linear.x', 'm/s^2', transform=['rate'])
    change.aside = 'the rate of change of a measured speed is noisy'
    yield change
    yield from _pose(topic, 'pose.pose')


def _pose(topic: TopicSurvey, path: str) -> Iterator[Candidate]:
    frame = ', '.join(sorted(topic.frames)) or '(none)'
    reason = (
        f'coordinates in the frame {frame!r}: rules about them hold in this place only, and from '
        'where the frame began' + (', and a map frame jumps' if 'map' in topic.frames else '')
    )
    for name, place, unit in (
        ('position_x', 'position.x', 'm'),
        ('position_y', 'position.y', 'm'),
        ('heading', 'orientation|yaw', 'rad'),
    ):
        item = _entry(topic, name, f'{path}.{place}', unit)
        item.aside = reason
        yield item


def _laser_scan(topic: TopicSurvey) -> Iterator[Candidate]:
    scan = topic.scan
    if scan is None:
        return
    count = max(min(_SECTORS, scan.least_beams // 2), 2)
    cap = _nice_below(min(scan.range_max, float(np.percentile(scan.openness, 10))))
    entry: dict[str, Any] = {'name': 'clearance', 'topic': topic.key, 'field': 'ranges'}
    if scan.last - scan.first + scan.step < _ALL_AROUND:
        # A little more on both sides, for the last beam is not to fall out of the last sector.
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
        remark += f' Of the ranges, {", ".join(shares)}: read as nothing in range.'
    yield Candidate(entry, topic, '', remark=remark)


def _imu(topic: TopicSurvey) -> Iterator[Candidate]:
    yield _entry(topic, 'acceleration_x', 'linear_acceleration.x', 'm/s^2')
    yield _entry(topic, 'acceleration_y', 'linear_acceleration.y', 'm/s^2')
    turn = _entry(topic, 'gyro_z', 'angular_velocity.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    yield turn


def _twist(topic: TopicSurvey) -> Iterator[Candidate]:
    path = 'twist.' if topic.msgtype.endswith('Stamped') else ''
    turn = _entry(topic, 'commanded_turn_rate', f'{path}angular.z', 'rad/s', transform=['abs'])
    turn.entry['bounds'] = [0, None]
    for item in (_entry(topic, 'commanded_speed', f'{path}linear.x', 'm/s'), turn):
        item.kind = 'command'
        yield item


def _range(topic: TopicSurvey) -> Iterator[Candidate]:
    name = re.sub(r'\W', '_', topic.key.rpartition('/')[2])
    top = float(topic.sample.max_range)
    item = _entry(topic, f'range_{name}', 'range', 'm', missing='max_range')
    if 0.0 < top < math.inf:
        item.entry['transform'] = [{'clip': [0, top]}]
        item.entry['bounds'] = [0, top]
    item.remark = 'nothing in range counts as the greatest range'
    yield item


def _point_cloud(topic: TopicSurvey) -> Iterator[Candidate]:
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


def _numbers(topic: TopicSurvey) -> Iterator[Candidate]:
    """Yield the numbers of a small message of another type."""
    if not 0 < len(topic.numbers) <= _MOST_NUMBERS:
        return
    stem = re.sub(r'\W', '_', topic.key.rpartition('/')[2])
    for path in topic.numbers:
        leaf = path.replace('.', '_')
        name = leaf if leaf.startswith(stem) else f'{stem}_{leaf}'
        item = _entry(topic, name, path, '1')
        item.kind = 'numbers'
        item.remark = 'of a type that is not known here: see to the unit'
        if _COMMON.match(topic.msgtype):
            item.aside = f'a {topic.msgtype} may mean anything'
        yield item


_RECIPES: dict[str, Callable[[TopicSurvey], Iterator[Candidate]]] = {
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


def _set_aside(candidates: Sequence[Candidate]) -> None:
    """Set aside what says again what another entry says better."""
    first: dict[str, str] = {}
    for item in sorted(candidates, key=lambda item: (len(item.topic.name), item.topic.name)):
        if item.kind in ('LaserScan', 'Odometry', 'command', 'Imu') and not item.aside:
            chosen = first.setdefault(item.kind, item.topic.name)
            if chosen != item.topic.name:
                item.aside = f'{chosen} is used instead'
    tables = {item.topic.name: item.topic for item in candidates if item.kind == 'table'}
    richest = max(tables, key=lambda name: len(tables[name].sample.fields), default='')
    kinds = {item.kind for item in candidates if not item.aside}
    for item in candidates:
        if item.aside:
            continue
        if item.kind == 'table' and item.topic.name != richest:
            item.aside = f'the table {richest} is used instead'
        if item.kind == 'command' and kinds & {'Odometry', 'table'}:
            item.aside = (
                'what was commanded; commands end when nobody drives, and a value that is missing '
                'makes the verdict UNKNOWN'
            )
        elif item.entry['name'] == 'gyro_z' and 'Odometry' in kinds:
            item.aside = 'turn_rate of the odometry is used instead'


def _rename(candidates: Sequence[Candidate]) -> None:
    """Make names unique by the names of topics, those set aside included."""
    names = [item.entry['name'] for item in candidates]
    taken: set[str] = set()
    for item in sorted(candidates, key=lambda item: bool(item.aside)):
        name = item.entry['name']
        if names.count(name) > 1 and name in taken:
            name = f'{name}_{re.sub(r"[^A-Za-z0-9]+", "_", item.topic.key)}'
        while name in taken:
            name += '_2'
        taken.add(name)
        item.entry['name'] = name


def _alignment(used: Sequence[Candidate]) -> tuple[TopicSurvey, float]:
    """Choose the topic that sets the pace, and after how many s a held value is too old.

    That is twice the longest usual time between messages, within 0.2 to 2 s.
    """
    pace = min(used, key=lambda item: (_PACES.index(item.kind), item.topic.name)).topic
    longest = [item.topic.slow_period_s for item in used if item.topic.slow_period_s > 0.0]
    twice = 2.0 * max(longest, default=0.25)
    return pace, min(max(math.ceil(twice * 10.0) / 10.0, 0.2), 2.0)


def _map(used: Sequence[Candidate], pace: TopicSurvey, max_age: float) -> FeatureMap:
    document = {
        'schema_version': 1,
        'pace': pace.key,
        'max_age': max_age,
        'features': [item.entry for item in used],
    }
    return FeatureMap.from_document(document, 'the suggested map')


def _inspect(
    recording: Recording,
    candidates: Sequence[Candidate],
    pace: TopicSurvey,
    max_age: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Look at each candidate's values; set aside what cannot be used, and choose resolutions."""
    readable = []
    for item in candidates:
        # A table as the pace has rows for several robots; other tables hardly fit to it.
        if item.kind != 'table' or item.topic is pace:
            readable.append(item)
    yields = inspect(recording, _map(readable, pace, max_age), progress=progress).features
    at = 0
    for item in readable:
        size = item.entry.get('sectors', 1)
        item.seen, at = yields[at : at + size], at + size
        if not item.aside:
            item.aside = _flaw(item)
        if item.kind == 'Range':
            _cap(item)
        elif item.is_flag and item.seen[0].low >= 0.0:
            item.entry['bounds'] = [0, None]
        elif size == 1 and item.kind != 'table':
            _round(item)


def _flaw(item: Candidate) -> str:
    """Say why the values of a candidate cannot be used; nothing if they can."""
    missing = max(seen.missing + seen.outside for seen in item.seen)
    if missing > _MISSING_SHARE:
        return f'missing in {missing:.0%} of the rows'
    if item.is_flag:
        return ''
    if len(item.seen) > 1:
        is_stuck = all(seen.is_constant and seen.low < seen.source.high for seen in item.seen)
        return 'constant in every sector' if is_stuck else ''
    seen = item.seen[0]
    least = 0.0 if item.kind == 'table' else _RESOLUTIONS.get(item.entry['unit'], _NOISE)
    if seen.high - seen.low <= least:
        return f'constant at {seen.median:.3g}' + (f' within {least:g}' if least else '')
    return ''


def _cap(item: Candidate) -> None:
    """Make all that is further off than usual the same, so that no rule forbids open space."""
    seen = item.seen[0]
    cap = _nice_below((seen.median + seen.high) / 2.0)
    if math.isfinite(seen.high) and 'bounds' in item.entry:
        item.entry |= {'transform': [{'clip': [0, cap]}], 'bounds': [0, cap]}
        item.remark += f', and more than {cap:g} m as {cap:g} m'


def _round(item: Candidate) -> None:
    """Give a measured quantity a resolution, so that no bound is a matter of noise."""
    seen = item.seen[0]
    span = seen.high - seen.low
    steps = item.entry.get('transform', [])
    if not span > _NOISE or any(isinstance(step, dict) for step in steps):
        return
    step = _RESOLUTIONS.get(item.entry['unit'])
    if step is None:
        step = float(f'1e{math.floor(math.log10(span / 50.0))}')
    item.entry['transform'] = [*steps, {'round': step}]


def _nice_below(value: float) -> float:
    """Return the largest nice number that is not above ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    # Single-precision ranges lie a little below the number that is meant.
    found = [nice * power for nice in _NICE if nice * power <= value * (1.0 + 1e-6)]
    return float(f'{max(found, default=power):.6g}')


def _warnings(
    candidates: Sequence[Candidate],
    topics: dict[str, TopicSurvey],
    pace: TopicSurvey,
    seen: MapYield,
) -> Iterator[str]:
    used = {item.topic.name for item in candidates if not item.aside}
    for name, topic in topics.items():
        if topic.problem:
            yield topic.problem
        if name not in used:
            continue
        if topic.jumps:
            times = 'once' if topic.jumps == 1 else f'{topic.jumps} times'
            yield (
                f'the stamps of {name} go back {times}, first {topic.first_jump_s:.1f} s after '
                'its first message'
            )
        if not topic.is_stamped:
            what = 'it sets the pace all the same' if topic is pace else 'its age goes by arrival'
            yield f'the messages of {name} have no time stamp; {what}'
        if 'map' in topic.frames and hasattr(topic.sample, 'pose'):
            yield (
                f'the poses of {name} are in the frame map, which jumps when the robot finds out '
                'better where it is; they are not used'
            )
        below = 0.0 if topic.scan is None else topic.scan.counts[3] / topic.scan.counts[4]
        if below > 0.0:
            yield (
                f'{below:.0%} of the ranges of {name} lie below its range_min; they are taken as '
                'they are, for something may be that close'
            )
    for item in candidates:
        for part in () if item.aside or item.is_flag else item.seen:
            is_still = part.longest_still_s > max(_STILL_S, _STILL_SHARE * seen.duration_s)
            if is_still:
                yield (
                    f'{part.source.name} did not change for {part.longest_still_s:.1f} s: steady, '
                    'or a frozen source'
                )
