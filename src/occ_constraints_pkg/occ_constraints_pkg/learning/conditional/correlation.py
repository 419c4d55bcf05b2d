# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a mere correlation leaves of a corner.

Two features that grow together leave two corners empty: high with low, and low with high. A safety
rule empties one corner and not its mirror image. So of what independence would expect in a corner
only as much counts as the larger of two: the mass that a Gaussian copula of the same rank
correlation has there, and the mass observed in the mirrored corner.

The range of a feature may grow with another one (a force with the speed, say). Then, where the
other is small, both ends of the feature stay empty. So where a corner's reflection at the median is
as empty, nothing is left of either if the scatter on that other side explains it; unless the
scatter falls off right at the corner, as it does if both are forbidden there.

Where one feature all but determines the other (cosine and sine, distances to the left and to the
right), corners are empty for geometry's sake, and nothing is left of any.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from occ_constraints_pkg.learning.conditional.grid import Grid
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Cut

# Beyond this the integral needs more points than it has.
_STRONGEST = 0.9999
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
# Features that share more information, in nats, all but determine each other. Rules that
# demonstrators keep come to about 0.4, a Gaussian correlation of 0.9 to 0.7, a circle to 0.9.
_DETERMINED = 0.75
_CELLS = 8
# The scatter of fewer rows is not known.
_LEAST_SCATTERED = 30
_SCATTER_CELLS = 64
# It falls off towards a corner if it is at most this share as large near it as far from it. Where
# no more than a share of the corner is left by it, nothing is.
_SMALLER = 0.85
_EXPLAINED = 0.5


def gaussian_corner(lower: np.ndarray, other: np.ndarray, rho: float) -> np.ndarray:
    """Return P(U < u, V < v) of a Gaussian copula on a grid: (a, b).

    The integral over the angle whose sine is the correlation, by Gauss and Legendre.

    Args:
        lower: (a,) u within 0 to 1.
        other: (b,) v within 0 to 1.
        rho: correlation.
    """
    angle = np.arcsin(rho)
    t, weights = angle * (_NODES + 1) / 2, _WEIGHTS * angle / 2
    h, k = ndtri(lower)[:, None, None], ndtri(other)[None, :, None]
    with np.errstate(invalid='ignore'):
        density = np.exp(-(h * h + k * k - 2 * np.sin(t) * h * k) / (2 * np.cos(t) ** 2))
    return np.outer(lower, other) + np.nan_to_num(density) @ weights / (2 * np.pi)


@dataclass(frozen=True)
class _Ends:
    """Ends of a unit, of various widths.

    Attributes:
        unit: its position.
        side: which of its ends.
        mass: (a,) share of the rows in each.
    """

    unit: int
    side: int
    mass: np.ndarray

    @property
    def opposite(self) -> _Ends:
        """The same at the other end."""
        return _Ends(self.unit, -self.side, self.mass)


