# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How much time would be spent in a corner, were its parts independent of each other.

Each member of the corner in turn is taken from another place of the recordings (its values are
rolled along them, so that what lasts still lasts), and all else stays as it was. The least over the
members counts, and rows that earlier rules forbid do not count at all. So nothing is expected where
a bound, fewer literals, or an earlier rule explain the emptiness already.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.learning.conditional.evidence import cluster_evidence, visit_evidence
from occ_constraints_pkg.learning.conditional.grid import Grid
from occ_constraints_pkg.learning.conditional.price import Seen
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import Cut

# The columns of few rows are rolled several times, until there are so many reference rows.
_REFERENCE_ROWS = 30_000
_MOST_COPIES = 20
_GOLDEN = (math.sqrt(5) - 1) / 2


class Expected(NamedTuple):
    """What is expected in a corner.

    Attributes:
        share: of the time.
        evidence: that it is no chance to see as little as was seen.
    """

    share: float
    evidence: float


class Expectation:
    """What is expected in corners, given the rules so far."""

    def __init__(self, sample: Sample) -> None:
        """Choose by how much columns are rolled: by 10 to 90 % of the recordings' length."""
        self.sample = sample
        rows = len(sample)
        self.copies = max(1, min(_MOST_COPIES, -(-_REFERENCE_ROWS // rows)))
        shifts = [
            int(rows * (0.1 + 0.8 * ((copy + 1) * _GOLDEN % 1))) for copy in range(self.copies)
        ]
        self._elsewhere = np.concatenate([(np.arange(rows) - shift) % rows for shift in shifts])
        self._cluster_keys = np.concatenate(
            [sample.clusters + copy * sample.cluster_count for copy in range(self.copies)]
        )
        self.free = np.ones(rows, dtype=bool)
        self._free_rolled: dict[int, np.ndarray] = {}

    def forbid(self, rules: Sequence[tuple[Cut, ...]]) -> None:
        """Set the rules so far, whose rows do not count.

        Attributes changed: ``free`` tells which rows none of them forbids.
        """
        sample = self.sample
        self.free = np.ones(len(sample), dtype=bool)
        for rule in rules:
            self.free &= ~sample.inside(rule)
        everywhere = self._tiled(self.free)
        self._free_rolled = {}
        for unit in range(len(sample.units)):
            free = everywhere
            concerned = [rule for rule in rules if any(cut.unit == unit for cut in rule)]
            if concerned:
                free = everywhere.copy()
                for rule in concerned:
                    free &= ~self._inside(rule, unit)
            self._free_rolled[unit] = free

    def corner(self, cuts: Sequence[Cut], seen: np.ndarray | None = None) -> Expected:
        """Return what is expected in a corner: the least over its members.

        Args:
            cuts: its literals.
            seen: (n,) bool, the rows in it; by default those of the sample.
        """
        sample = self.sample
        if seen is None:
            seen = sample.inside(cuts)
        came = np.bincount(sample.clusters[seen & self.free], minlength=sample.cluster_count) > 0
        share, evidence = math.inf, math.inf
        for unit in {cut.unit for cut in cuts}:
            counts = self._counts(cuts, unit)
            share = min(share, float(counts.sum()) / (self.copies * len(sample)))
            proven = max(
                visit_evidence(counts, sample.cluster_shares, float(seen.sum())),
                cluster_evidence(counts, float(came.mean())),
            )
            evidence = min(evidence, proven)
        return Expected(share, evidence)

    def share(self, cuts: Sequence[Cut]) -> float:
        """Return the share of the time that is expected in a corner."""
        return min(
            float(self._counts(cuts, unit).sum()) / (self.copies * len(self.sample))
            for unit in {cut.unit for cut in cuts}
        )

    def corners(self, i: int, one: Grid, j: int, other: Grid) -> tuple[Seen, np.ndarray]:
        """Return what is seen and what is expected in all corners of two units.

        Args:
            i: position of a unit.
            one: its grid, of a literals.
            j: position of another.
            other: the other's, of b literals.

        Returns:
            What is seen, of shapes (a, b), and the share of the time that is expected: (a, b).
        """
        rows = len(self.sample)
        everything = np.ones(rows, dtype=bool)
        seen, new = (
            _table(one, one.codes, other, other.codes, chosen) / rows
            for chosen in (everything, self.free)
        )
        rolled = _table(
            one, self._rolled(one.codes), other, self._tiled(other.codes), self._free_rolled[i]
        )
        other_rolled = _table(
            one, self._tiled(one.codes), other, self._rolled(other.codes), self._free_rolled[j]
        )
        return Seen(seen, new), np.minimum(rolled, other_rolled) / (rows * self.copies)

    def _counts(self, cuts: Sequence[Cut], rolled: int) -> np.ndarray:
        """Return (copies, clusters) rows in a corner where one unit is taken from elsewhere."""
        inside = self._inside(cuts, rolled) & self._free_rolled[rolled]
        count = self.sample.cluster_count
        keys = np.bincount(self._cluster_keys[inside], minlength=self.copies * count)
        return keys.reshape(self.copies, count)

    def _inside(self, cuts: Sequence[Cut], rolled: int) -> np.ndarray:
        """Tell for each reference row of one rolled unit whether it is in a corner."""
        own = [cut for cut in cuts if cut.unit == rolled]
        others = [cut for cut in cuts if cut.unit != rolled]
        return self._rolled(self.sample.inside(own)) & self._tiled(self.sample.inside(others))

    def _rolled(self, column: np.ndarray) -> np.ndarray:
        return column[self._elsewhere]

    def _tiled(self, column: np.ndarray) -> np.ndarray:
        return np.tile(column, self.copies)


def _table(
    one: Grid, codes: np.ndarray, other: Grid, other_codes: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """Return the number of rows in each corner of two grids, (a, b), given the cells of each."""
    keys = (codes * other.cells + other_codes)[rows]
    counts = np.bincount(keys, minlength=one.cells * other.cells)
    return one.member @ counts.reshape(one.cells, other.cells) @ other.member.T
