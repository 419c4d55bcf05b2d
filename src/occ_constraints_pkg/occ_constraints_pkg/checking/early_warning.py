# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How early the violations in data would have been warned of, and how often in vain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, Timeline
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rules.forecast import (
    HORIZON_SECONDS,
    WINDOW_SECONDS,
    Forecast,
    Forecaster,
)
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

_TICK_ROWS = 1000


@dataclass(frozen=True)
class Onset:
    """A robot that was safe becomes violated.

    Attributes:
        source: position in the data's sources.
        episode: number of the episode.
        start: when, in seconds as in the timeline.
        rule: position of the first rule that is true then.
        warned: seconds for which a warning had been active; 0 if none did.
        feature: position of the feature that was to get there first, as the warning began; -1 for
            none.
    """

    source: int
    episode: int
    start: float
    rule: int
    warned: float
    feature: int


@dataclass(frozen=True)
class WarningRecord:
    """Warnings on data, and what became of them.

    A warning is active while samples are safe and a violation is estimated within the horizon;
    breaks as long as those that are bridged in violations do not end it. It was false when
    no violation came within the horizon after its last sample.

    Attributes:
        horizon: seconds.
        onsets: in the order of episodes and time; without those in an episode's first sample,
            which nothing precedes.
        warnings: their number.
        false: how many of them were false.
    """

    horizon: float
    onsets: tuple[Onset, ...]
    warnings: int
    false: int


@dataclass
class _Warning:
    """An active warning, from its first to its last sample so far, in seconds."""

    start: float
    last: float
    feature: int


def warning_record(
    timeline: Timeline,
    rule_set: RuleSet,
    *,
    horizon: float = HORIZON_SECONDS,
    window: float = WINDOW_SECONDS,
    bridge: float = BRIDGE_SECONDS,
    progress: Callable[[int, int], None] | None = None,
) -> WarningRecord:
    """Make the forecasts that a monitor would have made, and compare them with what came.

    Args:
        timeline: of the data, in seconds.
        rule_set: the rules that judged.
        horizon: seconds within which an estimated violation is warned of.
        window: seconds over which rates of change are looked for.
        bridge: breaks in warnings and in violations of up to so many seconds do not count.
        progress: called with (samples done, samples in all).

    Raises:
        OccError: the data know no time.
    """
    if timeline.unit != 's':
        raise DataError('tables of files know no time, so nothing can be foreseen in them')
    data, judgement = timeline.data, timeline.judgement
    onsets: list[Onset] = []
    counts = [0, 0]
    order = np.argsort(data.episodes, kind='stable')
    breaks = np.flatnonzero(np.diff(data.episodes[order])) + 1
    done = 0
    for rows in np.split(order, breaks):
        episode = _Episode(horizon, bridge)
        forecasts = _forecasts(timeline, Forecaster(rule_set, window), rows)
        for row, forecast in zip(rows.tolist(), forecasts, strict=True):
            verdict, time = Verdict(judgement.verdict[row]), float(timeline.starts[row])
            warned = episode.add(time, verdict, forecast)
            if warned is not None:
                source = 0 if data.recordings is None else int(data.recordings[row])
                number, rule = int(data.episodes[row]), int(judgement.rule[row])
                onsets.append(Onset(source, number, time, rule, *warned))
            done += 1
            if progress is not None and done % _TICK_ROWS == 0:
                progress(done, len(data))
        episode.close()
        counts[0] += episode.warnings
        counts[1] += episode.false
    return WarningRecord(horizon, tuple(onsets), *counts)


def _forecasts(timeline: Timeline, forecaster: Forecaster, rows: np.ndarray) -> Iterator[Forecast]:
    data, judgement = timeline.data, timeline.judgement
    for row in rows.tolist():
        forecaster.add(int(data.stamps_ns[row]), data.values[row])
        verdict = Verdict(judgement.verdict[row])
        yield forecaster.forecast(verdict, int(judgement.rule[row]))


class _Episode:
    """Warnings of one episode, sample by sample."""

    def __init__(self, horizon: float, bridge: float) -> None:
        self._horizon, self._bridge = horizon, bridge
        # Of which it is not known yet whether they were false; the last one may still be active.
        self._open: list[_Warning] = []
        # When the last violation ended, as it ends with the next sample; inf while it lasts.
        self._ended = -math.inf
        self._is_first = True
        self.warnings = self.false = 0

    def add(self, time: float, verdict: Verdict, forecast: Forecast) -> tuple[float, int] | None:
        """Take a sample; where a violation begins, return how long it was warned of, and by what.

        Args:
            time: of the sample in seconds.
            verdict: on it.
            forecast: from it.
        """
        is_first, self._is_first = self._is_first, False
        if verdict is Verdict.VIOLATED:
            is_new = time - self._ended > self._bridge
            self._ended = math.inf
            true = [item for item in self._open if time - item.last <= self._horizon]
            self.false += len(self._open) - len(true)
            self._open.clear()
            if is_first or not is_new:
                return None
            return (time - true[-1].start, true[-1].feature) if true else (0.0, -1)
        self._ended = min(self._ended, time)
        if verdict is Verdict.SAFE and forecast.seconds <= self._horizon:
            if not self._open or time - self._open[-1].last > self._bridge:
                self._open.append(_Warning(time, time, forecast.feature))
                self.warnings += 1
            self._open[-1].last = time
        return None

    def close(self) -> None:
        """End the episode; nothing comes of the warnings that are open."""
        self.false += len(self._open)
        self._open.clear()
