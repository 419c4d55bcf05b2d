# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Candidates: entries of a suggested map, in use or set aside, and how they are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.suggestion.inspection import Series, TopicInspection
from occ_constraints_pkg.suggestion.meanings import ROLES, Role
from occ_constraints_pkg.suggestion.statistics import FeatureStatistics

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
MOST_ANGLE = 7.0
DEGREES = 'its values look like degrees; allowed is SI, which a step {scale: 0.0174533} makes'


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
        coupled: a joint or sensor whose dynamics tie this to all else with the same word here.
        once: of candidates with the same word here, one is used.
        replaced_by: the candidate that is used instead.
        part_of: what another candidate, with this word in ``once``, tells as well.
        moves: whether a vector changes, be its length as it may.
        is_unreadable: whether some message does not allow to read it.
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
    coupled: str = ''
    once: str = ''
    replaced_by: Candidate | None = None
    part_of: str = ''
    moves: bool = False
    is_unreadable: bool = False
    is_extra: bool = False
    is_flag: bool = False
    is_doubtful: bool = False
    is_brief: bool = False
    is_dull: bool = False
    family_seen: tuple[FeatureStatistics, ...] = ()
    name: str = ''

    @property
    def slow_period_s(self) -> float:
        """The longest usual time between messages that have it."""
        series = self.topic.series.get(str(self.entry.get('field')))
        return self.topic.slow_period_s / (1.0 if series is None else series.share)

    def __post_init__(self) -> None:
        self.name = self.name or self.entry['name']


def entry_of(
    topic: TopicInspection, name: str, field_path: str, role: str, kind: str, **more: Any
) -> Candidate:
    """Return a candidate whose role decides on steps and bounds."""
    what = ROLES[role]
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': what.unit, **more}
    return Candidate(entry, topic, kind, role=what)


def plain_entry(
    topic: TopicInspection, name: str, field_path: str, unit: str, kind: str, **more: Any
) -> Candidate:
    """Return a candidate whose steps the values alone decide."""
    entry = {'name': name, 'topic': topic.key, 'field': field_path, 'unit': unit, **more}
    return Candidate(entry, topic, kind)


def elements_of(
    topic: TopicInspection, path: str, *, rare: bool = False
) -> Iterator[tuple[str, Series]]:
    """Yield the elements of an array of numbers that were seen, by their paths.

    Args:
        topic: what was seen of it.
        path: of the array.
        rare: yield those by number that are not in every message, instead of the others; those by
            name need not be.
    """
    for place, series in topic.series.items():
        if rare is not (series.share < 1.0 and '=' not in place):
            continue
        if place.startswith(f'{path}[') and place.endswith(']') and '.' not in place[len(path) :]:
            yield place, series


def label_of(place: str) -> str:
    """Return what stands in the last brackets, without the name of the list of names."""
    return place[place.rindex('[') + 1 : -1].rpartition('=')[2]


def vector_moves(topic: TopicInspection, path: str) -> bool:
    """Tell whether some part of a vector changes by more than noise."""
    return any(
        series.high - series.low > 0.01
        for place, series in topic.series.items()
        if place.startswith((f'{path}[', f'{path}.'))
    )


def looks_like_degrees(series: Series, most: float) -> bool:
    """Tell whether values are above ``most`` rad as a rule, and not above two turns in degrees."""
    finite = series.finite
    return bool(finite.size) and most < float(np.percentile(np.abs(finite), 99)) <= 720.0
