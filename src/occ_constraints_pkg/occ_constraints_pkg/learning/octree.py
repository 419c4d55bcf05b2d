# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The OC-tree learner after Itani, Lecron and Fortemps (Applied Soft Computing 91, 2020)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from occ_constraints_pkg.learning.division import Division, divide, divide_family
from occ_constraints_pkg.learning.samples import checked_samples
from occ_constraints_pkg.learning.settings import DEEPEST, OCTreeSettings
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.learning.trimming import Trim, Unit, make_units, trim


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
    limits: np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Node:
    """Learn the region that the samples cover as a tree that may branch.

    Grows level by level, until no node can be divided or the depth limit is reached. Where nu is
    set, the article's two conditions end growth earlier: :func:`exceeds_nu` and
    :func:`is_stable`.

    Args:
        values: (n, k) finite samples.
        settings: the learner's parameters.
        families: positions of features that share their bounds, see
            :func:`~occ_constraints_pkg.learning.trimming.trim`; only for clipping by mass, as the
            article has no families. A family is divided in one level.
        limits: (k, 2) physical bounds of the features, only for clipping by mass; ``None`` for
            none.
        progress: called with (level, leaves so far) after each level.

    Returns:
        The tree's root; a leaf when nothing could be divided.

    Raises:
        DataError: no sample, or a value that is not finite.
    """
    # In column order, as the samples are read by column.
    samples = np.asfortranarray(checked_samples(values))
    deepest = DEEPEST if settings.max_depth is None else settings.max_depth
    by_mass = settings.clip == 'mass'
    units = make_units(samples, families if by_mass else (), limits)
    trims = trim(units, settings.contamination) if by_mass else None
    extent = np.stack([samples.min(axis=0), samples.max(axis=0)], axis=1)
    for unit in units:
        extent[list(unit.features)] = unit.smallest.min(), unit.largest.max()
    root = _Growing(np.arange(len(samples)), extent, frozenset())
    growing, leaves, covered = [root], [], len(samples)
    for level in range(deepest):
        for node in growing:
            _split(node, units, trims, len(samples), settings)
        divided = [node for node in growing if node.children]
        if not divided:
            break
        leaves += [node for node in growing if not node.children]
        growing = [child for node in divided for child in node.children]
        covered_before, covered = covered, sum(len(node.rows) for node in leaves + growing)
        if settings.nu is not None and exceeds_nu(covered, len(samples), settings.nu):
            for node in divided:
                node.children = []
            break
        if progress is not None:
            progress(level + 1, len(leaves) + len(growing))
        stable = is_stable(len(growing), len(divided), covered, covered_before)
        if settings.nu is not None and stable:
            break
    return root.freeze()


def exceeds_nu(covered: int, total: int, nu: float) -> bool:
    """Return whether a level leaves more than ``nu`` outside (article, global stop, p. 14).

    The article does not say whether such a level is kept; :func:`fit_tree` undoes it.

    Args:
        covered: training samples inside target nodes after the level.
        total: all training samples.
        nu: share that may lie outside.
    """
    return (total - covered) / total > nu


def is_stable(children: int, parents: int, covered: int, covered_before: int) -> bool:
    """Return whether a level changed nothing that matters (article, global stop, p. 14).

    It added no target node and left as many training samples inside as before. What the article
    calls an iteration is taken to be one level of splits over all nodes.
    """
    return children == parents and covered == covered_before


def _split(
    node: _Growing,
    units: Sequence[Unit],
    trims: Sequence[Trim | None] | None,
    total: int,
    settings: OCTreeSettings,
) -> None:
    """Divide one node along what gives the purest parts, if anything is eligible.

    An attribute that cut this target node before is blocked until a later split into several
    target nodes (article, p. 12-14, local pre-pruning, rule 2). The smallest impurity wins
    (p. 13).
    """
    if len(node.rows) < max(2.0, settings.min_split * total):
        return
    best: Division | None = None
    chosen = units[0]
    for index, unit in enumerate(units):
        if unit.features[0] in node.blocked:
            continue
        kept = None
        if trims is not None:
            cut = trims[index]
            if cut is None:
                continue
            kept = cut.low, cut.high
        extent = tuple(node.extent[unit.features[0]])
        smallest = unit.smallest[node.rows]
        if unit.is_family and kept is not None:
            largest = unit.largest[node.rows]
            division = divide_family(smallest, largest, extent, kept)
        else:
            smallest.sort()
            division = divide(smallest, extent, total, settings, kept)
        if division is not None and (best is None or division.impurity < best.impurity):
            best, chosen = division, unit
    if best is None:
        return
    node.features, node.division = chosen.features, best
    single = len(best.intervals) == 1
    smallest, largest = chosen.smallest[node.rows], chosen.largest[node.rows]
    for low, high in best.intervals:
        box = node.extent.copy()
        box[list(node.features)] = low, high
        rows = node.rows[(smallest >= low) & (largest <= high)]
        blocked = node.blocked | set(node.features) if single else frozenset()
        node.children.append(_Growing(rows, box, blocked))
