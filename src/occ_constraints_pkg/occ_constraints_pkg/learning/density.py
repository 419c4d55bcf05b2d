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
# Bandwidths of padding on either side, where the density has fallen to 0.
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
    low, high = _sorted_quantile(ordered, 0.25), _sorted_quantile(ordered, 0.75)
    if high > low:
        spread = min(spread, (high - low) / 1.34)
    return float(0.9 * spread * len(ordered) ** -0.2)


def _sorted_quantile(ordered: np.ndarray, share: float) -> float:
    """Return a quantile of ascending values, linear between samples."""
    place = share * (len(ordered) - 1)
    below = int(place)
    above = min(below + 1, len(ordered) - 1)
    return float(ordered[below] + (place - below) * (ordered[above] - ordered[below]))


def estimate(ordered: np.ndarray, h: float | None = None) -> Density:
    """Estimate the density of (n,) ascending values, not all equal, by a Gaussian kernel (p. 9).

    Samples are distributed linearly over neighbouring grid points, and the grid is convolved with
    the kernel: only the counting depends on n.

    Args:
        ordered: the values.
        h: their :func:`bandwidth`, if already known.
    """
    h = bandwidth(ordered) if h is None else h
    low, high = ordered[0] - _PADDING * h, ordered[-1] + _PADDING * h
    wanted = np.ceil((high - low) / h * _CELLS_PER_BANDWIDTH)
    size = int(min(max(wanted, _SMALLEST_GRID), _LARGEST_GRID))
    grid = np.linspace(low, high, size)
    step = grid[1] - grid[0]
    mass = _distribute((ordered - low) / step, size)
    # Below a tenth of a cell the kernel is one cell wide; sigma must only stay above 0.
    sigma = max(h / step, 0.1)
    smooth = gaussian_filter1d(mass, sigma, mode='constant', truncate=_PADDING)
    return Density(grid, smooth * (h / step / len(ordered)), h)


def _distribute(places: np.ndarray, size: int) -> np.ndarray:
    """Distribute ascending positions, in cells from 0 to size - 1, over the adjacent grid points.

    A sample at 3.2 adds 0.8 to point 3 and 0.2 to point 4. Since positions ascend, cumulative sums
    at the cell borders suffice.
    """
    borders = np.searchsorted(places, np.arange(1, size - 1))
    ends = np.concatenate(([0], borders, [len(places)]))
    counts = np.diff(ends)
    sums = np.diff(np.concatenate(([0.0], np.cumsum(places)))[ends])
    to_right = sums - counts * np.arange(size - 1)
    mass = np.zeros(size)
    mass[:-1] = counts - to_right
    mass[1:] += to_right
    # Rounding may leave tiny negative numbers.
    return np.maximum(mass, 0.0)
