# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A recording at a glance, as a table for people and as plain values."""

from __future__ import annotations

import math
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from occ_constraints_pkg.datasets.clocks import ClockReadings
from occ_constraints_pkg.datasets.overview import RecordingOverview, TopicOverview
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

_LONGEST_NAME = 40


def describe_overview(seen: RecordingOverview) -> str:
    """Return a recording's overview as lines of text."""
    begun = datetime.fromtimestamp(seen.start_ns // 10**9, UTC)
    messages = sum(topic.count for topic in seen.topics)
    width = min(max([len(topic.name) for topic in seen.topics] + [5]), _LONGEST_NAME)
    kind = min(max([len(topic.msgtype) for topic in seen.topics] + [4]), _LONGEST_NAME)
    lines = [
        f'{seen.path}: {count_of(messages, "message")} on {count_of(len(seen.topics), "topic")} '
        f'in {seen.duration_s:.1f} s from {begun:%Y-%m-%d %H:%M:%S} UTC on; '
        f'{count_of(len(seen.files), "file")}, {_size(seen.size)}',
        f'{"topic":<{width}}  {"type":<{kind}}{"messages":>10}{"rate":>11}{"largest gap":>20}'
        f'{"stamp to log":>15}  to learn from',
    ]
    for topic in seen.topics:
        gap = '-' if math.isnan(topic.gap_s) else f'{topic.gap_s:.3g} s at {topic.gap_at_s:.1f} s'
        rate = '-' if math.isnan(topic.rate) else f'{topic.rate:.3g} Hz'
        lines.append(
            f'{topic.name:<{width}}  {topic.msgtype:<{kind}}{topic.count:>10}{rate:>11}{gap:>20}'
            f'{_lag(topic.clock):>15}  {_use(topic)}'
        )
    lines += [f'{topic.name}: {topic.problem}' for topic in seen.topics if topic.problem]
    undefined = [item.name for item in seen.topics if not item.has_definition and not item.problem]
    if undefined:
        lines.append(
            'read by the definitions that are known or installed, for the recording has none: '
            + ', '.join(undefined)
        )
    return '\n'.join(map(printable, lines))


def overview_document(seen: RecordingOverview) -> dict[str, Any]:
    """Return a recording's overview as plain values for JSON; None for a missing number."""
    return {
        'path': seen.path,
        'files': list(seen.files),
        'size_bytes': seen.size,
        'start_ns': seen.start_ns,
        'duration_s': seen.duration_s,
        'topics': [
            {
                'name': topic.name,
                'type': topic.msgtype,
                'messages': topic.count,
                'rate_hz': _finite(topic.rate),
                'largest_gap_s': _finite(topic.gap_s),
                'largest_gap_at_s': _finite(topic.gap_at_s),
                'has_definition': topic.has_definition,
                'problem': topic.problem or None,
                'is_learnable': topic.is_learnable,
                'numbers': topic.numbers,
                'arrays': topic.arrays,
                'clock': None
                if topic.clock is None
                else {key: _finite(value) for key, value in asdict(topic.clock).items()},
            }
            for topic in seen.topics
        ],
        'warnings': list(seen.warnings),
    }


def _use(topic: TopicOverview) -> str:
    """Say what features can be read of a topic."""
    if topic.problem:
        return 'nothing: see below'
    if not topic.count:
        return 'nothing: no messages'
    parts = [count_of(topic.numbers, 'number')] if topic.numbers else []
    parts += [count_of(topic.arrays, 'array')] if topic.arrays else []
    return ', '.join(parts) or 'nothing: no numbers'


def _lag(clock: ClockReadings | None) -> str:
    if clock is None or math.isnan(clock.lag_s):
        return 'no stamps'
    return f'{clock.lag_s:.3g} s'


def _size(size: int) -> str:
    units = ('bytes', 'kB', 'MB', 'GB')
    power = min(int(math.log(max(size, 1), 1000)), len(units) - 1)
    return f'{size / 1000**power:.3g} {units[power]}'


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
