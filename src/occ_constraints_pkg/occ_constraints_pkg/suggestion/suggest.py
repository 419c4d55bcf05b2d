# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A first feature map for recordings: sensible features of what robots measure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.bounds import (
    NOISE,
    RESOLUTIONS,
    is_hardly_known,
    settle_bounds,
)
from occ_constraints_pkg.suggestion.candidate import KINDS, Candidate
from occ_constraints_pkg.suggestion.doubts import clock_doubts_of, some_of, value_doubts_of
from occ_constraints_pkg.suggestion.families import form_families
from occ_constraints_pkg.suggestion.inspection import (
    TopicInspection,
    identifier,
    inspect_topics,
    merged,
)
from occ_constraints_pkg.suggestion.meanings import is_turning, words_of
from occ_constraints_pkg.suggestion.robots import robots_of
from occ_constraints_pkg.suggestion.statistics import (
    FeatureStatistics,
    MapRows,
    MapStatistics,
    joint_statistics,
    map_rows,
)
from occ_constraints_pkg.suggestion.structure import candidates_of
from occ_constraints_pkg.suggestion.tracking import tracking_errors

# A feature that is missing in a larger share of the rows is suggested in a comment only.
_MISSING_SHARE = 0.2
# A difference of two topics needs both.
_MISSING_ERROR_SHARE = 0.005
# A value constant for this share of the recording, and for so many seconds, is warned of.
_STILL_SHARE, _STILL_S = 0.3, 2.0
# Which kind of topic becomes the trigger topic, first choice first.
_PACES = (
    *('table', 'LaserScan', 'Odometry', 'joints', 'Imu', 'pose', 'velocity', 'motion', 'force'),
    *('Range', 'error', 'numbers', 'position', 'battery', 'command'),
)
# Where one of these is measured, commands are comments; those of unknown types beside anything.
_MOTION = {'table', 'Odometry', 'velocity', 'motion', 'joints'}
_OTHERS = set(KINDS) - {'command'}
# Of several Imus, that of the body is used, not that of a part that moves by itself.
_LIMBS = {
    *('left', 'right', 'head', 'foot', 'hand', 'arm', 'leg', 'wrist', 'ankle', 'gripper'),
    *('camera', 'cam', 'mount', 'gimbal'),
}
# Slower topics have an age of their own.
_SLOW_S = 0.5
# A second recording outside of what the first shows for more than this share of its rows is told.
_STRANGE_SHARE = 0.02


@dataclass(frozen=True)
class Suggestion:
    """A suggested map.

    Attributes:
        name: the recordings'.
        robot: namespace of the robot; empty for the only one.
        pace: the trigger topic; None if no topic has a message.
        max_age: seconds.
        candidates: entries in use and entries set aside.
        unused: topics without an entry, and why each has none.
        warnings: one sentence each.
        seen: statistics of the entries in use on all recordings.
    """

    name: str
    robot: str
    pace: TopicInspection | None
    max_age: float
    candidates: tuple[Candidate, ...]
    unused: tuple[tuple[TopicInspection, str], ...]
    warnings: tuple[str, ...]
    seen: MapStatistics

    @property
    def used(self) -> list[Candidate]:
        """The entries in use."""
        return [item for item in self.candidates if not item.aside]


def suggest(
    *recordings: Recording, progress: Callable[[int, int], None] | None = None
) -> Suggestion:
    """Inspect recordings of one robot and suggest features; of several robots, of the first.

    Args:
        recordings: they are used together; each is read three times.
        progress: called with (messages read, messages in all), for each reading anew.

    Raises:
        OccError: a recording is damaged.
    """
    return suggest_each(*recordings, progress=progress)[0]


