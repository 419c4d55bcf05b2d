# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a feature map on a recording: ranges, gaps, stale values, first problems."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_constraints_pkg.datasets.blocks import BlockExtractor
from occ_constraints_pkg.datasets.extraction import rows_of
from occ_constraints_pkg.datasets.source_doubts import source_doubts
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.doubts import value_doubts
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key
from occ_constraints_pkg.features.sources import FeatureSource, Reading
from occ_constraints_pkg.rosbag.recording import Recording

# A feature that cannot be judged in more than this share of the rows is a problem.
TOLERATED_SHARE = 0.05
# A recording is looked at in so many parts, to see how much they differ.
_PARTS = 8


@dataclass(frozen=True)
class FeatureStatistics:
    """Statistics of one feature on one recording.

    Attributes:
        source: the feature.
        low: smallest value that can be judged; NaN where there is none.
        median: median of those.
        size: median of their absolute values.
        high: largest of those.
        parts: least and largest value in each of some parts of the recording, one after the other.
        swings: how often it went from the upper quarter of its range to the lower one, or back.
        spread: from the first to the ninety-ninth percentile of those.
        missing: share of the rows in which the value is missing or not finite.
        outside: share of the rows in which it is outside its physical bounds.
        stale: share of the rows in which a topic it needs was silent for too long, or had not
            begun; part of ``missing``.
        longest_still_s: longest time without any change, in s; of zeros and of values at a physical
            bound, which are what a robot at rest and an empty scene give, it does not count.
        first_problem: a sentence on the first row that cannot be judged; empty without one.
    """

    source: FeatureSource
    low: float
    median: float
    size: float
    high: float
    parts: tuple[tuple[float, float], ...]
    swings: int
    spread: float
    missing: float
    outside: float
    stale: float
    longest_still_s: float
    first_problem: str

    @property
    def is_constant(self) -> bool:
        """Whether it never changed."""
        return self.low == self.high

    @property
    def is_problem(self) -> bool:
        """Whether it is too often not there, or never moved from a value other than at rest.

        At rest are 0, as of a bumper, and a physical bound, as of open space.
        """
        is_stuck = self.is_constant and self.low not in (0.0, self.source.low, self.source.high)
        return self.missing + self.outside > TOLERATED_SHARE or is_stuck


@dataclass(frozen=True)
class MapStatistics:
    """Statistics of a feature map on a recording.

    Attributes:
        rows: how many.
        duration_s: from the first row to the last.
        usable: share of the rows in which every feature can be judged.
        clock_jumps: how often a row's stamp lies before that of the row before.
        features: each feature's part, in the order of the map.
        warnings: one sentence for each thing that is missing or damaged in the recording.
    """

    rows: int
    duration_s: float
    usable: float
    clock_jumps: int
    features: tuple[FeatureStatistics, ...]
    warnings: tuple[str, ...]

    @property
    def has_problem(self) -> bool:
        """Whether some feature has one, or time went back."""
        return self.clock_jumps > 0 or any(item.is_problem for item in self.features)


