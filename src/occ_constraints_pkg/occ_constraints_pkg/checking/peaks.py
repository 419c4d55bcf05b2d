# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What topics say between two rows: a spike of one message, which no row may show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.manifest import Selection
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.sources import FeatureSource
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

_SIDES = ('peak', 'dip')


def peak_space(feature_map: FeatureMap) -> FeatureSpace | None:
    """Return two features for each whose topic does not make the rows: its peak and its dip.

    Features that are a rate of change, which depends on how often it is taken, and those of two
    topics have none.

    Returns:
        The peaks of all, then the dips; ``None`` if there are none.
    """
    chosen = [source for own in _by_topic(feature_map).values() for source in own]
    if not chosen:
        return None
    return FeatureSpace(
        tuple(
            Feature(
                f'{source.name}_{side}',
                source.unit,
                family=source.family and f'{source.family}_{side}',
            )
            for side in _SIDES
            for source in chosen
        )
    )


def peaks_of(source: str | Path | Selection, data: Dataset, feature_map: FeatureMap) -> np.ndarray:
    """Return (n, features of :func:`peak_space`) extremes of what came since the row before.

    Where nothing usable came, it is what the row says itself.

    Args:
        source: the recording.
        data: its rows, whose first columns are the features of the map.
        feature_map: gave the rows.
    """
    groups = _by_topic(feature_map)
    if not groups:
        return np.empty((len(data), 0))
    parts = [_extremes(source, data, feature_map, topic, own) for topic, own in groups.items()]
    return np.concatenate([part[side] for side in (0, 1) for part in parts], axis=1)


def _by_topic(feature_map: FeatureMap) -> dict[str, list[FeatureSource]]:
    """Return the features that have peaks, by topic."""
    if not feature_map.pace or feature_map.table_topics:
        return {}
    groups: dict[str, list[FeatureSource]] = {}
    for feature in feature_map.features:
        is_rate = any(step[0] == 'rate' for step in feature.steps)
        is_pace = topic_key(feature.topic) == topic_key(feature_map.pace)
        if feature.minus is None and not is_rate and not is_pace:
            groups.setdefault(feature.topic, []).append(feature)
    return groups


def _extremes(
    source: str | Path | Selection,
    data: Dataset,
    feature_map: FeatureMap,
    topic: str,
    own: list[FeatureSource],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest and the smallest values of a topic's features since the row before."""
    columns = [feature_map.names.index(feature.name) for feature in own]
    rows = data.values[:, columns]
    try:
        every = extract(
            [source], replace(feature_map, pace=topic, features=tuple(own), apart=()),
            provenance=False,
        )  # fmt: skip
    except OccError:
        # Nothing came in the parts to use, which the rows tell as well.
        return rows, rows
    assert data.origins is not None
    assert every.origins is not None
    order = np.argsort(data.origins['time_ns'], kind='stable')
    ends = np.searchsorted(every.origins['time_ns'], data.origins['time_ns'][order], side='right')
    starts = np.concatenate([[0], ends[:-1]])
    lows, highs = _limits(own)
    values = np.where((every.values >= lows) & (every.values <= highs), every.values, np.nan)
    peaks, dips = rows.copy(), rows.copy()
    has_any = np.flatnonzero(ends > starts)
    if len(has_any):
        at = order[has_any]
        for found, reduce in ((peaks, np.fmax), (dips, np.fmin)):
            # What came after the last row belongs to none.
            own_extremes = reduce.reduceat(values[: ends[-1]], starts[has_any], axis=0)
            found[at] = reduce(own_extremes, rows[at])
    return peaks, dips


def _limits(own: list[FeatureSource]) -> tuple[np.ndarray, np.ndarray]:
    """Return the physical bounds of features; nothing infinite is between them."""
    largest = np.finfo(np.float64).max
    lows = np.array([feature.low for feature in own]).clip(-largest, largest)
    highs = np.array([feature.high for feature in own]).clip(-largest, largest)
    return lows, highs