def suggest_each(
    *recordings: Recording, progress: Callable[[int, int], None] | None = None
) -> list[Suggestion]:
    """Inspect recordings and suggest features, in one map for each robot.

    Args and Raises: see :func:`suggest`.
    """
    inspections = [inspect_topics(recording, progress=progress) for recording in recordings]
    topics = merged(inspections, [recording.name for recording in recordings])
    robots = robots_of(topics)
    if not robots:
        return [_suggest(recordings, topics, '', progress)]
    found = []
    for robot, names in robots.items():
        others = {name for group in robots.values() for name in group} - set(names)
        own = {name: topic for name, topic in topics.items() if name not in others}
        found.append(_suggest(recordings, own, robot, progress))
    return found


def _suggest(
    recordings: Sequence[Recording],
    topics: dict[str, TopicInspection],
    robot: str,
    progress: Callable[[int, int], None] | None,
) -> Suggestion:
    candidates = [
        item
        for topic in topics.values()
        if not robot or topic.name.startswith(f'/{robot}/')
        for item in candidates_of(topic)
    ]
    candidates += tracking_errors(candidates)
    candidates.sort(key=lambda item: KINDS.index(item.kind))
    _set_aside(candidates)
    _rename(candidates)
    used = [item for item in candidates if not item.aside]
    if used:
        _assess(recordings, candidates, progress)
        candidates = _ordered(
            [item for item in candidates if not (item.aside and item.is_extra and item.is_dull)]
        )
        _rename(candidates)
        used = [item for item in candidates if not item.aside]
    pace: TopicInspection | None
    while used:
        pace, max_age = _alignment(used)
        feature_map = _map(used, pace, max_age)
        rows = [map_rows(item, feature_map, progress=progress) for item in recordings]
        seen = joint_statistics(rows)
        told, changed = _compare(used, rows, [item.name for item in recordings])
        if not changed:
            break
        used = [item for item in used if not item.aside]
    else:
        seen, told = MapStatistics(0, 0.0, 0.0, 0, (), ()), []
        pace, max_age = next((topic for topic in topics.values() if topic.count), None), 0.5
        if candidates:
            # For whoever uses one of them all the same.
            pace, max_age = _alignment(candidates)
    named = {item.topic.name for item in candidates}
    return Suggestion(
        name=', '.join(recording.name for recording in recordings),
        robot=robot,
        pace=pace,
        max_age=max_age,
        candidates=tuple(candidates),
        unused=tuple(
            (topic, _reason(topic, robot)) for name, topic in topics.items() if name not in named
        ),
        warnings=(
            *(sentence for recording in recordings for sentence in recording.warnings),
            *_warnings(used, topics, pace, seen),
            *told,
        ),
        seen=seen,
    )


