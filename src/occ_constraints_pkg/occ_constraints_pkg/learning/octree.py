# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The OC-tree learner after Itani, Lecron and Fortemps (Applied Soft Computing 91, 2020)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.division import Division, divide, divide_family
from occ_constraints_pkg.learning.settings import DEEPEST, OCTreeSettings
from occ_constraints_pkg.learning.tree import Branch, Node


@dataclass
class _Growing:
    """A node under construction."""

    rows: np.ndarray
    extent: np.ndarray  # (k, 2) the node's box
    blocked: frozenset[int]
    # What is divided: one feature, or all of a family by the same interval.
    features: tuple[int, ...] = ()
    division: Division | None = None
    children: list[_Growing] = field(default_factory=list)

    def freeze(self) -> Node:
        if not self.children:
            return Node()
        assert self.division is not None
        branches = tuple(
            Branch(float(low), float(high), int(count), child.freeze())
            for (low, high), count, child in zip(
                self.division.intervals, self.division.counts, self.children, strict=True
            )
        )
        node = Node(self.features[-1], branches)
        (low, high), count = self.division.intervals[0], self.division.counts[0]
        for feature in reversed(self.features[:-1]):
            node = Node(feature, (Branch(float(low), float(high), int(count), node),))
        return node


def fit_tree(
    values: np.ndarray,
    settings: OCTreeSettings,
    *,
    families: Sequence[Sequence[int]] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Node:
    """Learn the region that the samples cover.

    Grows level by level, until no node can be divided or the depth limit is reached. Where nu is
    set, the article's two conditions end growth earlier: when a level has added no node and left
    the share of covered samples as it was, and before that share falls under 1 - nu (the article
    does not say whether the level that oversteps is kept: here it is undone).

    Args:
        values: (n, k) finite samples.
        settings: the learner's parameters.
        families: positions of features that share their bounds, see
            :func:`~occ_constraints_pkg.learning.division.divide_family`; only clipping by mass
            heeds them, for the article knows no such thing. A family is divided in one level.
        progress: called with (level, leaves so far) after each level.

    Returns:
        The tree's root; a leaf when nothing could be divided.

    Raises:
        OccError: no sample, or a value that is not finite.
    """
    samples = np.asarray(values, dtype=np.float64)
    if samples.ndim != 2 or not samples.size:
        raise OccError(f'learning needs samples of shape (n, k), got an array of {samples.shape}')
    if not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0]
        raise OccError(
            f'sample {row}, feature {column} is {samples[row, column]}; learning takes finite '
            'values only'
        )
    extent = np.stack([samples.min(axis=0), samples.max(axis=0)], axis=1)
    units = _units(samples.shape[1], families if settings.clip == 'mass' else ())
    for unit in units:
        extent[list(unit)] = extent[list(unit), 0].min(), extent[list(unit), 1].max()
    root = _Growing(np.arange(len(samples)), extent, frozenset())
    deepest = DEEPEST if settings.max_depth is None else settings.max_depth
    growing, leaves, covered = [root], [], len(samples)
    for level in range(deepest):
        for node in growing:
            _split(node, samples, units, settings)
        divided = [node for node in growing if node.children]
        if not divided:
            break
        leaves += [node for node in growing if not node.children]
        growing = [child for node in divided for child in node.children]
        covered_before, covered = covered, sum(len(node.rows) for node in leaves + growing)
        if settings.nu is not None and (len(samples) - covered) / len(samples) > settings.nu:
            for node in divided:
                node.children = []
            break
        if progress is not None:
            progress(level + 1, len(leaves) + len(growing))
        stable = len(growing) == len(divided) and covered == covered_before
        if settings.nu is not None and stable:
            break
    return root.freeze()


def _units(features: int, families: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Return what can be divided: each family, and each feature that is in none."""
    together = {member for family in families for member in family}
    alone = [(feature,) for feature in range(features) if feature not in together]
    return sorted([*alone, *(tuple(family) for family in families)])


def _split(
    node: _Growing, samples: np.ndarray, units: list[tuple[int, ...]], settings: OCTreeSettings
) -> None:
    """Divide one node along what gives the purest parts, if anything is eligible.

    An attribute that cut this target node before is blocked until a split into several target
    nodes has come since (article, local pre-pruning, rule 2).
    """
    if len(node.rows) < max(2.0, settings.min_split * len(samples)):
        return
    tail = settings.contamination / samples.shape[1]
    best: Division | None = None
    for unit in units:
        if unit[0] in node.blocked:
            continue
        extent = tuple(node.extent[unit[0]])
        if len(unit) > 1:
            columns = samples[np.ix_(node.rows, unit)]
            division = divide_family(columns, extent, len(unit) * tail)
        else:
            ordered = np.sort(samples[node.rows, unit[0]])
            division = divide(ordered, extent, len(samples), tail, settings)
        if division is not None and (best is None or division.impurity < best.impurity):
            best, node.features = division, unit
    if best is None:
        return
    node.division = best
    single = len(best.intervals) == 1
    columns = samples[np.ix_(node.rows, node.features)]
    for low, high in best.intervals:
        extent = node.extent.copy()
        extent[list(node.features)] = low, high
        rows = node.rows[((columns >= low) & (columns <= high)).all(axis=1)]
        blocked = node.blocked | set(node.features) if single else frozenset()
        node.children.append(_Growing(rows, extent, blocked))
