# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rows that are searched, and what one may ask about them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from occ_constraints_pkg.learning.conditional.units import BELOW, EQUAL, Cut, Unit

MOST_ROWS = 40_000
"""Rows that are searched at most."""


class Rows:
    """Values of all units on some rows."""

    def __init__(
        self,
        units: Sequence[Unit],
        columns: Sequence[np.ndarray],
        following: Sequence[np.ndarray],
        goes_on: np.ndarray,
    ) -> None:
        """Keep them.

        Args:
            units: what the rows have values of.
            columns: for each unit (n,) values; of units that nobody asks about, anything.
            following: for each unit (n,) values a sample later.
            goes_on: (n,) bool, whether there is a sample later.
        """
        self.units = units
        self.columns = columns
        self._following = following
        self._goes_on = goes_on

    def __len__(self) -> int:
        return len(self._goes_on)

    def take(self, chosen: np.ndarray, needed: Iterable[int]) -> Rows:
        """Return some of the rows, with the values of some units.

        Args:
            chosen: (n,) bool.
            needed: positions of the units.
        """
        empty = np.empty(0)
        columns, following = [empty] * len(self.units), [empty] * len(self.units)
        for unit in needed:
            columns[unit] = self.columns[unit][chosen]
            following[unit] = self._following[unit][chosen]
        return Rows(self.units, columns, following, self._goes_on[chosen])

    def stays(self, cuts: Iterable[Cut], inside: np.ndarray) -> int:
        """Return in how many of the rows in a corner the next sample is in it, too.

        Args:
            cuts: the corner's literals.
            inside: (n,) bool, the rows in it.
        """
        rows = np.flatnonzero(inside & self._goes_on)
        still = np.ones(len(rows), dtype=bool)
        for cut in cuts:
            values = self._following[cut.unit][rows]
            still &= self.units[cut.unit].is_true(values, cut.side, cut.bound)
        return int(still.sum())

    def is_true(self, cut: Cut) -> np.ndarray:
        """Tell for each row whether one literal is true: (n,) bool."""
        return self.units[cut.unit].is_true(self.columns[cut.unit], cut.side, cut.bound)

    def inside(self, cuts: Iterable[Cut]) -> np.ndarray:
        """Tell for each row whether all of some literals are true: (n,) bool."""
        found = np.ones(len(self), dtype=bool)
        for cut in cuts:
            found &= self.is_true(cut)
        return found


class Sample(Rows):
    """Evenly chosen rows of whole recordings, in the order of time.

    Attributes:
        clusters: (n,) int, what evidence counts: the episode, or the recording, of each row.
        cluster_count: how many of these there are.
        cluster_shares: (clusters,) share of the rows of each.
        ordered: for each unit its values, ascending.
        ranges: for each unit its least and largest value.
    """

    def __init__(
        self,
        units: Sequence[Unit],
        columns: Sequence[np.ndarray],
        following: Sequence[np.ndarray],
        goes_on: np.ndarray,
        clusters: np.ndarray,
    ) -> None:
        """Sort them and count.

        Args:
            units: what the rows have values of.
            columns: for each unit (n,) values.
            following: for each unit (n,) values a sample later.
            goes_on: (n,) bool, whether there is a sample later.
            clusters: (n,) what evidence counts.
        """
        super().__init__(units, columns, following, goes_on)
        self.clusters = np.unique(clusters, return_inverse=True)[1]
        self.cluster_count = int(self.clusters.max()) + 1
        self.cluster_shares = np.bincount(self.clusters) / len(self)
        self.ordered = [np.sort(column) for column in columns]
        self.ranges = [(float(column[0]), float(column[-1])) for column in self.ordered]

    @cached_property
    def ranks(self) -> list[np.ndarray]:
        """For each unit the rank of each row, within 0 to 1: (n,)."""
        out = []
        for column in self.columns:
            rank = np.empty(len(self))
            rank[np.argsort(column, kind='stable')] = (np.arange(len(self)) + 0.5) / len(self)
            out.append(rank)
        return out

    def volume(self, cut: Cut) -> float:
        """Return the share of its unit's range that a literal takes; of samples, if discrete."""
        if self.units[cut.unit].is_discrete:
            return float(self.is_true(cut).mean())
        low, high = self.ranges[cut.unit]
        depth = cut.bound - low if cut.side == BELOW else high - cut.bound
        return max(0.0, depth) / (high - low)

    def volume_of(self, cuts: Iterable[Cut]) -> float:
        """Return the share of the units' ranges that a corner takes."""
        return float(np.prod([self.volume(cut) for cut in cuts]))

    def half_as_deep(self, cut: Cut) -> Cut:
        """Return the literal that reaches half as deep; of discrete values the same."""
        if cut.side == EQUAL or self.units[cut.unit].is_discrete:
            return cut
        end = self.ranges[cut.unit][0 if cut.side == BELOW else 1]
        return cut._replace(bound=(end + cut.bound) / 2)
