# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The one-class tree: nested intervals whose leaves are boxes around the demonstrations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Branch:
    """One target interval of a split and its subtree.

    Attributes:
        low: left bound, inclusive.
        high: right bound, inclusive.
        samples: training samples inside this branch.
        node: the subtree.
    """

    low: float
    high: float
    samples: int
    node: Node


@dataclass(frozen=True)
class Node:
    """A leaf (no feature, no branches) or a split of one feature into disjoint intervals.

    A split of a feature that was split above lies within the interval of its branch there.

    Attributes:
        feature: position of the split feature, ``None`` at a leaf.
        branches: in ascending order of their intervals; at least one at a split.
    """

    feature: int | None = None
    branches: tuple[Branch, ...] = field(default=())

    def leaf_boxes(self, features: int) -> np.ndarray:
        """Return the (leaves, features, 2) closed boxes of all leaves, infinite where uncut."""
        box = np.full((features, 2), [-np.inf, np.inf])
        return np.array(list(self._boxes(box)))

    def _boxes(self, box: np.ndarray) -> Iterator[np.ndarray]:
        if self.feature is None:
            yield box
        for branch in self.branches:
            inner = box.copy()
            inner[self.feature] = branch.low, branch.high
            yield from branch.node._boxes(inner)

    def contains(self, values: np.ndarray) -> np.ndarray:
        """Return (n,) bool, whether rows of (n, k) finite values lie in the box of a leaf."""
        inside = np.zeros(len(values), dtype=bool)
        self._mark(values, np.arange(len(values)), inside)
        return inside

    def _mark(self, values: np.ndarray, rows: np.ndarray, inside: np.ndarray) -> None:
        if self.feature is None:
            inside[rows] = True
            return
        column = values[rows, self.feature]
        for branch in self.branches:
            branch.node._mark(
                values, rows[(column >= branch.low) & (column <= branch.high)], inside
            )

    @property
    def depth(self) -> int:
        """Number of levels of splits."""
        if self.feature is None:
            return 0
        return 1 + max(branch.node.depth for branch in self.branches)

    def levels(self, families: Sequence[Sequence[int]] = ()) -> int:
        """Return the number of levels in which the tree was grown.

        Args:
            families: positions of features that were divided together; the splits of a family
                follow each other and are one level.
        """
        if self.feature is None:
            return 0
        own = _ends_level(self.feature, families)
        return own + max(branch.node.levels(families) for branch in self.branches)

    def cut(self, levels: int, families: Sequence[Sequence[int]] = ()) -> Node:
        """Return the tree as it was after so many levels of growth.

        A split does not depend on anything below it, so this is the tree of a smaller depth limit.

        Args:
            levels: how many to keep.
            families: see :meth:`levels`.
        """
        if self.feature is None or levels <= 0:
            return Node()
        left = levels - _ends_level(self.feature, families)
        branches = (replace(item, node=item.node.cut(left, families)) for item in self.branches)
        return replace(self, branches=tuple(branches))


def _ends_level(feature: int, families: Sequence[Sequence[int]]) -> int:
    """Return 1 unless the feature is a member of a family, and not the last."""
    return int(all(feature not in family or feature == family[-1] for family in families))
