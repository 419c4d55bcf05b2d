# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The box: each of its bounds where fresh episodes keep it and bad samples do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.learning.conditional.margins import is_noise, outward_margin
from occ_constraints_pkg.learning.conditional.table import Table
from occ_constraints_pkg.learning.conditional.tails import find_glitches, flat_tails
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Unit


def demonstrated_ranges(values: np.ndarray, groups: Sequence[Sequence[int]]) -> np.ndarray:
    """Return the (k, 2) smallest and largest values; members of a family share them.

    Args:
        values: (n, k) samples.
        groups: positions of the members of each family.
    """
    ranges = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    for group in map(list, groups):
        ranges[group] = ranges[group, 0].min(), ranges[group, 1].max()
    return ranges


def inside_box(values: np.ndarray, box: np.ndarray, demonstrated: np.ndarray) -> np.ndarray:
    """Tell for each of (n, k) samples whether it is in a box: (n,) bool.

    Args:
        values: the samples.
        box: (k, 2) bounds.
        demonstrated: (k, 2) ranges; a feature whose bounds lie beyond has nothing outside.
    """
    inside = np.ones(len(values), dtype=bool)
    beyond = (box[:, 0] <= demonstrated[:, 0]) & (box[:, 1] >= demonstrated[:, 1])
    for column in np.flatnonzero(~beyond):
        low, high = box[column]
        inside &= (values[:, column] >= low) & (values[:, column] <= high)
    return inside


def fit_box(
    table: Table,
    bounds: np.ndarray,
    demonstrated: np.ndarray,
    limits: np.ndarray,
    outside: float | None,
    *,
    cuts_stay: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Move the bounds of a box.

    Inward where a tail is made of bad samples. Outward to the demonstrated extreme where the few
    samples outside are good ones; and from the extreme by a margin.

    Args:
        table: all samples.
        bounds: (k, 2) the box that there is.
        demonstrated: (k, 2) smallest and largest values.
        limits: (k, 2) physical bounds.
        outside: share of the time that a fresh episode may spend outside; each bound has an equal
            part. ``None`` moves nothing outward.
        cuts_stay: whether to move outward only what lies at a demonstrated extreme.

    Returns:
        (k, 2) the box; and (n,) bool, the rows that are glitches in several features at once. One
        bad row puts all of its features anywhere, so they seem to hang together.
    """
    box = np.array(bounds, dtype=np.float64)
    glitches = np.zeros(len(table), dtype=np.int64)
    in_family = {column for unit in table.units if unit.is_family for column in unit.columns}
    continuous = [number for number, unit in enumerate(table.units) if not unit.is_discrete]
    bounded = {
        number
        for number in continuous
        if table.units[number].is_family or table.units[number].columns[0] not in in_family
    }
    sides = sum(len(table.units[number].sides) for number in bounded)
    for number in continuous:
        unit, column = table.units[number], table.column(number)
        is_glitch = find_glitches(column, table.goes_on)
        if not unit.is_family:
            glitches += is_glitch
        if number not in bounded:
            continue
        for side in unit.sides:
            end = 0 if side == BELOW else 1
            first = unit.columns[0]
            is_cut = box[first, end] != demonstrated[first, end]
            if outside is not None and not (is_cut and cuts_stay):
                _move_outward(
                    box, unit, side, column, is_glitch, table, demonstrated, limits, outside / sides
                )
        within = (column >= box[unit.columns[0], 0]) & (column <= box[unit.columns[0], 1])
        for cut in flat_tails(number, unit, column[within], is_glitch[within]):
            end = 0 if cut.side == BELOW else 1
            box[list(unit.columns), end] = cut.bound
    box[:, 0] = np.maximum(box[:, 0], limits[:, 0])
    box[:, 1] = np.minimum(box[:, 1], limits[:, 1])
    return box, glitches > 1


def _move_outward(
    box: np.ndarray,
    unit: Unit,
    side: int,
    column: np.ndarray,
    is_glitch: np.ndarray,
    table: Table,
    demonstrated: np.ndarray,
    limits: np.ndarray,
    share: float,
) -> None:
    """Move one bound of a unit; changes ``box``.

    Args:
        box: (k, 2) bounds.
        unit: the feature or family.
        side: which of its bounds.
        column: (n,) its values.
        is_glitch: (n,) bool.
        table: all samples.
        demonstrated: (k, 2) smallest and largest values.
        limits: (k, 2) physical bounds; members of a family share them.
        share: of the time that a fresh episode may spend beyond the bound.
    """
    columns, end = list(unit.columns), 0 if side == BELOW else 1
    bound, extreme = box[columns[0], end], demonstrated[columns[0], end]
    if bound != extreme:
        beyond = column < bound if side == BELOW else column > bound
        if beyond.mean() > share or 2 * is_glitch[beyond].sum() > beyond.sum():
            return
        # Noise is beyond in fresh episodes as often as in these.
        if is_noise(column, table.goes_on):
            return
        bound = extreme
    margin = outward_margin(side * column, table.episode_numbers, share)
    # A rule has to be left: the bound goes at most half way to a physical limit.
    margin = min(margin, abs(limits[columns[0], end] - bound) / 2.0)
    box[columns, end] = bound + margin if side == ABOVE else bound - margin
