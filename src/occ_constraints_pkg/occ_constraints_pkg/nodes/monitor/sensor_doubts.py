# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors that lie while the robot runs: values that are frozen, ranges that are codes.

This is looked at once a second, so it costs the judging of inputs nothing, and says in the words of
``occ features check`` what that says of a recording.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.doubts import (
    frozen_words,
    range_doubts,
    range_fields,
    range_readings,
    still_member_words,
)
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.fields import TopicReader

# Scans whose ranges are counted together; one alone may be an exception.
_SCANS, _FEWEST_SCANS = 10, 3


class SensorDoubts:
    """Looks at what the newest messages say, again and again.

    Args:
        feature_map: what is read.
        frozen_after: how often in a row a value has to be the same to be called frozen; 0: never.
    """

    def __init__(self, feature_map: FeatureMap, frozen_after: int) -> None:
        self._map, self._frozen_after = feature_map, frozen_after
        self._space = feature_map.space
        count = len(feature_map.features)
        self._last, self._looks = np.full(count, np.nan), np.zeros(count, dtype=int)
        # Of each field of ranges: what counts them, and the counts of its last scans.
        self._ranges = {
            (topic, field): (
                TopicReader([0, 1, 2], [('', item) for item in range_readings(topic, field)]),
                deque[np.ndarray](maxlen=_SCANS),
            )
            for topic in feature_map.topics
            if topic not in feature_map.table_topics
            for field in range_fields(feature_map, topic)
        }
        self._scans: dict[str, Any] = {}

    def look(
        self, read: np.ndarray, values: np.ndarray, newest: Mapping[str, Any]
    ) -> Iterator[str]:
        """Look once more; yield a sentence for each doubt.

        Args:
            read: (k,) what the newest messages say, before the steps of the map.
            values: (k,) the same after them.
            newest: by topic, as the map writes it, the newest message.
        """
        yield from self._frozen(read, values)
        for (topic, field), (reader, counts) in list(self._ranges.items()):
            message = newest.get(topic)
            if message is None or message is self._scans.get(topic):
                continue
            try:
                counts.append(reader.read(message)[0][0])
            except OccError:
                # Not an array, or its message has no limits.
                del self._ranges[topic, field]
        self._scans = {topic: newest[topic] for topic, _ in self._ranges if topic in newest}
        for (topic, _), (_, counts) in self._ranges.items():
            if len(counts) >= _FEWEST_SCANS:
                yield from range_doubts(topic, np.nansum(counts, axis=0).tolist())

    def _frozen(self, read: np.ndarray, values: np.ndarray) -> Iterator[str]:
        """Yield a sentence for each value that was the same too often."""
        is_same = read == self._last
        self._looks = np.where(is_same, self._looks + 1, np.isfinite(read).astype(int))
        self._last = read
        if not self._frozen_after:
            return
        # Zero and the physical bounds are what a robot at rest and an empty scene give.
        is_told = np.isfinite(values) & (read != 0.0) & (values != 0.0)
        is_told &= (values != self._space.lows) & (values != self._space.highs)
        is_still = self._looks >= self._frozen_after
        families = list(map(list, self._space.families))
        for index in np.flatnonzero(is_still & is_told).tolist():
            name, value = self._space.names[index], float(values[index])
            family = next((family for family in families if index in family), None)
            if family is None:
                yield frozen_words(name, value, int(self._looks[index]))
            elif np.count_nonzero(is_still[family]) * 2 <= len(family):
                yield still_member_words(name, value)
