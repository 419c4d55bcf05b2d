# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When data are SAFE, VIOLATED and UNKNOWN: verdicts in time, and violations as intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

TIMEOUT_SECONDS = 1.0
"""How long a verdict is valid without new input; the default of the monitor."""

BRIDGE_SECONDS = 0.5
"""Two violations of one rule that are no further apart count as one."""


@dataclass(frozen=True, eq=False)
class Interval:
    """A stretch of one episode in which one rule is true, or in which nothing can be judged.

    Attributes:
        rule: position in the rule set; -1 where nothing can be judged.
        source: position in the data's sources.
        episode: number of the episode.
        start: when the first of its samples arrived, in the timeline's unit.
        end: when the first sample after it arrived, or when the verdict expired.
        active: for how much of that the rule is true; the rest are breaks that were bridged.
        samples: row numbers in the data, those of the breaks left out.
        worst: row number where the rule's own margin is smallest; the first row for ``rule`` -1.
        margin: of the rule in that row; NaN for ``rule`` -1.
    """

    rule: int
    source: int
    episode: int
    start: float
    end: float
    active: float
    samples: np.ndarray
    worst: int
    margin: float


@dataclass(frozen=True, eq=False)
class Timeline:
    """Verdicts on data in time.

    A verdict is valid from the arrival of its sample to that of the next one of the same episode,
    but no longer than the timeout: after that, a monitor says UNKNOWN. The last verdict of an
    episode is valid as long as the median one.

    Attributes:
        data: what was judged.
        judgement: of its rows.
        unit: ``s`` since the start of the recording; ``row`` for table files, which know no time.
        starts: (n,) when each row's verdict begins.
        valid_for: (n,) how long it is valid.
        silence: (n,) how much longer nothing came, which counts as UNKNOWN.
        violations: of each rule, sorted by source, episode and start.
        unknown: stretches in which samples came and could not be judged.
    """

    data: Dataset
    judgement: Judgement
    unit: str
    starts: np.ndarray
    valid_for: np.ndarray
    silence: np.ndarray
    violations: tuple[Interval, ...]
    unknown: tuple[Interval, ...]

    @property
    def duration(self) -> float:
        """How long all episodes last together."""
        return float(self.valid_for.sum() + self.silence.sum())

    @property
    def shares(self) -> dict[str, float]:
        """Share of the time of each verdict, by its name; of the samples where no time passes."""
        weights = self.valid_for if self.duration else np.ones(len(self.data))
        times = {
            verdict.name: float(weights[self.judgement.verdict == verdict].sum())
            for verdict in Verdict
        }
        times['UNKNOWN'] += float(self.silence.sum())
        total = max(sum(times.values()), np.finfo(np.float64).tiny)
        return {name: time / total for name, time in times.items()}

    @property
    def is_safe(self) -> bool:
        """Whether every verdict is SAFE and no time without one passed."""
        return bool((self.judgement.verdict == Verdict.SAFE).all() and not self.silence.any())


def check_data(
    data: Dataset,
    rule_set: RuleSet,
    *,
    timeout: float = TIMEOUT_SECONDS,
    bridge: float = BRIDGE_SECONDS,
) -> Timeline:
    """Judge rows of features; without enabled rules, every verdict is UNKNOWN."""
    judgement = Judgement.unknown(len(data)) if rule_set.problem else rule_set.judge(data.values)
    return make_timeline(rule_set, data, judgement, timeout=timeout, bridge=bridge)


def make_timeline(
    rule_set: RuleSet,
    data: Dataset,
    judgement: Judgement,
    *,
    timeout: float = TIMEOUT_SECONDS,
    bridge: float = BRIDGE_SECONDS,
) -> Timeline:
    """Put verdicts in time.

    A violation of a rule begins with a sample on which it is true and ends with the next on which
    it is not, whichever other rules are, and in any case at the end of the episode or after the
    timeout. Two violations of one rule in one episode whose distance is at most ``bridge`` count
    as one, whatever lies between. That distance is one of header stamps, so that it is the same
    when the recording is played; where stamps stand still or go back, of arrivals.

    Args:
        rule_set: the rules.
        data: n rows of features.
        judgement: of these rows by these rules.
        timeout: seconds that a verdict is valid without new input.
        bridge: seconds; 0 joins none. Neither limit concerns tables.
    """
    clock = _Clock(data, timeout, bridge)
    violated = np.flatnonzero(judgement.verdict == Verdict.VIOLATED)
    values = data.values[violated]
    violations: list[Interval] = []
    for place in rule_set.order.tolist():
        rule = rule_set.rules[place]
        true = rule.holds(values)
        if true.any():
            margins = np.full(len(data), np.nan)
            margins[violated] = rule.margins(values, rule_set.scale)
            violations += clock.intervals(place, violated[true], margins)
    violations.sort(key=lambda item: (item.source, item.episode, item.start, item.rule))
    unknown = np.flatnonzero(judgement.verdict == Verdict.UNKNOWN)
    return Timeline(
        data,
        judgement,
        clock.unit,
        clock.starts,
        clock.valid_for,
        clock.silence,
        tuple(violations),
        tuple(clock.intervals(-1, unknown, np.full(len(data), np.nan))),
    )


