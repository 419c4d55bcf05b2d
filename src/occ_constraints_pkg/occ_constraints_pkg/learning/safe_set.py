# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set: one box, or a tree that branches where the settings let it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from occ_constraints_pkg.learning.octree import exceeds_nu, fit_tree, is_stable
from occ_constraints_pkg.learning.samples import checked_samples
from occ_constraints_pkg.learning.settings import DEEPEST, OCTreeSettings
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.learning.trimming import Trim, Unit, make_units, most_outside, trim


def fit_safe_set(
    values: np.ndarray,
    settings: OCTreeSettings,
    *,
    families: Sequence[Sequence[int]] = (),
    limits: np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Node:
    """Learn the region that the samples cover.

    Args:
        values: (n, k) finite samples.
        settings: if they never split an interval (clipping by mass, alpha 0), the region is one
            box; else a tree is grown.
        families: positions of features that share their bounds; only for clipping by mass.
        limits: (k, 2) physical bounds of the features; ``None`` for none.
        progress: called with (level, leaves so far) after each level.

    Returns:
        The tree's root.

    Raises:
        DataError: no sample, or a value that is not finite.
    """
    if settings.clip == 'mass' and settings.alpha == 0.0:
        return _fit_box(values, settings, families, limits, progress)
    return fit_tree(values, settings, families=families, limits=limits, progress=progress)


def _fit_box(
    values: np.ndarray,
    settings: OCTreeSettings,
    families: Sequence[Sequence[int]],
    limits: np.ndarray | None,
    progress: Callable[[int, int], None] | None,
) -> Node:
    """Learn one box around the samples, as a tree in which every split has one branch.

    Equivalent to :func:`~occ_constraints_pkg.learning.octree.fit_tree` with clipping by mass and
    alpha 0, except that the order of the features is chosen at the root. It therefore takes a few
    passes over the samples instead of one per level and feature. Each interval is shrunk to the
    samples that are still inside.
    """
    samples = checked_samples(values)
    if not most_outside(len(samples), settings.contamination):
        # Nothing may be cut; worth a shortcut, because there may be very many features.
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
        if settings.nu is not None and exceeds_nu(count, total, settings.nu):
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

    They differ from ``cut`` only if one of the few samples outside lies at or within a bound.
    """
    low, high = cut.low, cut.high
    if (unit.smallest[outside] == low).any():
        low = float(unit.smallest.min(where=inside, initial=np.inf))
    if (unit.largest[outside] == high).any():
        high = float(unit.largest.max(where=inside, initial=-np.inf))
    return low, high
