# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""All rows in the order of time, and the sample of them that is searched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.learning.conditional.sample import MOST_ROWS, Rows, Sample
from occ_constraints_pkg.learning.conditional.units import Unit


class Table:
    """Rows in the order of time; columns are copied when they are asked for.

    Attributes:
        units: what the rows have values of.
        order: (n,) positions of the rows among the samples.
        goes_on: (n,) bool, whether the next row is the next one of the same episode.
        episode_numbers: (n,) the number of each row's episode, ascending from 0.
    """

    def __init__(
        self,
        values: np.ndarray,
        units: Sequence[Unit],
        order: np.ndarray,
        episodes: np.ndarray,
    ) -> None:
        self.units = units
        self.order = order
        labels = episodes[order]
        self.goes_on = np.append(labels[1:] == labels[:-1], False)[: len(order)]
        self.episode_numbers = np.concatenate(([0], np.cumsum(~self.goes_on)))[: len(order)]
        self._values = values

    def __len__(self) -> int:
        return len(self.order)

    def column(self, unit: int) -> np.ndarray:
        """Return the (n,) values of a unit."""
        return self.units[unit].of(self._values)[self.order]

    def rows(self, needed: set[int]) -> Rows:
        """Return all rows, with the values of some units."""
        empty = np.empty(0)
        columns = [
            self.column(unit) if unit in needed else empty for unit in range(len(self.units))
        ]
        following = [column[1:] for column in columns]
        return Rows(self.units, columns, following, self.goes_on)

    def sample(self, is_bad: np.ndarray, clusters: np.ndarray) -> Sample:
        """Return some of the rows that are not bad, evenly chosen."""
        good = np.flatnonzero(~is_bad)
        chosen = good[:: max(1, -(-len(good) // MOST_ROWS))]
        later = np.minimum(chosen + 1, len(self) - 1)
        columns, following = (
            [unit.of(self._values[self.order[rows]]) for unit in self.units]
            for rows in (chosen, later)
        )
        labels = clusters[self.order[chosen]]
        return Sample(self.units, columns, following, self.goes_on[chosen], labels)
