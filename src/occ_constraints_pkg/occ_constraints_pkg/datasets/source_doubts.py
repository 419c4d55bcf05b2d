# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Doubts about the topics of a feature map: clocks apart, and ranges that are codes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from occ_constraints_pkg.datasets.clocks import ClockReadings, clock_warnings
from occ_constraints_pkg.datasets.topic_columns import TopicColumns
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.reductions import RangeRule
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block

# A share of ranges beyond the limits that is told.
_MANY = 0.01
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
    fields = dict.fromkeys(
        reading.field
        for _, reading in feature_map.readings
        if topic_key(reading.topic) == topic_key(name)
        and reading.field is not None
        and not RangeRule.of(reading).is_plain
        and not reading.selectors
    )
    rows = np.arange(len(block))[:_SCANS]
    for field in fields:
        counts = []
        for missing, limits in (('drop', 'ignore'), ('drop', None), ('drop', 'own')):
            reading = Reading(name, field, reduce='count', missing=missing, range_limits=limits)
            try:
                columns = TopicColumns(recording, name, [('', reading)])
                counts.append(float(np.nansum(columns.read(block, rows)[0])))
            except OccError:
                # Not an array, or its message has no limits.
                break
        if len(counts) < 3 or not counts[0]:
            continue
        every, below_most, within = counts
        for share, which in (
            (1.0 - below_most / every, 'above its range_max'),
            ((below_most - within) / every, 'below its range_min'),
        ):
            if share > _MANY:
                yield (
                    f'{share:.1%} of the ranges of {name} that are numbers are {which}: they may '
                    'be codes, not distances; range_limits says which count'
                )