@dataclass(frozen=True, eq=False)
class MapRows:
    """The features of a recording, row by row.

    Attributes:
        feature_map: what was computed.
        values: (n, k) float64.
        stamps_ns: (n,) the rows' times.
        ages_ns: (n, readings) how far each reading's message is from the row, in ns; NaN before
            the first one.
        warnings: see :class:`MapStatistics`.
    """

    feature_map: FeatureMap
    values: np.ndarray
    stamps_ns: np.ndarray
    ages_ns: np.ndarray
    warnings: tuple[str, ...]

    def statistics(self) -> MapStatistics:
        """Return the statistics of all features."""
        space, when = self.feature_map.space, self.stamps_ns
        inside = (self.values >= space.lows) & (self.values <= space.highs)
        return MapStatistics(
            rows=len(self.values),
            duration_s=float(when.max() - when.min()) * 1e-9,
            usable=float((inside & np.isfinite(self.values)).all(axis=1).mean()),
            clock_jumps=int(np.count_nonzero(np.diff(when) < 0)),
            features=tuple(
                _feature_statistics(source, self.values[:, place], when, aging)
                for place, (source, aging) in enumerate(
                    zip(self.feature_map.features, self._aging(), strict=True)
                )
            ),
            warnings=self.warnings,
        )

    def _aging(self) -> Iterator[list[tuple[Reading, np.ndarray, int]]]:
        """Yield for each feature the age and the greatest age of each of its readings."""
        subtracted = iter(range(len(self.feature_map.features), self.ages_ns.shape[1]))
        for place, source in enumerate(self.feature_map.features):
            places = [place] if source.minus is None else [place, next(subtracted)]
            yield [
                (reading, self.ages_ns[:, at], self.feature_map.max_age_ns(reading))
                for reading, at in zip(source.readings, places, strict=True)
            ]


