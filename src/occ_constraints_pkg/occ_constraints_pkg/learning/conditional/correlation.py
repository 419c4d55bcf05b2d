# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a mere correlation leaves of a corner.

Two features that grow together leave two corners empty: high with low, and low with high. A safety
rule empties one corner and not its mirror image. So of what independence would expect in a corner
only as much counts as the larger of two: the mass that a Gaussian copula of the same rank
correlation has there, and the mass observed in the mirrored corner.

Where one feature all but determines the other (cosine and sine, distances to the left and to the
right), corners are empty for geometry's sake, and nothing is left of any.
"""

from __future__ import annotations

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
        rho = self.correlation(i, j)
        for side in (BELOW, ABOVE):
            for other_side in (BELOW, ABOVE):
                rows = np.flatnonzero(one.sides == side)
                columns = np.flatnonzero(other.sides == other_side)
                if len(rows) and len(columns):
                    mass, other_mass = one.mass[rows], other.mass[columns]
                    copula = gaussian_corner(mass, other_mass, rho * side * other_side)
                    mirrored = self._mirrored(i, side, mass, j, other_side, other_mass)
                    share = np.maximum(copula, mirrored) / np.outer(mass, other_mass)
                    out[np.ix_(rows, columns)] = np.clip(share, 0.0, 1.0)
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
        rho = self.correlation(cut.unit, other.unit) * cut.side * other.side
        copula = gaussian_corner(mass, other_mass, rho)
        mirrored = self._mirrored(cut.unit, cut.side, mass, other.unit, other.side, other_mass)
        most = np.maximum(copula, mirrored)
        return float(np.clip(most / np.outer(mass, other_mass), 0.0, 1.0)[0, 0])

    def _mirrored(
        self,
        i: int,
        side: int,
        mass: np.ndarray,
        j: int,
        other_side: int,
        other_mass: np.ndarray,
    ) -> np.ndarray:
        """Return the share of the rows in the corners of the same masses at the other ends."""
        ranks = self._sample.ranks
        one = ranks[i] if side == ABOVE else 1 - ranks[i]
        other = ranks[j] if other_side == ABOVE else 1 - ranks[j]
        order, other_order = np.argsort(mass), np.argsort(other_mass)
        width = len(other_mass) + 1
        cells = np.searchsorted(mass[order], one) * width
        cells += np.searchsorted(other_mass[other_order], other)
        counts = np.bincount(cells, minlength=(len(mass) + 1) * width).reshape(-1, width)
        out = np.empty((len(mass), len(other_mass)))
        below = counts.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] / len(one)
        out[np.ix_(order, other_order)] = below
        return out
