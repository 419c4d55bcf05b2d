# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Clocks of recordings: header stamps against log times, and what is odd about them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

DAY_NS = 86_400 * 10**9
# Clocks that are further apart than this are not the same one; transport takes less.
_OTHER_CLOCK_S = 2.0
# A share of messages under one log time that no recorder has by chance.
_BURSTS = 0.2


@dataclass(frozen=True)
class ClockReadings:
    """The header stamps of a topic against the times at which its messages were logged.

    Attributes:
        lag_s: median of log time less stamp, in s; NaN where no message has a stamp.
        least_lag_s: smallest.
        greatest_lag_s: largest.
        unstamped: share of the messages whose stamp is 0.
        steps_back: how often a stamp lies before the one before.
        leap_s: largest step from one stamp to the next, in s.
        repeated: share of the messages with the stamp of the one before.
        bursts: share of the messages with another stamp than the one before, but its log time.
    """

    lag_s: float
    least_lag_s: float
    greatest_lag_s: float
    unstamped: float
    steps_back: int
    leap_s: float
    repeated: float
    bursts: float

    @classmethod
    def of(cls, stamps_ns: np.ndarray, times_ns: np.ndarray) -> ClockReadings:
        """Compare (n,) stamps, 0 for none, with (n,) log times, n > 0."""
        known = stamps_ns != 0
        stamps, times = stamps_ns[known], times_ns[known]
        lags = (times - stamps) * 1e-9
        steps, logged = np.diff(stamps), np.diff(times)
        return cls(
            lag_s=float(np.median(lags)) if len(lags) else math.nan,
            least_lag_s=float(lags.min()) if len(lags) else math.nan,
            greatest_lag_s=float(lags.max()) if len(lags) else math.nan,
            unstamped=float(1.0 - known.mean()),
            steps_back=int(np.count_nonzero(steps < 0)),
            leap_s=float(steps.max()) * 1e-9 if len(steps) else math.nan,
            repeated=float(np.mean(steps == 0)) if len(steps) else 0.0,
            bursts=float(np.mean((logged == 0) & (steps != 0))) if len(steps) else 0.0,
        )


def clock_warnings(clocks: Mapping[str, ClockReadings]) -> Iterator[str]:
    """Yield a sentence for each thing that is odd about the clocks of a recording.

    Args:
        clocks: topic to what its stamps say.
    """
    stamped = {topic: clock for topic, clock in clocks.items() if not math.isnan(clock.lag_s)}
    if stamped:
        ordered = sorted(stamped, key=lambda topic: stamped[topic].lag_s)
        first, last = ordered[0], ordered[-1]
        apart = stamped[last].lag_s - stamped[first].lag_s
        if apart > _OTHER_CLOCK_S:
            yield (
                f'the stamps of {last} are {apart:.3g} s behind those of {first}: they are of two '
                'clocks, so one is missing beside the other by max_age, unless its features have '
                'age_by: arrival'
            )
    for topic, clock in clocks.items():
        if clock.steps_back:
            yield f'the stamps of {topic} go back {clock.steps_back} times'
        if clock.leap_s * 1e9 > DAY_NS:
            yield f'the stamps of {topic} leap ahead by {clock.leap_s / 86_400:.3g} days'
        if clock.bursts > _BURSTS:
            yield (
                f'{clock.bursts:.0%} of the messages on {topic} have the log time of the one '
                'before, but another stamp: they were logged in bursts'
            )
        if clock.repeated > _BURSTS:
            yield (
                f'{clock.repeated:.0%} of the messages on {topic} have the stamp of the one '
                'before: its clock stands still'
            )
