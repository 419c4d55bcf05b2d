# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors that lie: what about a topic's numbers and clocks cannot be as it should."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from occ_constraints_pkg.suggestion.inspection import LEAST_MESSAGES, TopicInspection
from occ_constraints_pkg.suggestion.meanings import is_command, is_turning, words_of

# More than this many rad, or rad/s, are degrees.
_MOST_ANGLE, _MOST_TURN_RATE = 7.0, 20.0
# Stamps of two topics that differ by more are of two clocks.
_CLOCK_S = 1.0
_BURST_SHARE = 0.3


def value_doubts_of(topic: TopicInspection) -> Iterator[str]:
    """Yield a sentence for each thing about a topic's numbers that cannot be as it should."""
    if topic.scan is not None:
        yield from _scan(topic)
    if topic.count >= LEAST_MESSAGES:
        yield from _angles(topic)
        yield from _turn_rates(topic)


def clock_doubts_of(topic: TopicInspection, pace: TopicInspection | None) -> Iterator[str]:
    """Yield a sentence for each thing about a topic's clock that cannot be as it should.

    Args:
        topic: what was seen of it.
        pace: the trigger topic, with whose clock stamps are compared; None for none.
    """
    name = topic.name
    if topic.jumps:
        times = 'once' if topic.jumps == 1 else f'{topic.jumps} times'
        yield (
            f'the stamps of {name} jump back {times}, first {topic.first_jump_s:.1f} s after '
            'its first message'
        )
    if topic.leap_s:
        yield f'the stamps of {name} jump ahead by {_long(topic.leap_s)}: a clock was set'
    if topic.burst_share > _BURST_SHARE:
        yield (
            f'{topic.burst_share:.0%} of the messages of {name} were logged at the same time as '
            'the one before: they came in bursts, so log times say little of when they were sent'
        )
    if pace is not None and topic is not pace:
        apart = topic.offset_s - pace.offset_s
        if abs(apart) > _CLOCK_S:
            way = 'ahead of' if apart > 0 else 'behind'
            yield (
                f'the stamps of {name} are {_long(abs(apart))} {way} those of {pace.name}: the '
                'two have clocks of their own; age_by: arrival goes by when messages came'
            )


def _long(seconds: float) -> str:
    """Return a duration in words that fit its size."""
    for size, unit in ((31_557_600.0, 'years'), (86_400.0, 'days'), (3_600.0, 'hours')):
        if seconds >= 2.0 * size:
            return f'{seconds / size:.1f} {unit}'
    return f'{seconds:.3g} s'


def _scan(topic: TopicInspection) -> Iterator[str]:
    scan, name = topic.scan, topic.name
    assert scan is not None
    if scan.fault:
        yield f'the scan of {name} has {scan.fault}'
    if scan.beyond:
        yield (
            f'{scan.beyond / scan.counts[4]:.0%} of the ranges of {name} lie above its range_max '
            f'of {scan.range_max:g} m; they are no measurements'
        )
    if math.isfinite(scan.code):
        yield (
            f'{name} has the range {scan.code:g} m again and again, below its range_min of '
            f'{scan.range_min:g} m: a code for "not measured", no distance'
        )
    if scan.near > 0.0:
        yield (
            f'{scan.near:.0%} of the ranges of {name} lie below its range_min; they are kept, '
            'because something may be that close'
        )
    for low, high in scan.body():
        yield (
            f'from {low:g} to {high:g} degrees the ranges of {name} never change: the scanner '
            'sees the robot itself there'
        )


def _angles(topic: TopicInspection) -> Iterator[str]:
    """Angles in degrees: positions of joints, roll, pitch."""
    is_joints = topic.msgtype == 'sensor_msgs/msg/JointState'
    found = []
    for path, series in topic.series.items():
        words = set(words_of(path))
        if is_turning(path):
            continue
        is_angle = (
            path.startswith('position[')
            if is_joints
            else bool(words & {'roll', 'pitch', 'yaw', 'rpy', 'steering', 'heading'})
            and not words & {'rate', 'speed', 'velocity', 'effort', 'error'}
        )
        if not is_angle or words & {'deg', 'degrees'} or series.only_rises or series.is_integer:
            continue
        if _is_large(series.finite, _MOST_ANGLE, 720.0):
            found.append(path)
    if found:
        yield (
            f'{some_of(found)} of {topic.name} {"has" if len(found) == 1 else "have"} angles above '
            f'{_MOST_ANGLE:g} rad, as if in degrees'
        )


def _turn_rates(topic: TopicInspection) -> Iterator[str]:
    found = []
    for path, series in topic.series.items():
        words = set(words_of(path))
        is_rate = bool(words & {'angular', 'gyro', 'gyroscope'}) and not words & {'covariance'}
        if is_rate and not is_command(topic.name) and _is_large(series.finite, _MOST_TURN_RATE):
            found.append(path)
    if found:
        yield (
            f'{some_of(found)} of {topic.name} {"has" if len(found) == 1 else "have"} angular '
            f'rates above {_MOST_TURN_RATE:g} rad/s, as if in degrees per second'
        )


def _is_large(values: np.ndarray, most: float, top: float = math.inf) -> bool:
    if not values.size:
        return False
    return most < float(np.percentile(np.abs(values), 98)) <= top


def some_of(names: list[str]) -> str:
    """Return the first few names, and dots if there are more."""
    return ', '.join(names[:3]) + (' ...' if len(names) > 3 else '')
