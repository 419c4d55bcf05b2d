# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""For how long a value has not changed: a sensor that is stuck reads a number as good as any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

_COARSE = ('round', 'clip')
_RAW = ' before rounding'


def with_raw_values(feature_map: FeatureMap) -> FeatureMap:
    """Return the map with a second feature for each that is rounded or clipped, which is not.

    Rounded, a value may well be the same for long although its sensor works.
    """
    raw = [
        replace(
            source,
            name=source.name + _RAW,
            transform=tuple(step for step in source.steps if step[0] not in _COARSE),
            family='',
            low=-np.inf,
            high=np.inf,
        )
        for source in feature_map.features
        if any(step[0] in _COARSE for step in source.steps)
    ]
    return replace(feature_map, features=(*feature_map.features, *raw))


def unchanged_space(space: FeatureSpace, unit: str) -> FeatureSpace:
    """Return a feature for each feature, or family, of a space: how long it has not changed.

    Args:
        space: the features.
        unit: of the time, ``s`` or ``rows``.
    """
    return FeatureSpace(
        tuple(Feature(f'{name}_unchanged', unit, low=0.0) for name, _ in _groups(space))
    )


def unchanged_for(data: Dataset, space: FeatureSpace) -> np.ndarray:
    """Return (n, groups) for how long the values of each group have been the same.

    Args:
        data: rows of one recording, of the features of :func:`with_raw_values` or of ``space``.
        space: the features, without the raw ones.
    """
    columns = {name: place for place, name in enumerate(data.names)}
    times = data.stamps_ns.astype(np.float64) if data.times_ns is None else data.times_ns * 1e-9
    order = np.argsort(data.episodes, kind='stable')
    is_next = data.episodes[order][1:] == data.episodes[order][:-1]
    result = np.zeros((len(data), len(_groups(space))))
    for place, (_, members) in enumerate(_groups(space)):
        names = [space.names[member] for member in members]
        own = data.values[order][:, [columns.get(name + _RAW, columns[name]) for name in names]]
        # NaN is unlike itself: what is missing is no value that stays.
        is_same = is_next & (own[1:] == own[:-1]).all(axis=1)
        changed = np.flatnonzero(np.concatenate([[True], ~is_same]))
        since = np.repeat(times[order][changed], np.diff(np.append(changed, len(own))))
        result[order, place] = np.maximum(times[order] - since, 0.0)
    return result


def _groups(space: FeatureSpace) -> Sequence[tuple[str, tuple[int, ...]]]:
    """Return families, and the features that are in none, with their names."""
    together = {member for family in space.families for member in family}
    groups = [(space.features[family[0]].family, family) for family in space.families]
    groups += [
        (feature.name, (place,))
        for place, feature in enumerate(space.features)
        if place not in together
    ]
    return groups
