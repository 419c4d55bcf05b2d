# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Doubts about values of features: of sensors that are frozen, see their robot, use degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from occ_constraints_pkg.rules.space import FeatureSpace

# What changes by less than this share of what its family does stands still.
_STILL = 0.02
_LEAST_ROWS = 50
# No robot turns faster, but for its wheels and rotors.
_FASTEST_TURN = 20.0
# Joints and headings stay within a turn or two; what goes further is in degrees, or a wheel.
_LARGEST_ANGLE = 4.0 * math.pi


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
            yield f'{feature.name} is {value:g} in all {len(known)} samples: it may be frozen'
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
                yield (
                    f'{space.names[index]} stays at {low[index]:.3g} while others of its family '
                    'change: if that is the robot itself, its bound is the bound of all; '
                    'exclude_degrees leaves a part of a scan out'
                )
