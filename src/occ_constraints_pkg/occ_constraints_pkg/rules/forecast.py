# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When the next rule will be violated, if every feature goes on as it does now: an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

WINDOW_SECONDS = 0.5
"""Default window for the rate of change."""

HORIZON_SECONDS = 1.0
"""Default time ahead within which an estimated violation is warned of."""

# A straight line through fewer rows does not average their noise.
_FEWEST_ROWS = 3
# Rows kept at most; a window of more is cut.
_MOST_ROWS = 2000


@dataclass(frozen=True)
class Forecast:
    """The next violation at the present rates of change.

    Attributes:
        seconds: until the first rule is violated; 0 when one is, ``inf`` when none is foreseen or
            too little was seen, NaN when the newest row cannot be judged.
        rule: position of that rule in the rule set; -1 for none.
        feature: position of the feature that reaches its bound last; -1 for none.
    """

    seconds: float
    rule: int = -1
    feature: int = -1


class Forecaster:
    """Extrapolates the features of one robot along straight lines.

    The slope of each feature is that of the least-squares line through its values within the
    window; the line is laid through the newest value. A feature that was not finite in a row is
    left out there; one with fewer than three finite values counts as constant. Nothing is foreseen
    before three rows have come and half the window is filled.

    Args:
        rule_set: whose enabled rules are watched.
        window: seconds.

    Raises:
        ConfigurationError: the window is no number above 0.
    """

    def __init__(self, rule_set: RuleSet, window: float = WINDOW_SECONDS) -> None:
        if not 0.0 < window < math.inf:
            raise ConfigurationError(
                f'window: got {window}; allowed is a number of seconds above 0'
            )
        self._rules = rule_set
        self._rows = _Window(len(rule_set.space), window)
        self._table = table = rule_set.table
        # One entry for each member of each literal.
        counts = [len(literal.members) for literal in table.literals]
        members = [member for literal in table.literals for member in literal.members]
        self._feature = np.array(members, dtype=np.intp)
        self._sign = np.repeat(table.sign[:, 0], counts)
        self._threshold = np.repeat(table.threshold[:, 0], counts)
        # Where those of each literal begin; none if all have one.
        self._begins: np.ndarray | None = None
        if len(members) > len(counts):
            self._begins = np.cumsum([0, *counts], dtype=np.intp)[:-1]
        rules = [rule_set.rules[index] for index in rule_set.order]
        self._rule = np.repeat(np.arange(len(rules)), [len(rule.literals) for rule in rules])
        # How often a time may have to move on: to where all literals have become true; for ever, if
        # another one is not true any more there; and once for each that becomes true again.
        families = (
            sum(item.is_family for item in rule.literals)
            for rule in rules
            if len(rule.literals) > 1
        )
        self._moves = 2 + max(families, default=-1)

    def reset(self) -> None:
        """Drop all rows: the next one does not continue them."""
        self._rows.clear()

    def add(self, stamp_ns: int, row: np.ndarray) -> None:
        """Take one row.

        Args:
            stamp_ns: an earlier stamp than the previous row's resets, an equal one replaces that
                row.
            row: (k,) features.
        """
        self._rows.add(stamp_ns, row)

    def forecast(self, verdict: Verdict, rule: int) -> Forecast:
        """Estimate when a rule will be violated.

        Args:
            verdict: on the row that was added last.
            rule: position of the first rule it violates; -1 for none.
        """
        if verdict is Verdict.UNKNOWN:
            return Forecast(math.nan)
        if verdict is Verdict.VIOLATED:
            return Forecast(0.0, rule, self._nearest(rule))
        # On overflow nothing is foreseen.
        with np.errstate(all='ignore'):
            slopes = self._rows.slopes() if self._table.literals else None
            return Forecast(math.inf) if slopes is None else self._first(slopes)

    def _nearest(self, rule: int) -> int:
        """Return the feature with the smallest distance into a true rule."""
        row, scale = self._rows.newest, self._rules.scale
        features = [literal.deciding(row) for literal in self._rules.rules[rule].literals]
        inside = [
            abs(literal.distances(row[feature], scale[feature]))
            for literal, feature in zip(self._rules.rules[rule].literals, features, strict=True)
        ]
        return features[inside.index(min(inside))]

    def _first(self, slopes: np.ndarray) -> Forecast:
        table = self._table
        # Adding 0 leaves no minus zero, by which a distance would change its sign.
        speed = self._sign * slopes.take(self._feature) + 0.0
        crossing = (self._threshold - self._sign * self._rows.newest.take(self._feature)) / speed
        # Where nothing moves, that is -inf for what is true, inf or NaN for what is not.
        leaves = speed < 0.0
        begins = np.where(leaves, -np.inf, crossing)
        if self._begins is None:
            ends = np.where(leaves, crossing, np.inf).take(table.places)
            own = begins.take(table.places)
            begin = np.maximum(np.maximum.reduceat(own, table.starts), 0.0)
            times = np.where(begin < np.minimum.reduceat(ends, table.starts), begin, np.inf)
        else:
            times, own = self._of_families(crossing, leaves, self._begins)
        place = int(times.argmin())
        seconds = float(times[place])
        if seconds == math.inf:
            return Forecast(seconds)
        rule = int(self._rules.order[place])
        start = table.starts[place]
        literals = slice(start, start + len(self._rules.rules[rule].literals))
        begun = np.where(own[literals] <= seconds, own[literals], -np.inf)
        last = int(table.places[literals][begun.argmax()])
        return Forecast(seconds, rule, self._arriving(last, begins))

    def _of_families(
        self, crossing: np.ndarray, leaves: np.ndarray, begins: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return when each rule is true, and since when each of its literals is.

        That any member is beyond a bound is true until the last of those that are leaves, and again
        from when the first other one arrives: each moves along a line, their maximum does not.

        Args:
            crossing: (members of all literals,) when each crosses the bound.
            leaves: likewise, whether it makes the literal false then.
            begins: where the members of each literal begin.
        """
        table = self._table
        until = np.fmax.reduceat(np.where(leaves, crossing, -np.inf), begins).take(table.places)
        since = np.fmin.reduceat(np.where(leaves, np.inf, crossing), begins).take(table.places)
        times = np.zeros(len(table.starts))
        # Each literal that is false moves the time on to where it is true; for ever, if never.
        for _ in range(self._moves):
            now = times.take(self._rule)
            now = np.where(now < until, now, np.maximum(now, since))
            times = np.maximum.reduceat(now, table.starts)
        return np.where(times < np.inf, times, np.inf), since

    def _arriving(self, literal: int, begins: np.ndarray) -> int:
        """Return the feature that makes a literal true first, of those that are going to."""
        members = self._table.literals[literal].members
        if self._begins is None:
            return members[0]
        start = self._begins[literal]
        own = begins[start : start + len(members)]
        return members[int(np.where(own >= 0.0, own, np.inf).argmin())]


class _Window:
    """The newest rows, one after the other in memory."""

    def __init__(self, features: int, length: float) -> None:
        self._length = length
        # Seconds since the stamp of the row that was first when the memory was last moved.
        self._times = np.empty(64)
        self._values = np.empty((64, features))
        self._first = self._end = 0
        self._origin_ns = self._last_ns = 0

    @property
    def newest(self) -> np.ndarray:
        """(k,) the row that came last."""
        return self._values[self._end - 1]

    def clear(self) -> None:
        self._first = self._end = 0

    def add(self, stamp_ns: int, row: np.ndarray) -> None:
        if self._end > self._first and stamp_ns <= self._last_ns:
            # A backward time jump resets; an equal stamp replaces the row.
            self._end -= 1
            if stamp_ns < self._last_ns:
                self.clear()
        if self._end == self._first:
            self.clear()
            self._origin_ns = stamp_ns
        elif self._end == len(self._times):
            self._make_room()
        self._last_ns, time = stamp_ns, (stamp_ns - self._origin_ns) * 1e-9
        self._times[self._end], self._values[self._end] = time, row
        self._end += 1
        while self._times[self._first] < time - self._length:
            self._first += 1

    def _make_room(self) -> None:
        """Move the rows to the front, of a larger memory if they fill most of this."""
        used = slice(max(self._first, self._end - _MOST_ROWS), self._end)
        # Copies, because source and target may overlap.
        times, values = self._times[used].copy(), self._values[used].copy()
        if 2 * len(times) > len(self._times):
            self._times = np.empty(2 * len(self._times))
            self._values = np.empty((len(self._times), values.shape[1]))
        shift_ns = round(times[0] * 1e9)
        self._origin_ns += shift_ns
        self._times[: len(times)] = times - shift_ns * 1e-9
        self._values[: len(times)] = values
        self._first, self._end = 0, len(times)

    def slopes(self) -> np.ndarray | None:
        """Return (k,) changes per second; None while there are too few rows."""
        times = self._times[self._first : self._end]
        if len(times) < _FEWEST_ROWS or 2.0 * (times[-1] - times[0]) < self._length:
            return None
        values = self._values[self._first : self._end]
        away = times - np.add.reduce(times) / len(times)
        slopes = away.dot(values) / away.dot(away)
        # Not finite if one of them is not, which is rare.
        if not math.isfinite(slopes.dot(slopes)):
            for feature in np.flatnonzero(~np.isfinite(slopes)):
                slopes[feature] = _slope(times, values[:, feature])
        return slopes


def _slope(times: np.ndarray, values: np.ndarray) -> float:
    """Return the slope through the finite values; 0 where there are too few, or they overflow."""
    known = np.isfinite(values)
    if np.count_nonzero(known) < _FEWEST_ROWS:
        return 0.0
    away = times[known] - times[known].mean()
    slope = float(away @ values[known] / (away @ away))
    return slope if math.isfinite(slope) else 0.0
