# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set as one box: what clipping by mass gives where no interval is ever split."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from occ_constraints_pkg.learning.octree import is_stable, oversteps
from occ_constraints_pkg.learning.samples import checked_samples
from occ_constraints_pkg.learning.settings import DEEPEST, OCTreeSettings
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.learning.trimming import Trim, Unit, make_units, most_outside, trim


def fit_box(
    values: np.ndarray,
    settings: OCTreeSettings,
    *,
    families: Sequence[Sequence[int]] = (),
    limits: np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Node:
    """Learn one box around the samples, as a tree in which every split has one branch.

    It is what :func:`~occ_constraints_pkg.learning.octree.fit_tree` comes to with clipping by mass
    and alpha 0, but that the order of the features is settled at the root; so it takes a few passes
    over the samples instead of one for each level and feature. Each interval is shrunk to the
    samples that are inside so far.

    Args:
        values: (n, k) finite samples.
        settings: the learner's parameters.
        families: positions of features that share their bounds.
        limits: (k, 2) physical bounds of the features; ``None`` for none.
        progress: called with (level, 1) after each level.

    Returns:
        The tree's root; a leaf when nothing may be cut.

    Raises:
        DataError: no sample, or a value that is not finite.
    """
    samples = checked_samples(values)
    if not most_outside(len(samples), settings.contamination):
        # Nothing may be cut. There may be very many features, so it is worth to say so here.
        return Node()
    deepest = DEEPEST if settings.max_depth is None else settings.max_depth
    units = make_units(samples, families, limits)
    trims = trim(units, settings.contamination)
    total = len(units[0].smallest)
    inside = np.ones(total, dtype=bool)
    outside = np.flatnonzero(~inside)
    levels: list[tuple[tuple[int, ...], Branch]] = []
    eligible = [(unit, cut) for unit, cut in zip(units, trims, strict=True) if cut is not None]
    for unit, cut in sorted(eligible, key=lambda pair: pair[1].impurity):
        if len(levels) == deepest or total - len(outside) < max(2.0, settings.min_split * total):
            break
        narrowed = inside
        if cut.extent != (cut.low, cut.high):
            narrowed = inside & (unit.smallest >= cut.low) & (unit.largest <= cut.high)
        gone = np.flatnonzero(~narrowed)
        count = total - len(gone)
        if count == 0 or count < settings.beta * total:
            continue
        interval = _shrunk(unit, cut, narrowed, gone)
        if interval == cut.extent:
            continue
        if settings.nu is not None and oversteps(count, total, settings.nu):
            break
        stable = is_stable(1, 1, count, total - len(outside))
        levels.append((unit.features, Branch(*interval, count, Node())))
        inside, outside = narrowed, gone
        if progress is not None:
            progress(len(levels), 1)
        if settings.nu is not None and stable:
            break
    tree = Node()
    for features, branch in reversed(levels):
        for feature in reversed(features):
            tree = Node(feature, (Branch(branch.low, branch.high, branch.samples, tree),))
    return tree


def _shrunk(unit: Unit, cut: Trim, inside: np.ndarray, outside: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest value inside; bounds of ``cut`` lie on samples.

    Only where one of the few samples outside is at or within a bound is there anything to find.
    """
    low, high = cut.low, cut.high
    if (unit.smallest[outside] == low).any():
        low = float(unit.smallest.min(where=inside, initial=np.inf))
    if (unit.largest[outside] == high).any():
        high = float(unit.largest.max(where=inside, initial=-np.inf))
    return low, high