def progress(stamps: np.ndarray, arrivals: np.ndarray, episodes: np.ndarray) -> np.ndarray:
    """Return how far time has gone on from the first of some samples to each, in ns.

    By their header stamps, which are the same when a recording is played. While these stand still
    it goes on with the arrivals, and where they go back from there on.

    Args:
        stamps: (n,) int64, in ns.
        arrivals: (n,) int64, in ns.
        episodes: (n,) int64; a stamp does not stand still from one episode to the next.
    """
    if not len(stamps):
        return stamps
    is_head = (np.diff(stamps) != 0) | (np.diff(episodes) != 0)
    heads = np.flatnonzero(np.append(True, is_head))
    lengths = np.diff(np.append(heads, len(stamps)))
    since = arrivals - np.repeat(arrivals[heads], lengths)
    # Within each stretch of one stamp, how far arrivals have gone on.
    for place in np.flatnonzero(lengths > 1).tolist():
        stretch = slice(heads[place], heads[place] + lengths[place])
        np.maximum.accumulate(since[stretch], out=since[stretch])
    stalled = since[heads[1:] - 1]
    steps = np.diff(stamps[heads])
    back = stalled + np.maximum(arrivals[heads[1:]] - arrivals[heads[1:] - 1], 0)
    steps = np.where(steps > 0, np.maximum(steps, stalled), back)
    begun = np.append(0, np.cumsum(steps))
    return np.repeat(begun, lengths) + since


class _Clock:
    """When the rows of data begin and how long they are valid."""

    def __init__(self, data: Dataset, timeout: float, bridge: float) -> None:
        self._data = data
        self._sources = data.recordings
        if self._sources is None:
            self._sources = np.zeros(len(data), dtype=np.int64)
        self.unit = 'row' if data.times_ns is None else 's'
        # Rows of one episode follow one another, which those of robots in a table do not.
        self._order = np.argsort(data.episodes, kind='stable')
        self._rank = np.empty_like(self._order)
        self._rank[self._order] = np.arange(len(self._order))
        if data.times_ns is None:
            self.starts = data.stamps_ns.astype(np.float64)
            self.valid_for, self.silence = np.ones(len(data)), np.zeros(len(data))
            self._places = (data.stamps_ns, data.stamps_ns + 1, np.ones(len(data), dtype=bool))
            self._bridge = 0
            return
        self.starts = data.times_ns * 1e-9
        gaps = self._gaps()
        self.valid_for = np.minimum(gaps, timeout)
        self.silence = gaps - self.valid_for
        self._places = self._stamped(round(timeout * 1e9))
        self._bridge = round(bridge * 1e9)

    def _stamped(self, timeout_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return by stamps where each row begins and its verdict ends, in ns, and if unbroken."""
        columns = (self._data.stamps_ns, self._data.times_ns, self._data.episodes)
        begins = progress(*(column[self._order] for column in columns))
        steps = np.diff(begins)
        # What follows the last row of an episode is never asked for.
        valid = np.minimum(np.append(steps, timeout_ns)[: len(begins)], timeout_ns)
        unbroken = np.append(valid[:-1] == steps, True)[: len(begins)]
        return begins[self._rank], (begins + valid)[self._rank], unbroken[self._rank]

    def _gaps(self) -> np.ndarray:
        """(n,) seconds from each row to the next of its episode."""
        times, episodes = self._data.times_ns[self._order], self._data.episodes[self._order]
        gaps = np.zeros(len(times))
        for first, last in _runs(episodes[1:] == episodes[:-1], len(times)):
            # Stamps, of which tables have their time, may go back.
            steps = np.maximum(np.diff(times[first : last + 1]), 0) * 1e-9
            gaps[first:last] = steps
            gaps[last] = np.median(steps) if len(steps) else 0.0
        return gaps[self._rank]

    def intervals(self, rule: int, rows: np.ndarray, margins: np.ndarray) -> Iterator[Interval]:
        """Yield the intervals that some rows make up, in the order of episodes and time."""
        if not len(rows):
            return
        episodes = self._data.episodes
        rows = rows[np.argsort(self._rank[rows])]
        ends = self.starts[rows] + self.valid_for[rows]
        begin, end, unbroken = (column[rows] for column in self._places)
        follows = (self._rank[rows[1:]] == self._rank[rows[:-1]] + 1) & unbroken[:-1]
        is_near = begin[1:] - end[:-1] <= self._bridge
        joined = (follows | is_near) & (episodes[rows[1:]] == episodes[rows[:-1]])
        for first, last in _runs(joined, len(rows)):
            samples = rows[first : last + 1]
            own = margins[samples]
            worst = 0 if np.isnan(own).all() else int(np.nanargmin(own))
            yield Interval(
                rule=rule,
                source=int(self._sources[samples[0]]),
                episode=int(episodes[samples[0]]),
                start=float(self.starts[samples[0]]),
                end=float(ends[last]),
                active=float(self.valid_for[samples].sum()),
                samples=samples,
                worst=int(samples[worst]),
                margin=float(own[worst]),
            )


def _runs(joined: np.ndarray, count: int) -> Iterator[tuple[int, int]]:
    """Yield first and last place of each run among ``count`` places.

    Args:
        joined: (count - 1,) bool, whether a place and the next belong together.
        count: number of places.
    """
    if count:
        breaks = np.flatnonzero(~joined)
        yield from zip([0, *(breaks + 1).tolist()], [*breaks.tolist(), count - 1], strict=True)
