# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Corners of two units: the greedy search, and another look at each step of a staircase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.learning.conditional.acceptance import Acceptance, Found, Way, way_of
from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull
from occ_constraints_pkg.learning.conditional.evidence import needed_evidence
from occ_constraints_pkg.learning.conditional.expectation import Expectation
from occ_constraints_pkg.learning.conditional.grid import make_grid
from occ_constraints_pkg.learning.conditional.price import bad_share, worth
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import EQUAL, Cut

LOOKS = 16.0
"""Corners of one pair and orientation that are as good as independent."""

_CELLS = 32
# Share of the time that has to be expected in a rule, and in a further step of a staircase.
_LEAST, _LEAST_OF_STEP = 0.005, 0.002
# Rules of one way at most: the steps of a staircase. Each adds at least this share of the first, in
# time or in volume.
_MOST_STEPS = 5
_LEAST_STEP = 0.06
# Where the first costs demonstrations, each has to bring more.
_LEAST_SPOILED_STEP = 0.2
# After so many refusals a way is given up.
_MOST_REFUSED = 8
_BACKFITS = 2
# A step moves for at least this factor in what is expected in it.
_BETTER = 1.02
_VOLUME_POINTS = 4000


class _First(NamedTuple):
    """What the first rule of a way brought.

    Attributes:
        expected: share of the time.
        seen: share of the rows.
        volume: share of the units' ranges.
    """

    expected: float
    seen: float
    volume: float


