# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A unit cut at quantiles, so that all corners of two units come from one table of counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, EQUAL, Cut, Unit

# A literal that is true of a larger share of the time is no condition.
WIDEST = 0.9
# Rare values are looked at more closely, where there are many cells.
_TAILS = np.array([0.001, 0.0025, 0.005, 0.01, 0.02])
_FINE = 16


@dataclass(frozen=True, eq=False)
class Grid:
    """A unit's cells, and all literals at their edges.

    Attributes:
        codes: (n,) int, the cell of each row.
        cells: how many cells there are.
        cuts: the literals.
        sides: (t,) their sides.
        member: (t, cells) 1 where a cell lies within a literal, else 0.
        mass: (t,) share of the rows within each.
        volume: (t,) share of the unit's range within each.
        core: (t,) position of the literal that reaches half as deep; -1 where there is none.
    """

    codes: np.ndarray
    cells: int
    cuts: tuple[Cut, ...]
    sides: np.ndarray
    member: np.ndarray
    mass: np.ndarray
    volume: np.ndarray
    core: np.ndarray

    @property
    def orientations(self) -> int:
        """How many kinds of literals there are: each side, and each value of a discrete unit."""
        return len({cut.bound if cut.side == EQUAL else (cut.side,) for cut in self.cuts})


def make_grid(sample: Sample, unit: int, cells: int) -> Grid:
    """Cut a unit.

    Args:
        sample: the rows.
        unit: position of the unit.
        cells: of about equal mass; a discrete unit has one for each value.
    """
    column, described = sample.columns[unit], sample.units[unit]
    edges = _edges(column, described, cells)
    codes = np.searchsorted(edges, column, side='right').astype(np.int32)
    count = len(edges) + 1
    cuts, member = [], []
    for cut, true in _literals(unit, described, edges):
        mass = np.bincount(codes, minlength=count) @ true / len(sample)
        if 0 < mass <= WIDEST:
            cuts.append(cut)
            member.append(true)
    table = np.array(member, dtype=np.float64).reshape(len(cuts), count)
    return Grid(
        codes,
        count,
        tuple(cuts),
        np.array([cut.side for cut in cuts], dtype=np.int64),
        table,
        table @ np.bincount(codes, minlength=count) / len(sample),
        np.array([sample.volume(cut) for cut in cuts]),
        np.array([_core(sample, cuts, cut) for cut in cuts], dtype=np.int64),
    )


def _edges(column: np.ndarray, unit: Unit, cells: int) -> np.ndarray:
    if unit.kinds is not None:
        return unit.kinds[1:]
    shares = np.arange(1, cells) / cells
    if cells > _FINE:
        shares = np.concatenate((_TAILS, shares, 1 - _TAILS[::-1]))
    edges = np.unique(np.quantile(column, shares))
    return edges[edges > column.min()]


def _literals(unit: int, described: Unit, edges: np.ndarray) -> list[tuple[Cut, np.ndarray]]:
    """Return each literal with the cells that it is true of."""
    cell = np.arange(len(edges) + 1)
    if described.kinds is not None:
        kinds = described.kinds
        last = len(kinds) - 1
        # At the ends, and next to them, a comparison says the same as equality or its opposite.
        found = [(Cut(unit, EQUAL, float(kind)), cell == at) for at, kind in enumerate(kinds)]
        found += [(Cut(unit, BELOW, float(kinds[at])), cell <= at) for at in range(1, last)]
        found += [(Cut(unit, ABOVE, float(kinds[at])), cell >= at) for at in range(1, last)]
        return found
    found = []
    if BELOW in described.sides:
        found += [(Cut(unit, BELOW, float(x)), cell <= at) for at, x in enumerate(edges)]
    if ABOVE in described.sides:
        found += [(Cut(unit, ABOVE, float(x)), cell > at) for at, x in enumerate(edges)]
    return found


def _core(sample: Sample, cuts: list[Cut], cut: Cut) -> int:
    """Return the position of the widest literal within half the depth of ``cut``."""
    wanted = sample.half_as_deep(cut)
    if wanted == cut:
        return cuts.index(cut)
    within = [
        (other.bound, position)
        for position, other in enumerate(cuts)
        if other.side == cut.side
        and (other.bound <= wanted.bound if cut.side == BELOW else other.bound >= wanted.bound)
    ]
    if not within:
        return -1
    return (max(within) if cut.side == BELOW else min(within))[1]
