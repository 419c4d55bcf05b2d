# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Density estimate of one attribute (OC-tree article, density estimate, p. 9).

Pages are those of the accepted manuscript, arXiv:1805.05021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

# Grid cells per bandwidth, and the largest grid: cells stay well below the bandwidth except for
# data whose range exceeds two thousand bandwidths, where the smoothing is then by cells instead.
_CELLS_PER_BANDWIDTH = 8
_SMALLEST_GRID, _LARGEST_GRID = 256, 16384
# Bandwidths of empty space on either side: there the density has fallen to nothing.
_PADDING = 4.0


@dataclass(frozen=True)
class Density:
    """A kernel density estimate on an even grid.

    Attributes:
        grid: (m,) positions, ascending, evenly spaced.
        values: (m,) density at those positions, per bandwidth and not per unit of the attribute:
            numbers around one whatever the unit.
        bandwidth: standard deviation h of the Gaussian kernel, in the attribute's unit.
    """

    grid: np.ndarray
    values: np.ndarray
    bandwidth: float

    def at(self, positions: np.ndarray) -> np.ndarray:
        """Return the density, per bandwidth, at (n,) positions, linear between grid points."""
        cells = (positions - self.grid[0]) / (self.grid[1] - self.grid[0])
        return np.interp(cells, np.arange(len(self.grid)), self.values)


def bandwidth(ordered: np.ndarray) -> float:
    """Return the article's rule-of-thumb bandwidth (p. 9, equation 2).

    ``0.9 min(s, IQR / 1.34) n^(-1/5)``, and ``0.9 s n^(-1/5)`` where the interquartile range is 0.
    The article leaves open which standard deviation; here it is the sample's (ddof 1).

    Args:
        ordered: (n,) at least two values in ascending order, not all equal.

    Returns:
        The bandwidth in the attribute's unit.
    """
    extent = ordered[-1] - ordered[0]
    # Over their range, no squares of very large or small values overflow or vanish.
    spread = (ordered / extent).std(ddof=1) * extent
    low, high = np.quantile(ordered, [0.25, 0.75])
    if high > low:
        spread = min(spread, (high - low) / 1.34)
    return float(0.9 * spread * len(ordered) ** -0.2)


def estimate(ordered: np.ndarray) -> Density:
    """Estimate the density of (n,) ascending values, not all equal, by a Gaussian kernel (p. 9).

    The samples are shared out linearly between neighbouring cells of a grid, which is then
    convolved with the kernel: time grows with n only through the counting.
    """
    h = bandwidth(ordered)
    low, high = ordered[0] - _PADDING * h, ordered[-1] + _PADDING * h
    wanted = np.ceil((high - low) / h * _CELLS_PER_BANDWIDTH)
    size = int(min(max(wanted, _SMALLEST_GRID), _LARGEST_GRID))
    grid = np.linspace(low, high, size)
    step = grid[1] - grid[0]
    place = (ordered - low) / step
    cell = np.minimum(place.astype(np.int64), size - 2)
    share = place - cell
    mass = np.bincount(cell, weights=1.0 - share, minlength=size)
    mass += np.bincount(cell + 1, weights=share, minlength=size)
    # Under a tenth of a cell the kernel is one cell wide; its exact width must only not vanish.
    sigma = max(h / step, 0.1)
    smooth = gaussian_filter1d(mass, sigma, mode='constant', truncate=_PADDING)
    return Density(grid, smooth * (h / step / len(ordered)), h)