class CornerSearch:
    """Finds rules about two units.

    Attributes:
        found: the rules so far, those that it was given first.
    """

    def __init__(
        self,
        sample: Sample,
        expectation: Expectation,
        correlation: CorrelationNull,
        pairs: Sequence[tuple[int, int]],
        found: Sequence[Found],
        *,
        delta: float,
        most_rules: int,
    ) -> None:
        """Cut the units into cells.

        Args:
            sample: the rows.
            expectation: of these rows.
            correlation: of these rows.
            pairs: units that may be combined.
            found: rules that there are already.
            delta: chance that there is any false rule.
            most_rules: rules in all at most.
        """
        self._sample = sample
        self._expectation = expectation
        self._pairs = list(pairs)
        self.found = list(found)
        self._most_rules = most_rules
        self._grids = [make_grid(sample, unit, _CELLS) for unit in range(len(sample.units))]
        self._correlation = correlation
        self._acceptance = Acceptance(sample, expectation, self._correlation)
        self.looks = LOOKS * sum(
            self._grids[i].orientations * self._grids[j].orientations for i, j in self._pairs
        )
        self._needed = needed_evidence(self.looks, delta)
        # By pair: what correlation leaves of each corner, and the corners that are barred.
        self._left: dict[tuple[int, int], np.ndarray] = {}
        self._barred: dict[tuple[int, int], np.ndarray] = {}
        self._gains: dict[tuple[int, int], np.ndarray] = {}
        # By way: what the first rule brought, and how many were refused.
        self._firsts: dict[Way, _First] = {}
        self._refusals: dict[Way, int] = {}

    def run(self) -> list[Found]:
        """Return the rules: those that there were, and then those that were found."""
        self._forbid()
        stale = set(self._pairs)
        while len(self.found) < self._most_rules:
            for pair in stale:
                self._gains[pair] = self._gain(pair)
            rule = self._next()
            if rule is None:
                break
            first = _First(rule.expected, rule.seen, self._new_volume(rule.cuts))
            self._firsts.setdefault(rule.way, first)
            self.found.append(rule)
            self._forbid()
            units = {cut.unit for cut in rule.cuts}
            stale = {pair for pair in self._pairs if units & set(pair)}
        for _ in range(_BACKFITS):
            self._backfit()
        return self.found

    def _forbid(self) -> None:
        self._expectation.forbid([rule.cuts for rule in self.found])

    def _next(self) -> Found | None:
        """Return the best candidate that is accepted; candidates that are refused are barred."""
        tops = {pair: self._top(pair) for pair in self._pairs}
        while tops:
            pair = max(tops, key=lambda one: tops[one])
            if tops[pair] <= _LEAST_OF_STEP:
                return None
            if pair not in self._left:
                # Only what gets to the top is worth the look at its correlation.
                i, j = pair
                one, other = self._grids[i], self._grids[j]
                self._left[pair] = self._correlation.share(i, j, one, other)
                self._gains[pair] = self._gain(pair)
            else:
                rule = self._try(pair)
                if rule is not None:
                    return rule
            tops[pair] = self._top(pair)
        return None

    def _top(self, pair: tuple[int, int]) -> float:
        gain = self._gains[pair]
        return float(gain.max()) if gain.size else -1.0

    def _try(self, pair: tuple[int, int]) -> Found | None:
        """Return the best corner of a pair as a rule; if it is refused, bar it."""
        gains = self._gains[pair]
        at = [int(place) for place in np.unravel_index(int(gains.argmax()), gains.shape)]
        cuts = tuple(
            self._grids[unit].cuts[position] for unit, position in zip(pair, at, strict=True)
        )
        way = way_of(cuts)
        steps = sum(rule.way == way for rule in self.found)
        rule = self._judge(cuts) if steps < _MOST_STEPS else None
        if rule is not None and self._is_worth_a_line(rule):
            return rule
        self._refusals[way] = self._refusals.get(way, 0) + 1
        self._bar(pair, at, entirely=steps >= _MOST_STEPS or self._refusals[way] >= _MOST_REFUSED)
        return None

    def _judge(self, cuts: Sequence[Cut]) -> Found | None:
        proven = way_of(cuts) in self._firsts
        return self._acceptance.judge(
            cuts,
            self._needed,
            _LEAST_OF_STEP if proven else _LEAST,
            sum(rule.seen for rule in self.found),
            proven=proven,
        )

    def _is_worth_a_line(self, rule: Found) -> bool:
        if rule.way not in self._firsts:
            return True
        first = self._firsts[rule.way]
        least = _LEAST_STEP if first.seen == 0 else _LEAST_SPOILED_STEP
        return (
            rule.expected >= least * first.expected
            or self._new_volume(rule.cuts) >= least * first.volume
        )

    def _bar(self, pair: tuple[int, int], at: Sequence[int], *, entirely: bool) -> None:
        """Bar the corners within a refused one, which have no more to show; or all of its way."""
        i, j = pair
        within = []
        for grid, position in ((self._grids[i], at[0]), (self._grids[j], at[1])):
            if grid.sides[position] == EQUAL:
                chosen = np.arange(len(grid.cuts)) == position
            else:
                chosen = grid.sides == grid.sides[position]
                if not entirely:
                    chosen &= grid.mass <= grid.mass[position]
            within.append(chosen)
        barred = self._barred.setdefault(pair, np.zeros(self._gains[pair].shape, dtype=bool))
        barred |= np.outer(*within)
        self._gains[pair][barred] = -1.0

    def _gain(self, pair: tuple[int, int]) -> np.ndarray:
        """Return what each corner of a pair is worth now; -1 where barred."""
        i, j = pair
        one, other = self._grids[i], self._grids[j]
        seen, expected = self._expectation.corners(i, one, j, other)
        if pair in self._left:
            expected *= self._left_of(pair)
        volume = np.outer(one.volume, other.volume)
        has_core = np.outer(one.core >= 0, other.core >= 0)
        rows = len(self._sample)
        density = bad_share(seen.share * rows, rows, volume)
        bad = np.where(has_core, density[np.ix_(one.core, other.core)], 0.0)
        gain = worth(expected, seen, volume, bad)
        if pair in self._barred:
            gain[self._barred[pair]] = -1.0
        return gain

    def _left_of(self, pair: tuple[int, int]) -> np.ndarray:
        """Return what correlation leaves; the steps after a first rule need not show it again."""
        left = self._left[pair]
        i, j = pair
        for way in self._firsts:
            if tuple(unit for unit, _, _ in way) == pair:
                (_, side, value), (_, other_side, other_value) = way
                if value is None and other_value is None:
                    left = left.copy()
                    rows = self._grids[i].sides == side
                    left[np.ix_(rows, self._grids[j].sides == other_side)] = 1.0
        return left

    def _new_volume(self, cuts: Sequence[Cut]) -> float:
        """Return the share of its units' ranges that a corner adds to the rules about them."""
        sample, rng = self._sample, np.random.default_rng(0)
        units = sorted({cut.unit for cut in cuts})
        points = {
            unit: rng.choice(sample.columns[unit], _VOLUME_POINTS)
            if sample.units[unit].is_discrete
            else rng.uniform(*sample.ranges[unit], _VOLUME_POINTS)
            for unit in units
        }

        def inside(cuts: Sequence[Cut]) -> np.ndarray:
            true = np.ones(_VOLUME_POINTS, dtype=bool)
            for cut in cuts:
                true &= sample.units[cut.unit].is_true(points[cut.unit], cut.side, cut.bound)
            return true

        new = inside(cuts)
        for rule in self.found:
            if {cut.unit for cut in rule.cuts} <= set(units):
                new &= ~inside(rule.cuts)
        return float(new.mean())

    def _backfit(self) -> None:
        """Choose each step of a staircase again, given its other steps."""
        for way in [way for way in self._firsts if all(value is None for _, _, value in way)]:
            steps = [rule for rule in self.found if rule.way == way]
            for rule in steps if len(steps) > 1 else ():
                self._replace(rule)
        self._forbid()

    def _replace(self, rule: Found) -> None:
        position = self.found.index(rule)
        everything = self.found
        self.found = everything[:position] + everything[position + 1 :]
        self._forbid()
        (first, side, _), (second, other_side, _) = rule.way
        one, other = self._grids[first], self._grids[second]
        gain = np.where(
            np.outer(one.sides == side, other.sides == other_side),
            self._gain((first, second)),
            -1.0,
        )
        a, b = np.unravel_index(int(gain.argmax()), gain.shape)
        better = self._judge((one.cuts[a], other.cuts[b]))
        now = self._expectation.share(rule.cuts)
        if better is None or better.expected <= _BETTER * now:
            better = rule
        self.found = [*everything[:position], better, *everything[position + 1 :]]
