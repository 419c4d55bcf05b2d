# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The safe set: one box, or a tree that branches where the settings let it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from occ_constraints_pkg.learning.box import fit_box
from occ_constraints_pkg.learning.octree import fit_tree
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.tree import Node


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
    fit = fit_box if settings.clip == 'mass' and settings.alpha == 0.0 else fit_tree
    return fit(values, settings, families=families, limits=limits, progress=progress)
