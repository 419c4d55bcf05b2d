# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Whether an empty corner becomes a rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull
from occ_constraints_pkg.learning.conditional.expectation import Expectation
from occ_constraints_pkg.learning.conditional.placing import (
    bad_density,
    fit_bounds,
    place,
    step_back,
)
from occ_constraints_pkg.learning.conditional.price import Seen, allowed_bad, worth
from occ_constraints_pkg.learning.conditional.sample import Rows, Sample
from occ_constraints_pkg.learning.conditional.units import EQUAL, Cut

MOST_OUTSIDE = 0.01
"""Share of the demonstrations that all conditional rules together may see."""

# A rule is worth at least this share of what is expected in it.
_LEAST_WORTH = 0.2
# Strips that are tried until episodes left out are hardly flagged, and what share that is.
_STRIPS = (1.0, 3.0, 9.0)
_FOLDS = 5
_MOST_LEFT_OUT = 0.001

Way = tuple[tuple[int, int, float | None], ...]


@dataclass(frozen=True)
class Found:
    """A rule during the search.

    Attributes:
        cuts: its literals.
        expected: share of the time.
        seen: share of the rows that are in no earlier rule.
        evidence: that it is no chance.
        strip: independent visits between its bounds and the data.
    """

    cuts: tuple[Cut, ...]
    expected: float
    seen: float
    evidence: float
    strip: float = 1.0

    @property
    def is_gap(self) -> bool:
        """Whether it is a range of one unit."""
        return len({cut.unit for cut in self.cuts}) == 1

    @property
    def way(self) -> Way:
        """Which units it is about and which ends of them, whatever the bounds."""
        return way_of(self.cuts)


def way_of(cuts: Sequence[Cut]) -> Way:
    """Return which units a corner is about and which ends of them, whatever the bounds."""
    return tuple((cut.unit, cut.side, cut.bound if cut.side == EQUAL else None) for cut in cuts)


class Acceptance:
    """Judges candidates, given the rules so far."""

    def __init__(
        self, sample: Sample, expectation: Expectation, correlation: CorrelationNull
    ) -> None:
        """Keep what it judges by."""
        self._sample = sample
        self._expectation = expectation
        self._correlation = correlation
        fold = np.random.default_rng(0).permutation(sample.cluster_count) % _FOLDS
        self._fold = fold[sample.clusters]

    def judge(
        self,
        cuts: Sequence[Cut],
        needed: float,
        least: float,
        seen_by_others: float,
        *,
        proven: bool,
    ) -> Found | None:
        """Return a candidate as a rule with its bounds placed, or ``None``.

        Args:
            cuts: its literals.
            needed: evidence that it needs.
            least: share of the time that has to be expected in it.
            seen_by_others: share of the rows that the rules so far see.
            proven: whether a rule of the same way is already shown to be more than correlation.
        """
        visits = self._expectation.corner(cuts).evidence
        if visits < needed / 2:
            return None
        strip = self._steady(cuts, visits)
        if strip is None:
            return None
        placed = place(self._sample, self._sample, self._expectation.free, cuts, visits / strip)
        share = self._expectation.share(placed)
        # That the corner is empty is proven by all of it, also by the strip that the rule leaves.
        evidence = max(self._evidence(corner, proven) for corner in (cuts, placed))
        new = float((self._sample.inside(placed) & self._expectation.free).mean())
        found = Found(placed, share, new, evidence, strip)
        sound = (
            share >= least
            and evidence >= needed
            and seen_by_others + found.seen <= MOST_OUTSIDE
            and is_empty(self._sample, self._sample, found)
        )
        return found if sound else None

    def _evidence(self, cuts: Sequence[Cut], proven: bool) -> float:
        """Return the evidence of a corner, as far as correlation does not explain it."""
        evidence = self._expectation.corner(cuts).evidence
        if len(cuts) == 2 and not proven:
            evidence *= self._correlation.share_at(*cuts)
        return evidence

    def _steady(self, cuts: Sequence[Cut], visits: float) -> float | None:
        """Return the first strip at which bounds placed without some episodes hardly flag these.

        ``None`` if there is no such strip.
        """
        sample, free = self._sample, self._expectation.free
        if sample.cluster_count < _FOLDS:
            return _STRIPS[0]
        needed = {cut.unit for cut in cuts}
        folds = []
        for fold in range(_FOLDS):
            others, left_out = self._fold != fold, (self._fold == fold) & free
            fitted = fit_bounds(sample, sample.take(others, needed), free[others], cuts)
            folds.append((fitted, sample.take(left_out, needed)))
        bad = allowed_bad(sample.volume_of(cuts), bad_density(sample, sample, cuts))
        for strip in _STRIPS:
            flagged = sum(
                int(left_out.inside(step_back(sample, fitted, visits / strip)).sum())
                for fitted, left_out in folds
            )
            if flagged / len(sample) <= _MOST_LEFT_OUT + bad:
                return strip
        return None


def is_empty(sample: Sample, rows: Rows, found: Found) -> bool:
    """Tell whether a rule sees little enough of some rows.

    Args:
        sample: the searched rows, which say how values are distributed.
        rows: what ``found.seen`` is a share of, earlier rules left out.
        found: the rule.
    """
    gain = worth(
        found.expected,
        Seen(float(rows.inside(found.cuts).mean()), found.seen),
        sample.volume_of(found.cuts),
        bad_density(sample, rows, found.cuts),
    )
    return float(gain) >= _LEAST_WORTH * found.expected
