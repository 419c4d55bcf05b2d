# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Time to violation: when a rule becomes true if all features go on changing as they do now."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.ruleset import RuleSet

# Fewer samples give no rate of change that deserves the name.
_LEAST_SAMPLES = 3


@dataclass(frozen=True)
class Forecast:
    """The next violation, as estimated.

    Attributes:
        seconds: until it begins; 0 if it is there.
        rule: position of the rule in the rule set.
        feature: position of the feature that decides: its literal is the last to become true.
    """

    seconds: float
    rule: int
    feature: int


class Forecaster:
    """Extrapolates the features of one robot along straight lines.

    The rate of change of each feature is the slope of the least-squares line through the samples
    of the last ``window`` seconds. A rule becomes true when all its literals hold at once, which
    under straight lines is the overlap of intervals. It is an estimate: it knows no dynamics and
    no intention.

    Args:
        rule_set: the rules.
        window: seconds of samples that give the rate of change. Samples further apart give none.

    Raises:
        OccError: the window is not above 0.
    """

    def __init__(self, rule_set: RuleSet, window: float = 0.5) -> None:
        if not window > 0.0:
            raise OccError(f'the window is {window} s; allowed is a time above 0 s')
        self._window = window
        self._order, self._space = rule_set.order, rule_set.space
        conjunctions = [rule_set.rules[index].literals for index in rule_set.order]
        literals = [literal for conjunction in conjunctions for literal in conjunction]
        self._starts = np.cumsum([0, *map(len, conjunctions[:-1])]).astype(np.int64)
        self._feature = np.array([literal.feature for literal in literals], dtype=np.int64)
        self._sign = np.array([-1.0 if literal.is_upper else 1.0 for literal in literals])
        self._bound = self._sign * np.array([literal.bound for literal in literals])
        self._samples: deque[tuple[float, np.ndarray]] = deque()

    def add(self, seconds: float, sample: np.ndarray) -> Forecast | None:
        """Take the next sample and look ahead.

        Args:
            seconds: its time. One that is not later than the last, or later by more than the
                window, begins anew.
            sample: (k,) features. One with a value that is not finite begins anew as well.

        Returns:
            The first violation to come, or ``None`` if none is in sight or too little is known.
        """
        values = np.asarray(sample, dtype=np.float64)
        if not np.isfinite(values).all():
            self._samples.clear()
            return None
        if self._samples and not 0.0 < seconds - self._samples[-1][0] <= self._window:
            self._samples.clear()
        self._samples.append((seconds, values))
        while seconds - self._samples[0][0] > self._window:
            self._samples.popleft()
        if not len(self._order) or len(self._samples) < _LEAST_SAMPLES:
            return None
        return self._look_ahead(values, self._rates())

    def _rates(self) -> np.ndarray:
        times = np.array([time for time, _ in self._samples])
        values = np.stack([values for _, values in self._samples])
        times -= times.mean()
        return times @ (values - values.mean(axis=0)) / (times @ times)

    def _look_ahead(self, values: np.ndarray, rates: np.ndarray) -> Forecast | None:
        short_of = self._bound - self._sign * values[self._feature]
        speed = self._sign * rates[self._feature]
        with np.errstate(divide='ignore', invalid='ignore'):
            reached = short_of / speed
        begins = np.where(short_of <= 0.0, 0.0, np.where(speed > 0.0, reached, np.inf))
        ends = np.where((short_of <= 0.0) & (speed < 0.0), reached, np.inf)
        first = np.maximum.reduceat(begins, self._starts)
        first[first > np.minimum.reduceat(ends, self._starts)] = np.inf
        soonest = int(first.argmin())
        if not np.isfinite(first[soonest]):
            return None
        end = self._starts[soonest + 1] if soonest + 1 < len(self._starts) else len(begins)
        last = self._starts[soonest] + int(begins[self._starts[soonest] : end].argmax())
        return Forecast(float(first[soonest]), int(self._order[soonest]), int(self._feature[last]))
