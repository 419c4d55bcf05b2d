# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rows of one recording, with their times and episodes, while they are collected."""

from __future__ import annotations

import json

import numpy as np

from occ_constraints_pkg.datasets.blocks import RowBlock
from occ_constraints_pkg.datasets.dataset import ORIGIN
from occ_constraints_pkg.datasets.manifest import Selection
from occ_constraints_pkg.errors import DataError


class CollectedRows:
    """The rows of one recording while they are collected.

    Attributes:
        values, stamps, times, origins, costs: arrays of each block of rows, as a dataset has them.
        episodes: (n,) set by :meth:`number_episodes`.
        has_cost: whether some rows came with a true cost.
        where: what to add to a sentence that no row was there.
    """

    def __init__(self) -> None:
        self.values: list[np.ndarray] = []
        self.stamps: list[np.ndarray] = []
        self.times: list[np.ndarray] = []
        self.origins: list[np.ndarray] = []
        self.costs: list[np.ndarray] = []
        self.episodes = np.empty(0, dtype=np.int64)
        self.has_cost = False
        self.where = ''
        self._first_ns = 0
        self._episodes: list[np.ndarray] = []
        self._met: set[tuple[str, int]] = set()
        self._last_ns = 0

    def add(self, rows: RowBlock, times_ns: np.ndarray, selection: Selection) -> None:
        """Add those rows that lie in a stretch to use; their times are from the first message."""
        stretches = selection.stretches(times_ns)
        for key in ('include', 'exclude'):
            for number, (low, high) in enumerate(getattr(selection, key)):
                if ((low <= times_ns) & (times_ns < high)).any():
                    self._met.add((key, number))
        count = len(rows.values)
        self._last_ns = max(self._last_ns, int(times_ns.max())) if count else self._last_ns
        columns = () if rows.table is None else rows.table.names
        has_cost, has_episodes = 'true_cost' in columns, 'episode' in columns
        nothing = np.zeros(count)
        robots = np.arange(count) if has_episodes else nothing
        numbers = rows.table.column('episode').astype(np.float64) if has_episodes else nothing
        cost = rows.table.column('true_cost') if has_cost else np.full(count, np.nan)
        origins = np.empty(count, dtype=ORIGIN)
        origins['time_ns'] = rows.times_ns
        # Rows of a table are of one message, others of one message each.
        origins['row'] = 0 if rows.table is None else np.arange(count)
        if rows.table is not None:
            # A simulation steps faster or slower than it is recorded.
            self._first_ns = self._first_ns or int(rows.stamps_ns[0])
            times_ns = rows.stamps_ns - self._first_ns
        used = stretches >= 0
        if not used.any():
            self.where = ', in the intervals to use' if count else self.where
            return
        self.has_cost = self.has_cost or has_cost
        self.values.append(rows.values[used])
        self.stamps.append(rows.stamps_ns[used])
        self.times.append(times_ns[used])
        self.origins.append(origins[used])
        self.costs.append(cost[used].astype(np.float64))
        self._episodes.append(np.stack([robots, numbers, stretches], axis=1)[used])

    def unused(self, selection: Selection, where: str) -> list[str]:
        """Return a sentence for each time of a manifest that makes no difference to the rows."""
        parts = selection.to_document()
        sentences = [
            f'{where}: no row lies in the interval {json.dumps(interval)} s, '
            f'which the manifest {key}s'
            for key in ('include', 'exclude')
            for number, interval in enumerate(parts.get(key, ()))
            if (key, number) not in self._met
        ]
        return sentences + [
            f'{where}: the last row is at {self._last_ns / 1e9:g} s, before the episode that the '
            f'manifest begins at {time / 1e9:g} s'
            for time in selection.episodes
            if time > self._last_ns
        ]

    def number_episodes(self, first: int, where: str) -> int:
        """Number the episodes from ``first`` on; return how many there are.

        Raises:
            OccError: the column ``episode`` holds something that is not finite.
        """
        triples = np.concatenate(self._episodes)
        if not np.isfinite(triples).all():
            raise DataError(f"{where} has values that are not finite in the column 'episode'")
        # Sorting rows takes longer than reading them, and mostly there is little to sort by.
        varying = (triples != triples[0]).any(axis=0)
        if varying.sum() < 2:
            keys, axis = triples[:, varying.argmax()], None
        else:
            keys, axis = triples, 0
        unique, inverse = np.unique(keys, axis=axis, return_inverse=True)
        self.episodes = inverse.reshape(-1).astype(np.int64) + first
        return len(unique)
