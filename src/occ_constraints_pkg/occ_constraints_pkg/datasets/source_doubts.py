# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Doubts about the topics of a feature map: clocks apart, and ranges that are codes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from occ_constraints_pkg.datasets.clocks import ClockReadings, clock_warnings
from occ_constraints_pkg.datasets.topic_columns import TopicColumns
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.doubts import range_doubts, range_fields, range_readings
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block

# Scans that are looked at for it, of the first part of a recording.
_SCANS = 200


def source_doubts(recording: Recording, feature_map: FeatureMap) -> Iterator[str]:
    """Yield a sentence for each thing that is odd about the messages that a map reads.

    Args:
        recording: only the first part of each topic is looked at for ranges.
        feature_map: what is read; tables are left aside.

    Raises:
        OccError: the recording cannot be read, or lacks a topic.
    """
    tables = {topic_key(topic) for topic in feature_map.table_topics}
    clocks = {}
    for topic in feature_map.topics:
        if topic_key(topic) in tables:
            continue
        name = recording.find(topic)
        columns = TopicColumns(recording, name, ())
        blocks = recording.blocks([name])
        stamps, times = [], []
        for number, block in enumerate(blocks):
            if number == 0:
                yield from _of_ranges(recording, name, feature_map, block)
            stamps.append(columns.read(block, np.arange(len(block)))[1])
            times.append(block.times)
        if columns.has_stamps and times:
            clocks[name] = ClockReadings.of(np.concatenate(stamps), np.concatenate(times))
    yield from clock_warnings(clocks)


def _of_ranges(
    recording: Recording, name: str, feature_map: FeatureMap, block: Block
) -> Iterator[str]:
    """Yield a sentence if many ranges of a topic are beyond its message's own limits."""
    fields = range_fields(feature_map, name)
    rows = np.arange(len(block))[:_SCANS]
    for field in fields:
        try:
            counts = [
                float(np.nansum(TopicColumns(recording, name, [('', item)]).read(block, rows)[0]))
                for item in range_readings(name, field)
            ]
        except OccError:
            # Not an array, or its message has no limits.
            continue
        yield from range_doubts(name, counts)