class CorrelationNull:
    """Answers for pairs of continuous units of one sample."""

    def __init__(self, sample: Sample) -> None:
        """Keep the sample; correlations are computed when they are asked for."""
        self._sample = sample
        self._known: dict[tuple[int, int], float] = {}
        self._information: dict[tuple[int, int], float] = {}
        self._cells_of: dict[int, tuple[np.ndarray, int]] = {}

    def applies(self, i: int, j: int) -> bool:
        """Tell whether both units are continuous."""
        units = self._sample.units
        return not (units[i].is_discrete or units[j].is_discrete)

    def correlation(self, i: int, j: int) -> float:
        """Return the correlation of the Gaussian copula with the rank correlation of two units."""
        if (i, j) not in self._known:
            ranks = self._sample.ranks
            rank_correlation = 12 * np.mean((ranks[i] - 0.5) * (ranks[j] - 0.5))
            rho = 2 * np.sin(np.pi * rank_correlation / 6)
            self._known[i, j] = float(np.clip(rho, -_STRONGEST, _STRONGEST))
        return self._known[i, j]

    def is_determined(self, i: int, j: int) -> bool:
        """Tell whether two continuous units all but determine each other."""
        return self.applies(i, j) and self.information(i, j) > _DETERMINED

    def information(self, i: int, j: int) -> float:
        """Return the mutual information of two units in nats, on eight by eight cells."""
        if (i, j) not in self._information:
            (one, a), (other, b) = self._cells(i), self._cells(j)
            joint = np.bincount(one * b + other, minlength=a * b).reshape(a, b) / len(one)
            product = np.outer(joint.sum(axis=1), joint.sum(axis=0))
            some = joint > 0
            parts = joint[some] * np.log(joint[some] / product[some])
            self._information[i, j] = float(parts.sum())
        return self._information[i, j]

    def _cells(self, unit: int) -> tuple[np.ndarray, int]:
        """Return the cell of each row, of about equal mass, and how many cells there are."""
        if unit not in self._cells_of:
            ordered, column = self._sample.ordered[unit], self._sample.columns[unit]
            edges = np.unique(ordered[len(ordered) * np.arange(1, _CELLS) // _CELLS])
            cells = np.searchsorted(edges, column, side='right')
            self._cells_of[unit] = cells, len(edges) + 1
        return self._cells_of[unit]

    def share(self, i: int, j: int, one: Grid, other: Grid) -> np.ndarray:
        """Return what correlation leaves of each corner's mass under independence.

        Args:
            i: position of a unit.
            j: position of another.
            one: its grid, of a literals.
            other: the other's, of b literals.

        Returns:
            (a, b) within 0 to 1; 1 where the null does not apply.
        """
        out = np.ones((len(one.cuts), len(other.cuts)))
        if not self.applies(i, j):
            return out
        if self.is_determined(i, j):
            return np.zeros_like(out)
        for side in (BELOW, ABOVE):
            for other_side in (BELOW, ABOVE):
                rows = np.flatnonzero(one.sides == side)
                columns = np.flatnonzero(other.sides == other_side)
                if len(rows) and len(columns):
                    mass, other_mass = one.mass[rows], other.mass[columns]
                    out[np.ix_(rows, columns)] = self._left(
                        _Ends(i, side, mass), _Ends(j, other_side, other_mass)
                    )
        return out

    def share_at(self, cut: Cut, other: Cut) -> float:
        """Return the same for one corner."""
        if not self.applies(cut.unit, other.unit):
            return 1.0
        mass = np.array([self._sample.is_true(cut).mean()])
        other_mass = np.array([self._sample.is_true(other).mean()])
        if not (0 < mass[0] < 1 and 0 < other_mass[0] < 1):
            return 0.0
        if self.is_determined(cut.unit, other.unit):
            return 0.0
        one, another = _Ends(cut.unit, cut.side, mass), _Ends(other.unit, other.side, other_mass)
        return float(self._left(one, another)[0, 0])

    def _left(self, one: _Ends, other: _Ends) -> np.ndarray:
        """Return what is left of the mass of the corners of two units' ends: (a, b)."""
        rho = self.correlation(one.unit, other.unit) * one.side * other.side
        independent = np.outer(one.mass, other.mass)
        copula = gaussian_corner(one.mass, other.mass, rho)
        mirrored = self._seen(one.opposite, other.opposite)
        share = np.maximum(copula, mirrored) / independent
        for ends, others, turned in ((one, other, False), (other, one, True)):
            scatter = self._scatter_leaves(ends, others)
            share = np.minimum(share, scatter.T if turned else scatter)
        return np.clip(share, 0.0, 1.0)

    def _seen(self, one: _Ends, other: _Ends) -> np.ndarray:
        """Return the share of the rows in the corners of two units' ends: (a, b)."""
        ranks = self._ranks_from(one), self._ranks_from(other)
        order, other_order = np.argsort(one.mass), np.argsort(other.mass)
        width = len(other.mass) + 1
        cells = np.searchsorted(one.mass[order], ranks[0]) * width
        cells += np.searchsorted(other.mass[other_order], ranks[1])
        counts = np.bincount(cells, minlength=(len(one.mass) + 1) * width).reshape(-1, width)
        out = np.empty((len(one.mass), len(other.mass)))
        below = counts.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] / len(ranks[0])
        out[np.ix_(order, other_order)] = below
        return out

    def _ranks_from(self, ends: _Ends) -> np.ndarray:
        """Return the (n,) ranks of a unit counted from the side of its ends."""
        ranks = self._sample.ranks[ends.unit]
        return ranks if ends.side == BELOW else 1 - ranks

    def _scatter_leaves(self, one: _Ends, other: _Ends) -> np.ndarray:
        """Return what is left if the scatter of the other unit depends on the one.

        Returns:
            (a, b) 0 where that explains most of the emptiness, else 1.
        """
        column = self._sample.columns[other.unit]
        from_middle = other.side * (column - np.median(column))
        scale = self._scatter(one, from_middle)
        ordered = np.sort(from_middle)
        places = (len(ordered) * (1 - other.mass)).astype(np.int64).clip(0, len(ordered) - 1)
        bounds = ordered[places]
        # Were the scatter the same as elsewhere, the bound would have to be so much farther out.
        farther = bounds / scale[:, None]
        scaled = 1 - np.searchsorted(ordered, farther) / len(ordered)
        reflected = self._seen(one, other.opposite) / np.outer(one.mass, other.mass)
        left = np.maximum(scaled / other.mass, reflected)
        return np.where((bounds > 0) & (left < _EXPLAINED), 0.0, 1.0)

    def _scatter(self, ends: _Ends, from_middle: np.ndarray) -> np.ndarray:
        """Return how far values scatter on the negative side, within each end of a unit.

        Args:
            ends: where.
            from_middle: (n,) distances of a column from its median.

        Returns:
            (a,) median distances as shares of that of all rows; 1 where they are larger, and where
            those in the nearer half of the other rows are not smaller than in the farther half.
        """
        negative = from_middle < 0
        distances = -from_middle[negative]
        if len(distances) < _LEAST_SCATTERED:
            return np.ones(len(ends.mass))
        ordered = np.sort(distances)
        edges = np.unique(ordered[len(ordered) * np.arange(1, _SCATTER_CELLS) // _SCATTER_CELLS])
        beside = (1 + ends.mass) / 2
        levels = np.unique(np.concatenate((ends.mass, beside)))
        cells = np.searchsorted(levels, self._ranks_from(ends)[negative]) * (len(edges) + 1)
        cells += np.searchsorted(edges, distances, side='right')
        counts = np.bincount(cells, minlength=(len(levels) + 1) * (len(edges) + 1))
        within = counts.reshape(len(levels) + 1, -1).cumsum(axis=0)
        middles = np.append(edges, ordered[-1]) / ordered[len(ordered) // 2]

        def median(counts: np.ndarray) -> np.ndarray:
            total = counts.sum(axis=1)
            at = (2 * counts.cumsum(axis=1) < total[:, None]).sum(axis=1)
            return np.where(total < _LEAST_SCATTERED, 1.0, middles[np.minimum(at, len(edges))])

        inside = within[np.searchsorted(levels, ends.mass)]
        nearer = within[np.searchsorted(levels, beside)]
        near, far = median(nearer - inside), median(within[-1] - nearer)
        scale = np.where(near <= _SMALLER * far, median(inside), 1.0)
        return np.clip(scale, np.finfo(float).tiny, 1.0)