def map_statistics(
    recording: Recording,
    feature_map: FeatureMap,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> MapStatistics:
    """Compute the features of a recording and their statistics.

    Args:
        recording: what to read.
        feature_map: what to compute.
        progress: called with (messages read, messages in all).

    Raises:
        OccError: the recording cannot be read, lacks what the map asks for, or gives no row.
    """
    rows = map_rows(recording, feature_map, progress=progress)
    doubts = (
        *source_doubts(recording, feature_map),
        *value_doubts(rows.values, feature_map.space),
    )
    return replace(rows.statistics(), warnings=(*rows.warnings, *doubts))


def joint_statistics(rows: Sequence[MapRows]) -> MapStatistics:
    """Return the statistics of the rows of one map on several recordings.

    A first problem is told by the time from the start of the first recording.
    """
    parts = [item.statistics() for item in rows]
    if len(parts) == 1:
        return parts[0]
    together = replace(
        rows[0],
        values=np.concatenate([item.values for item in rows]),
        stamps_ns=np.concatenate([item.stamps_ns for item in rows]),
        ages_ns=np.concatenate([item.ages_ns for item in rows]),
        warnings=tuple(sentence for item in rows for sentence in item.warnings),
    ).statistics()
    return replace(
        together,
        duration_s=sum(part.duration_s for part in parts),
        clock_jumps=sum(part.clock_jumps for part in parts),
        features=tuple(
            replace(
                own, longest_still_s=max(part.features[place].longest_still_s for part in parts)
            )
            for place, own in enumerate(together.features)
        ),
    )


def map_rows(
    recording: Recording,
    feature_map: FeatureMap,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> MapRows:
    """Compute the features of a recording.

    Args and Raises: see :func:`map_statistics`.
    """
    topics = {topic_key(name): recording.find(topic_key(name)) for name in feature_map.topics}
    total, done = sum(recording.topics[name].count for name in topics.values()), 0
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    if BlockExtractor.reads(recording, topics, feature_map):
        extractor = BlockExtractor(recording, topics, feature_map, with_ages=True)
        for block in recording.blocks(list(topics.values())):
            parts += [
                (found.values, found.stamps_ns, found.ages_ns) for found in extractor.rows(block)
            ]
            done += len(block)
            if progress is not None:
                progress(done, total)
    else:
        parts = list(_one_by_one(recording, feature_map, total, progress))
    if not sum(len(values) for values, _, _ in parts):
        raise DataError(
            f'{recording.path} gives no row: nothing came on '
            f'{feature_map.pace or ", ".join(feature_map.topics)}'
        )
    values, stamps, ages = (np.concatenate(column) for column in zip(*parts, strict=True))
    return MapRows(feature_map, values, stamps, ages, recording.warnings)


def _one_by_one(
    recording: Recording,
    feature_map: FeatureMap,
    total: int,
    progress: Callable[[int, int], None] | None,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield values, stamps and ages of a map of tables, or of a fixed rate."""
    done = 0

    def tick() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    extractor = FeatureExtractor(feature_map)
    for rows in rows_of(recording, extractor, tick):
        count = len(rows.values)
        if not rows.repeat and count:
            row = [np.nan if age is None else float(age) for age in extractor.ages_ns()]
            yield (
                rows.values,
                np.full(count, rows.stamp_ns, dtype=np.int64),
                np.broadcast_to(row, (count, len(row))),
            )


def _feature_statistics(
    source: FeatureSource,
    values: np.ndarray,
    stamps_ns: np.ndarray,
    aging: list[tuple[Reading, np.ndarray, int]],
) -> FeatureStatistics:
    missing = ~np.isfinite(values)
    outside = ~missing & ((values < source.low) | (values > source.high))
    good = values[~missing & ~outside]
    ranks = [0, 1, 50, 99, 100]
    low, usual_low, median, usual_high, high = (
        np.percentile(good, ranks) if good.size else [np.nan] * len(ranks)
    )
    stale = np.zeros(len(values), dtype=bool)
    for _, ages_ns, max_age_ns in aging:
        stale |= ~(ages_ns <= max_age_ns)
    problem = ''
    bad = np.flatnonzero(missing | outside)
    if bad.size:
        row = bad[0]
        problem = f'{(stamps_ns[row] - stamps_ns[0]) * 1e-9:.2f} s: '
        ages = [(reading, float(age[row]), allowed) for reading, age, allowed in aging]
        problem += _reason(source, float(values[row]), ages)
    return FeatureStatistics(
        source=source,
        low=float(low),
        median=float(median),
        size=float(np.median(np.abs(good))) if good.size else np.nan,
        high=float(high),
        parts=tuple(
            (float(part.min()), float(part.max()))
            for part in np.array_split(good, _PARTS)
            if part.size
        ),
        swings=_swings(good, usual_low, usual_high),
        spread=float(usual_high - usual_low),
        missing=float(missing.mean()),
        outside=float(outside.mean()),
        stale=float(stale.mean()),
        longest_still_s=_longest_still_s(
            values, stamps_ns, (values == 0.0) | (values == source.low) | (values == source.high)
        ),
        first_problem=problem,
    )


def _swings(values: np.ndarray, low: float, high: float) -> int:
    """Return how often values go from the upper quarter of a range to the lower, or back."""
    quarter = (high - low) / 4.0
    sides = (values > high - quarter).astype(int) - (values < low + quarter)
    return int(np.count_nonzero(np.diff(sides[sides != 0])))


def _reason(
    source: FeatureSource, value: float, aging: Iterable[tuple[Reading, float, int]]
) -> str:
    """Say in words why a value cannot be judged."""
    if np.isfinite(value):
        return f'{value:g} is outside the bounds [{source.low:g}, {source.high:g}]'
    for reading, age, max_age_ns in aging:
        if np.isnan(age):
            return f'no message on {reading.topic} yet'
        if age > max_age_ns:
            return (
                f'the value of {reading.topic} is {age * 1e-9:.2f} s old, more than '
                f'{max_age_ns * 1e-9:g} s'
            )
    if np.isinf(value):
        return f'the value is {value:g}'
    if any(step[0] == 'rate' for step in source.transform):
        return 'no rate, as in a first row and after a gap or a backward clock jump'
    return 'nothing was measured'


def _longest_still_s(values: np.ndarray, stamps_ns: np.ndarray, at_rest: np.ndarray) -> float:
    """Return the longest time over which a column kept one value; time that goes back counts 0."""
    changes = np.flatnonzero(np.concatenate(([True], values[1:] != values[:-1], [True])))
    starts, ends = changes[:-1], np.minimum(changes[1:], len(values) - 1)
    spans = np.where(at_rest[starts], 0, stamps_ns[ends] - stamps_ns[starts])
    return max(float(spans.max()) * 1e-9, 0.0)
