# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Families that nobody declared: features that are named and behave like one measurement.

The sectors of a lidar are named by one word and a number, ``d_l0`` to ``d_l15``, and what one of
them sees the others see at some other time. Joints of an arm are named in the same way, but each
moves in a range of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_constraints_pkg.rules.space import FeatureSpace

# Fewer features of a name and a number may well be different things, as x1 and x2.
_LEAST_MEMBERS = 4
# Names that programs give to whatever they are given: they do not say that columns are alike.
_ANYTHING = frozenset(
    (
        *('', 'a', 'action', 'attr', 'c', 'col', 'column', 'comp', 'component', 'data', 'dim', 'f'),
        *('feat', 'feature', 'field', 'input', 'latent', 'obs', 'observation', 'output', 'pc', 's'),
        *('signal', 'state', 'u', 'unnamed', 'v', 'val', 'value', 'var', 'variable', 'x', 'y', 'z'),
    )
)
# With fewer distinct values it is a label or a flag, and its share of ones is no measurement.
_FEWEST_KINDS = 9
# Members' distributions differ by no more than this: the largest difference of the shares below any
# value, between a member and all others. And each member spans at least this share of the range
# that the members have in the middle.
_MOST_DIFFERENT, _LEAST_SPANNED = 0.45, 0.4
# So many rows suffice to compare.
_SOME = 20_000
# A sensor with nothing in range tells its limit: at least this share of the values are the same.
_LEAST_IDLE = 0.05


@dataclass(frozen=True)
class LikelyFamily:
    """Features that are probably one measurement in several directions or places.

    Attributes:
        name: what their names have in common; no feature or declared family has this name.
        features: their positions.
        low: smallest possible value; that of the features unless it can be told from the values.
        high: largest possible value.
        is_telling: whether the names say that they measure something; ``x0`` and ``column_1`` do
            not.
    """

    name: str
    features: tuple[int, ...]
    low: float
    high: float
    is_telling: bool


def likely_families(values: np.ndarray, space: FeatureSpace) -> list[LikelyFamily]:
    """Return what looks like families, by names, units, physical bounds and values.

    A family has four members or more, named alike but for a number, with the same unit and bounds.
    Each is continuous and has about the distribution of the others.

    Where most of the sensors are idle most of the time, bounds that are not known are told from
    that: values between 0 and 1 that are often 0 end at 1, which is contact, and values above 0
    that are often at their maximum end at 0.

    Args:
        values: (n, k) usable samples.
        space: the features; those with a family are left alone.
    """
    some = values[:: max(1, -(-len(values) // _SOME))]
    found = []
    taken = {*space.names, *(feature.family for feature in space.features)}
    for stem, members in _named_alike(space):
        columns = some[:, members]
        if not len(some) or not _are_alike(columns):
            continue
        first = space.features[members[0]]
        low, high = _physical_bounds(columns, first.low, first.high)
        is_telling = stem.lower() not in _ANYTHING
        name = _free_name(stem, taken)
        taken.add(name)
        found.append(LikelyFamily(name, members, low, high, is_telling))
    return found


def with_families(space: FeatureSpace, families: Sequence[LikelyFamily]) -> FeatureSpace:
    """Return the feature space with families, and their bounds, declared."""
    features = list(space.features)
    for family in families:
        for member in family.features:
            features[member] = replace(
                features[member], family=family.name, low=family.low, high=family.high
            )
    return FeatureSpace(tuple(features))


def _named_alike(space: FeatureSpace) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield what names have in common, without brackets and separators, and the features."""
    groups: dict[tuple[str, str, str, float, float], list[int]] = {}
    for position, feature in enumerate(space.features):
        # The last number counts: `lidar2_d15` is a sector of the second lidar.
        parts = re.fullmatch(r'(.*?)[\W_]*(\d+)([^\d]*)', feature.name, re.DOTALL)
        if parts and not feature.family:
            before, _, after = parts.groups()
            key = before, after.strip(')]'), feature.unit, feature.low, feature.high
            groups.setdefault(key, []).append(position)
    for (before, after, *_), members in groups.items():
        if len(members) >= _LEAST_MEMBERS:
            yield (before + after).strip('_'), tuple(members)


def _free_name(stem: str, taken: set[str]) -> str:
    """Return a stem that is not taken, with an underscore after it as often as needed."""
    while stem in taken:
        stem += '_'
    return stem


def _are_alike(columns: np.ndarray) -> bool:
    """Tell whether (n, m) values look like draws from about one distribution in each column."""
    if any(len(np.unique(column)) < _FEWEST_KINDS for column in columns.T):
        return False
    ends = np.stack([columns.min(axis=0), columns.max(axis=0)])
    low, high = np.median(ends, axis=1)
    common = np.minimum(ends[1], high) - np.maximum(ends[0], low)
    if (common < _LEAST_SPANNED * np.maximum(ends[1] - ends[0], high - low)).any():
        return False
    ordered = np.sort(columns, axis=0)
    grid = np.unique(np.quantile(columns, np.linspace(0.0, 1.0, 257)))
    below = np.stack([np.searchsorted(column, grid, side='right') for column in ordered.T])
    shares = below / len(columns)
    others = (shares.sum(axis=0) - shares) / (len(shares) - 1)
    return bool(np.abs(shares - others).max() <= _MOST_DIFFERENT)


def _physical_bounds(columns: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Return bounds of alike sensors, told from where they idle if there are none."""
    if np.isfinite([low, high]).any():
        return low, high
    smallest, largest = columns.min(), columns.max()
    if smallest == 0.0 and largest <= 1.0 and (columns == 0.0).mean() >= _LEAST_IDLE:
        return 0.0, 1.0
    if smallest >= 0.0 and (columns == largest).mean() >= _LEAST_IDLE:
        return 0.0, high
    return low, high
