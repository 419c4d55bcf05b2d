# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Judges many samples: block by block, and in a block column by column."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from occ_constraints_pkg.rules.formula import Disjunction, safe_box
from occ_constraints_pkg.rules.program import Program
from occ_constraints_pkg.rules.space import FeatureSpace

# Numbers per block. Larger ones do not stay in the second-level cache, with smaller ones the
# calls themselves take longer than what they compute.
_BLOCK = 2**18
_FEWEST_ROWS = 16


class Columns:
    """Evaluates a formula on blocks of samples with whole columns as operands.

    Args:
        space: the features.
        formula: true where there is a violation.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, space: FeatureSpace, formula: Disjunction, scale: np.ndarray) -> None:
        self._formula, self._scale = formula, scale
        self._bounds = space.finite_bounds[:, :, None]
        self._box = safe_box(space, formula)[:, :, None]

    @cached_property
    def _truth(self) -> Program:
        """The truth of the parts; the single literals are in the box."""
        return Program(Disjunction((), self._formula.parts), len(self._scale))

    @cached_property
    def _margin(self) -> Program:
        return Program(self._formula, len(self._scale), self._scale)

    def passed(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) whether samples are known and the formula is false, for (n, k) float64."""
        passed = np.empty(len(rows), dtype=bool)
        for block, columns in self._blocks(rows):
            # For truth values greater is "and not".
            np.greater(_within(columns, self._box), self._truth.run(columns), out=passed[block])
        return passed

    def margins(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) whether samples are known, and (n,) their margins, any where not."""
        known, margin = np.empty(len(rows), dtype=bool), np.empty(len(rows))
        for block, columns in self._blocks(rows):
            known[block] = _within(columns, self._bounds)
            # Adding 0 leaves no minus zero.
            np.add(self._margin.run(columns), 0.0, out=margin[block])
        return known, margin

    def _blocks(self, rows: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield blocks of rows as (k, size) columns, in memory that the next block uses again."""
        features = rows.shape[1]
        size = max(_BLOCK // features, _FEWEST_ROWS)
        memory = np.empty((features, min(size, len(rows))))
        for start in range(0, len(rows), size):
            block = slice(start, min(start + size, len(rows)))
            columns = memory[:, : block.stop - start]
            np.copyto(columns, rows[block].T)
            yield block, columns


def _within(columns: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return (n,) whether all features lie in a box (2, k, 1); NaN never does."""
    inside = columns >= bounds[0]
    np.logical_and(inside, columns <= bounds[1], out=inside)
    return np.logical_and.reduce(inside, axis=0)