def _ordered(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with the members of a family one after the other."""
    first: dict[str, int] = {}
    for place, item in enumerate(candidates):
        first.setdefault(item.entry.get('family', item.entry['name']), place)
    return sorted(candidates, key=lambda item: first[item.entry.get('family', item.entry['name'])])


def _reason(topic: TopicInspection, robot: str) -> str:
    """Say why a topic has no entry."""
    if topic.silence:
        return topic.silence
    if robot and not topic.name.startswith(f'/{robot}/'):
        return 'it is in the namespace of no robot'
    if topic.series:
        return 'none of its numbers is known to tell a danger'
    if topic.msgtype == 'sensor_msgs/msg/PointCloud2':
        return 'a cloud of points; a LaserScan can be made of it, with clearances'
    if any(max(lengths) for lengths in topic.lengths.values()):
        return 'it has arrays only, too long or of varying length'
    return 'it has no number' + ', only text' * topic.msgtype.endswith('/String')


def _set_aside(candidates: Sequence[Candidate]) -> None:
    """Set aside entries that another one replaces."""
    ordered = sorted(
        candidates,
        key=lambda item: (
            item.kind == 'Imu' and bool(_LIMBS & set(words_of(item.topic.name))),
            len(item.topic.name),
            item.topic.name,
        ),
    )
    first: dict[str, str] = {}
    for item in ordered:
        if item.kind in ('LaserScan', 'Odometry', 'command', 'Imu') and not item.aside:
            chosen = first.setdefault(item.kind, item.topic.name)
            if chosen != item.topic.name and item.kind != 'command':
                item.aside = f'{chosen} is used instead'
    once: dict[str, Candidate] = {}
    for item in sorted(ordered, key=lambda item: KINDS.index(item.kind)):
        if item.once and not item.aside:
            chosen_item = once.setdefault(item.once, item)
            if chosen_item is not item:
                item.aside = f'{item.once} of {chosen_item.topic.name} is used instead'
                item.replaced_by = chosen_item
    for item in candidates:
        if item.part_of in once and not item.aside:
            item.aside = f'{item.part_of} of {once[item.part_of].topic.name} is used instead'
    tables = {item.topic.name: item.topic for item in candidates if item.kind == 'table'}
    richest = max(tables, key=lambda name: len(tables[name].sample.fields), default='')
    kinds = {item.kind for item in candidates if not item.aside}
    for item in candidates:
        if item.aside:
            continue
        if item.kind == 'table' and item.topic.name != richest:
            item.aside = f'the table {richest} is used instead'
        if item.kind == 'command' and kinds & (_OTHERS if item.is_brief else _MOTION):
            item.aside = (
                'commands stop when nobody drives, and a missing value makes the verdict UNKNOWN'
            )
        elif item.kind == 'command' and first['command'] != item.topic.name:
            item.aside = f'{first["command"]} is used instead'
        elif item.once == 'gyro_z' and 'Odometry' in kinds:
            item.aside = 'turn_rate of the odometry is used instead'
        elif item.group == 'velocity' and 'Odometry' in kinds and is_turning(item.name):
            item.aside = 'speed and turn_rate of the odometry tell it'


def _rename(candidates: Sequence[Candidate]) -> None:
    """Make names unique by the names of topics, those set aside included."""
    names = [item.name for item in candidates]
    taken: set[str] = set()
    for item in sorted(candidates, key=lambda item: bool(item.aside)):
        name = item.name
        if names.count(name) > 1 and name in taken:
            name = f'{name}_{identifier(item.topic.key)}'
        while name in taken:
            name += '_2'
        taken.add(name)
        item.entry['name'] = name


def _alignment(
    used: Sequence[Candidate], pace: TopicInspection | None = None
) -> tuple[TopicInspection, float]:
    """Choose the trigger topic, and after how many seconds a latest value is too old.

    That is twice the longest usual time between messages, from 0.2 s on; topics that are slow get
    an age of their own. Topics whose stamps are of another clock are aged by arrival.
    """
    pace = (
        pace
        or min(
            used,
            key=lambda item: (
                _PACES.index(item.kind),
                'minus' in item.entry,
                item.topic.slow_period_s > _SLOW_S,
                item.topic.name,
            ),
        ).topic
    )
    periods = [item.slow_period_s for item in used]
    quick = [period for period in periods if 0.0 < period <= _SLOW_S]
    max_age = max(_twice(max(quick, default=0.25)), 0.2)
    for item in used:
        for key in ('max_age', 'age_by'):
            item.entry.pop(key, None)
        if item.topic is pace:
            continue
        if item.slow_period_s > _SLOW_S:
            item.entry['max_age'] = _twice(item.slow_period_s)
        if abs(item.topic.offset_s - pace.offset_s) > item.entry.get('max_age', max_age):
            item.entry['age_by'] = 'arrival'
    return pace, max_age


def _twice(period: float) -> float:
    return math.ceil(2.0 * period * 10.0) / 10.0


def _map(used: Sequence[Candidate], pace: TopicInspection, max_age: float) -> FeatureMap:
    document = {
        'schema_version': 1,
        'pace': pace.key,
        'max_age': max_age,
        'features': [item.entry for item in used],
    }
    return FeatureMap.from_document(document, 'the suggested map')


def _columns(item: Candidate, feature_map: FeatureMap) -> list[int]:
    """Return which features of a map an entry gives; sectors give several."""
    name = item.entry['name']
    key = 'family' if 'sectors' in item.entry else 'name'
    return [
        place for place, feature in enumerate(feature_map.features) if getattr(feature, key) == name
    ]


def _assess(
    recordings: Sequence[Recording],
    candidates: Sequence[Candidate],
    progress: Callable[[int, int], None] | None,
) -> None:
    """Set aside candidates whose values cannot be used; choose families and resolutions."""
    pace, _ = _alignment([item for item in candidates if not item.aside])
    readable = [
        item
        for item in candidates
        # A table as the pace has rows for several robots; other tables hardly fit to it.
        if (item.kind != 'table' or item.topic is pace)
        # Of what the structure of a message gives, that is all there is to say.
        and not (item.aside and item.is_brief)
        # A rate is computed row by row, which takes long, and is only ever a comment.
        and 'rate' not in item.entry.get('transform', ())
    ]
    try:
        feature_map, found = _seen(recordings, readable, pace, progress)
    except OccError:
        _set_unreadable_aside(recordings, readable)
        readable = [item for item in readable if not item.is_unreadable]
        used = [item for item in readable if not item.aside]
        if not used:
            return
        pace, _ = _alignment(used)
        feature_map, found = _seen(recordings, readable, pace, progress)
    for item in readable:
        columns = _columns(item, feature_map)
        item.seen = tuple(features[column] for features in found for column in columns)
        if not item.aside:
            item.aside, item.is_dull = _flaw(item)
    _put_back(readable)
    form_families([item for item in readable if not item.aside and item.group])
    for item in readable:
        if not item.aside:
            settle_bounds(item)


def _seen(
    recordings: Sequence[Recording],
    readable: Sequence[Candidate],
    pace: TopicInspection,
    progress: Callable[[int, int], None] | None,
) -> tuple[FeatureMap, list[tuple[FeatureStatistics, ...]]]:
    """Return a map of candidates, and the statistics of its features on each recording."""
    feature_map = _map(readable, *_alignment(readable, pace))
    return feature_map, [
        map_rows(recording, feature_map, progress=progress).statistics().features
        for recording in recordings
    ]


def _set_unreadable_aside(recordings: Sequence[Recording], candidates: Sequence[Candidate]) -> None:
    """Set aside what some message does not allow to be read, such as an array that is too short."""
    for topic in {item.topic.name: item.topic for item in candidates}.values():
        for recording in recordings:
            _halve(recording, [item for item in candidates if item.topic is topic])


def _halve(recording: Recording, candidates: Sequence[Candidate]) -> None:
    """Set aside those of a topic's candidates that cannot be read from a recording."""
    left = [item for item in candidates if not item.is_unreadable]
    try:
        if left:
            map_rows(recording, _map(left, *_alignment(left)))
    except OccError as error:
        if len(left) > 1:
            _halve(recording, left[: len(left) // 2])
            _halve(recording, left[len(left) // 2 :])
        else:
            left[0].is_unreadable, left[0].aside = True, left[0].aside or str(error)


def _put_back(candidates: Sequence[Candidate]) -> None:
    """Use what was set aside for another candidate that cannot be used after all."""
    back: set[str] = set()
    for item in candidates:
        if item.replaced_by is not None and item.replaced_by.aside and item.once not in back:
            item.aside, item.is_dull = _flaw(item)
            if not item.aside:
                back.add(item.once)


def _flaw(item: Candidate) -> tuple[str, bool]:
    """Say why the values of a candidate cannot be used, and whether that is because they rest."""
    missing = max(seen.missing + seen.outside for seen in item.seen)
    if missing > (_MISSING_ERROR_SHARE if 'minus' in item.entry else _MISSING_SHARE):
        return f'missing in {missing:.0%} of the rows', False
    if item.is_flag:
        return '', False
    if 'sectors' in item.entry:
        is_stuck = all(seen.is_constant and seen.low < seen.source.high for seen in item.seen)
        return ('constant in every sector', True) if is_stuck else ('', False)
    low, high = min(seen.low for seen in item.seen), max(seen.high for seen in item.seen)
    least = 0.0 if item.kind == 'table' else RESOLUTIONS.get(item.entry['unit'], NOISE)
    if item.role is not None and (not item.role.resolution or item.moves):
        least = 0.0
    if not high - low > least:
        within = f' within {least:g}' if least else ''
        return f'constant at {item.seen[0].median:.3g}{within}', True
    return '', False


def _compare(
    used: Sequence[Candidate], rows: Sequence[MapRows], names: Sequence[str]
) -> tuple[list[str], bool]:
    """Tell what would be flagged in one recording by the others; set aside mere offsets.

    Returns:
        A sentence for each feature of which one recording shows more, and whether something was
        set aside.
    """
    told, changed = [], False
    for item in used:
        places = _columns(item, rows[0].feature_map)
        columns = [part.values[:, places] for part in rows]
        # Of each recording that the first would flag: the share of its rows, and in words.
        strangers: list[tuple[float, str]] = []
        for number, (own, name) in enumerate(zip(columns, names, strict=True)):
            first = columns[0] if number else None
            if first is None or not (np.isfinite(first).any() and np.isfinite(own).any()):
                continue
            low, high = np.nanmin(first), np.nanmax(first)
            span, other = high - low, np.nanmax(own) - np.nanmin(own)
            strange = float(((own < low) | (own > high)).any(axis=1).mean())
            if strange <= _STRANGE_SHARE:
                continue
            what = (
                f'{item.entry["name"]} lies outside of what {names[0]} shows ({low:.4g} to '
                f'{high:.4g}) for {strange:.0%} of the rows of {name} ({np.nanmin(own):.4g} to '
                f'{np.nanmax(own):.4g})'
            )
            shift = abs(float(np.nanmedian(own)) - float(np.nanmedian(first)))
            drains = item.role is not None and item.role.left > 0.0
            if not drains and shift > max(span, other) and 0.5 * span <= other <= 2.0 * span:
                item.aside, changed = f'{what}: it differs by an offset only', True
                break
            strangers.append((strange, what))
        if strangers and not item.aside:
            told.append(_strangeness(strangers))
    return told, changed


def _strangeness(strangers: Sequence[tuple[float, str]]) -> str:
    """Return one sentence for a feature, about the recording of which most rows are strange."""
    _, what = max(strangers, key=lambda stranger: stranger[0])
    others = len(strangers) - 1
    if not others:
        return f'{what}; learn from both, or leave it out'
    rest = f'{others} other recordings' if others > 1 else 'another recording'
    return f'{what}, and for no more of {rest}; learn from all, or leave it out'


def _warnings(
    used: Sequence[Candidate],
    topics: dict[str, TopicInspection],
    pace: TopicInspection | None,
    seen: MapStatistics,
) -> Iterator[str]:
    names = {item.topic.name for item in used}
    for name, topic in topics.items():
        if topic.problem:
            yield topic.problem
        elif topic.decoded:
            yield from value_doubts_of(topic)
        if name not in names:
            continue
        yield from clock_doubts_of(topic, pace)
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
    few = [item.entry['name'] for item in used if is_hardly_known(item)]
    if few:
        yield (
            f'{some_of(few)} {"goes" if len(few) == 1 else "go"} to and fro too seldom to know '
            'how far: record longer, or give more recordings, before anything is learned'
        )
    for item in used:
        # As read, for a resolution makes a steady value of one that hardly changes.
        for part in () if item.is_flag else item.seen:
            if part.longest_still_s > max(_STILL_S, _STILL_SHARE * seen.duration_s):
                yield (
                    f'{part.source.name} did not change for {part.longest_still_s:.1f} s: it is '
                    'steady, or its source is frozen'
                )
