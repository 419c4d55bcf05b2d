# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Doubts about what sensors say: frozen, the robot itself, degrees, codes instead of ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.reductions import RangeRule
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.rules.space import FeatureSpace

# What changes by less than this share of what its family does stands still.
_STILL = 0.02
_LEAST_ROWS = 50
# No robot turns faster, but for its wheels and rotors.
_FASTEST_TURN = 20.0
# Joints and headings stay within a turn or two; what goes further is in degrees, or a wheel.
_LARGEST_ANGLE = 4.0 * math.pi
# A share of ranges beyond the limits that is told.
_MANY = 0.01
# Of the ranges that are numbers: all, those that are not too long, and those that are measurements.
_COUNTED = ('ignore', None, 'own')


def value_doubts(values: np.ndarray, space: FeatureSpace) -> Iterator[str]:
    """Yield a sentence for each feature whose values are likely not what they should be.

    Args:
        values: (n, k) float64; what is not finite is left aside.
        space: the k features.
    """
    known = np.where(np.isfinite(values), values, np.nan)
    if len(known) < _LEAST_ROWS:
        return
    low, high = (
        pick(known, axis=0, initial=start, where=~np.isnan(known))
        for pick, start in ((np.min, np.inf), (np.max, -np.inf))
    )
    seen = low <= high
    spans = np.where(seen, high - low, np.nan)
    yield from _of_members(spans, low, space)
    members = {index for family in space.families for index in family}
    for index, feature in enumerate(space.features):
        if not seen[index]:
            continue
        value, extreme = low[index], max(abs(low[index]), abs(high[index]))
        if (
            not spans[index]
            and index not in members
            and value not in (0.0, feature.low, feature.high)
        ):
            yield frozen_words(feature.name, float(value), len(known))
        if feature.unit == 'rad/s' and extreme > _FASTEST_TURN:
            yield (
                f'{feature.name} goes up to {extreme:.3g} rad/s: it may be in degrees per second, '
                'or be the rate of a wheel'
            )
        if feature.unit == 'rad' and extreme > _LARGEST_ANGLE:
            yield (
                f'{feature.name} goes up to {extreme:.3g} rad: it may be in degrees, or be the '
                'angle of a wheel'
            )


def _of_members(spans: np.ndarray, low: np.ndarray, space: FeatureSpace) -> Iterator[str]:
    """Yield a sentence for each member of a family that stands still while others do not."""
    for family in map(list, space.families):
        own = spans[family]
        usual = np.nanmedian(own) if (~np.isnan(own)).any() else 0.0
        for index, span in zip(family, own.tolist(), strict=True):
            if usual > 0.0 and span <= _STILL * usual:
                yield still_member_words(space.names[index], float(low[index]))


def frozen_words(name: str, value: float, samples: int) -> str:
    """Return that a feature has never changed."""
    return f'{name} is {value:g} in all {samples} samples: it may be frozen'


def still_member_words(name: str, value: float) -> str:
    """Return that a member of a family stands still while others do not."""
    return (
        f'{name} stays at {value:.3g} while others of its family change: if that is the robot '
        'itself, its bound is the bound of all; exclude_degrees leaves a part of a scan out'
    )


def range_fields(feature_map: FeatureMap, topic: str) -> list[str]:
    """Return the fields of a topic that a map reads as ranges, of which not every one counts."""
    return list(
        dict.fromkeys(
            reading.field
            for _, reading in feature_map.readings
            if topic_key(reading.topic) == topic_key(topic)
            and reading.field is not None
            and not RangeRule.of(reading).is_plain
            and not reading.selectors
        )
    )


def range_readings(topic: str, field: str) -> list[Reading]:
    """Return what counts the ranges of a scan, for :func:`range_doubts`."""
    return [
        Reading(topic, field, reduce='count', missing='drop', range_limits=limits)
        for limits in _COUNTED
    ]


def range_doubts(topic: str, counts: Sequence[float]) -> Iterator[str]:
    """Yield a sentence if many ranges of a topic are beyond its message's own limits.

    Args:
        topic: its name.
        counts: what each of :func:`range_readings` counted.
    """
    every, below_most, within = counts
    if not every:
        return
    for share, which in (
        (1.0 - below_most / every, 'above its range_max'),
        ((below_most - within) / every, 'below its range_min'),
    ):
        if share > _MANY:
            yield (
                f'{share:.1%} of the ranges of {topic} that are numbers are {which}: they may '
                'be codes, not distances; range_limits says which count'
            )
