# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A first feature map for a recording: sensible features of the message types that robots use."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.heuristics import KINDS, Candidate, candidates_of, nice_below
from occ_constraints_pkg.suggestion.inspection import TopicInspection, inspect_topics
from occ_constraints_pkg.suggestion.statistics import MapStatistics, map_statistics

# A feature that is missing in a larger share of the rows is suggested in a comment only.
_MISSING_SHARE = 0.2
# A value constant for this share of the recording, and for so many seconds, is warned of.
_STILL_SHARE, _STILL_S = 0.3, 2.0
# What changes by less is noise, for example of a simulation, and not a movement.
_NOISE = 0.002
_RESOLUTIONS = {'m/s': 0.01, 'rad/s': 0.01, 'm/s^2': 0.1, 'm': 0.01, 'rad': 0.01}
# Which kind of topic becomes the trigger topic, first choice first.
_PACES = ('table', 'LaserScan', 'Odometry', 'Imu', 'Range', 'numbers', 'command')


@dataclass(frozen=True)
class Suggestion:
    """A suggested map.

    Attributes:
        name: the recording's.
        pace: the trigger topic.
        max_age: seconds.
        candidates: entries in use and entries set aside.
        unused: topics without an entry.
        warnings: one sentence each.
        seen: statistics of the entries in use on the recording.
    """

    name: str
    pace: TopicInspection
    max_age: float
    candidates: tuple[Candidate, ...]
    unused: tuple[TopicInspection, ...]
    warnings: tuple[str, ...]
    seen: MapStatistics


def suggest(
    recording: Recording, *, progress: Callable[[int, int], None] | None = None
) -> Suggestion:
    """Inspect a recording and suggest features.

    Args:
        recording: it is read three times.
        progress: called with (messages read, messages in all), for each reading anew.

    Raises:
        OccError: the recording is damaged, or has no topic of which a feature can be suggested.
    """
    topics = inspect_topics(recording, progress=progress)
    candidates = [item for topic in topics.values() for item in candidates_of(topic)]
    candidates.sort(key=lambda item: KINDS.index(item.kind))
    _set_aside(candidates)
    if not any(not item.aside for item in candidates):
        raise DataError(
            f'{recording.path} has no topic of which features can be suggested (velocities of an '
            'Odometry, ranges of a LaserScan, accelerations of an Imu, a Twist or a table, ten '
            'messages or more); its topics are '
            + ', '.join(f'{topic.name} ({topic.msgtype})' for topic in topics.values())
        )
    _rename(candidates)
    used = [item for item in candidates if not item.aside]
    _assess(recording, candidates, *_alignment(used), progress)
    used = [item for item in candidates if not item.aside]
    if not used:
        reasons = '; '.join(f'{item.entry["name"]}: {item.aside}' for item in candidates)
        raise DataError(f'{recording.path} has no feature that can be used: {reasons}')
    pace, max_age = _alignment(used)
    seen = map_statistics(recording, _map(used, pace, max_age), progress=progress)
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


def _set_aside(candidates: Sequence[Candidate]) -> None:
    """Set aside entries that another one replaces."""
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
                'commands stop when nobody drives, and a missing value makes the verdict UNKNOWN'
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


def _alignment(used: Sequence[Candidate]) -> tuple[TopicInspection, float]:
    """Choose the trigger topic, and after how many seconds a latest value is too old.

    That is twice the longest usual time between messages, within 0.2 to 2 s.
    """
    pace = min(used, key=lambda item: (_PACES.index(item.kind), item.topic.name)).topic
    longest = [item.topic.slow_period_s for item in used if item.topic.slow_period_s > 0.0]
    twice = 2.0 * max(longest, default=0.25)
    return pace, min(max(math.ceil(twice * 10.0) / 10.0, 0.2), 2.0)


def _map(used: Sequence[Candidate], pace: TopicInspection, max_age: float) -> FeatureMap:
    document = {
        'schema_version': 1,
        'pace': pace.key,
        'max_age': max_age,
        'features': [item.entry for item in used],
    }
    return FeatureMap.from_document(document, 'the suggested map')


def _assess(
    recording: Recording,
    candidates: Sequence[Candidate],
    pace: TopicInspection,
    max_age: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Set aside candidates whose values cannot be used, and choose resolutions."""
    readable = []
    for item in candidates:
        # A table as the pace has rows for several robots; other tables hardly fit to it.
        if item.kind != 'table' or item.topic is pace:
            readable.append(item)
    found = map_statistics(recording, _map(readable, pace, max_age), progress=progress).features
    at = 0
    for item in readable:
        size = item.entry.get('sectors', 1)
        item.seen, at = found[at : at + size], at + size
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
    cap = nice_below((seen.median + seen.high) / 2.0)
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


def _warnings(
    candidates: Sequence[Candidate],
    topics: dict[str, TopicInspection],
    pace: TopicInspection,
    seen: MapStatistics,
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
                f'the stamps of {name} jump back {times}, first {topic.first_jump_s:.1f} s after '
                'its first message'
            )
        if not topic.is_stamped:
            what = (
                'it is the trigger topic all the same'
                if topic is pace
                else 'their age is that of their arrival'
            )
            yield f'the messages of {name} have no time stamp; {what}'
        if 'map' in topic.frames and hasattr(topic.sample, 'pose'):
            yield (
                f'the poses of {name} are in the frame map, which jumps when the robot '
                'relocalizes; they are not used'
            )
        below = 0.0 if topic.scan is None else topic.scan.counts[3] / topic.scan.counts[4]
        if below > 0.0:
            yield (
                f'{below:.0%} of the ranges of {name} lie below its range_min; they are kept, '
                'because something may be that close'
            )
    for item in candidates:
        for part in () if item.aside or item.is_flag else item.seen:
            is_still = part.longest_still_s > max(_STILL_S, _STILL_SHARE * seen.duration_s)
            if is_still:
                yield (
                    f'{part.source.name} did not change for {part.longest_still_s:.1f} s: it is '
                    'steady, or its source is frozen'
                )
