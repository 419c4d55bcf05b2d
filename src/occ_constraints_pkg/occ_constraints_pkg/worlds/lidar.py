# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The pseudo-lidar of Safety-Gym: proximity of the objects of one type, by direction."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

BINS = 16
MAX_DISTANCE = 3.0
_NEIGHBOURS = np.array([0, 1, -1])[:, None, None]


def lidar_readings(
    offsets: np.ndarray,
    heights: np.ndarray | float,
    axes: np.ndarray,
    lidars: tuple[int, ...],
) -> np.ndarray:
    """Return the readings of each lidar: the nearest of the objects that it sees, by direction.

    Bin 0 starts straight along x of the body, and bins go counter-clockwise. An object at
    distance d gives the bin that holds its bearing ``max(0, 3 - d) / 3``, and its two neighbours
    a share of that which grows linearly, up to all of it, as the bearing nears their common edge.
    A bin reads the maximum over objects.

    Objects are taken to lie on the floor, where a robot that leans sees them shifted, as in
    Safety-Gym.

    Args:
        offsets: (2, M, N) x, y of the M objects around each of N robots, from its centre, in m,
            world frame.
        heights: (N,) of the robots' centres, or one for all, in m.
        axes: (N, 3, 3) axes of the robots' bodies as columns, world frame.
        lidars: which lidar sees each of the M objects; whole numbers from 0.

    Returns:
        (N, L, 16), within [0, 1].
    """
    x, y = offsets
    along_x, along_y, along_z = axes[:, :, :2].transpose(1, 2, 0)
    ahead, aside = x * along_x[:, None] + y * along_y[:, None] - (heights * along_z)[:, None]
    place = np.arctan2(aside, ahead) * (BINS / (2 * np.pi))
    left_edge = np.floor(place)
    share = place - left_edge
    seen = np.empty(ahead.shape, complex)
    seen.real, seen.imag = ahead, aside
    # For the bin of the object, the next and the previous one; negative values have no effect.
    given = np.empty((3, *ahead.shape))
    given[0] = (MAX_DISTANCE - np.abs(seen)) / MAX_DISTANCE
    given[1], given[2] = share * given[0], (1 - share) * given[0]
    # Numbers of bins are taken modulo 16.
    bins = _first_bins(lidars, len(axes)) + (
        (left_edge.astype(np.int64) + _NEIGHBOURS) & (BINS - 1)
    )
    readings = np.zeros((len(axes), max(lidars) + 1, BINS))
    np.maximum.at(readings.reshape(-1), bins.reshape(-1), given.reshape(-1))
    return readings


@lru_cache
def _first_bins(lidars: tuple[int, ...], robots: int) -> np.ndarray:
    """(M, N) where the bins of the lidar that sees an object begin among those of N robots."""
    count = max(lidars) + 1
    return BINS * (np.array(lidars)[:, None] + count * np.arange(robots))


def beams(lidars: np.ndarray, forward: float) -> tuple[float, np.ndarray]:
    """Return pseudo-lidars as laser scans with one beam through the middle of each bin.

    Args:
        lidars: (L, 16) readings.
        forward: direction of the robot's drive from the x axis of its body, in rad.

    Returns:
        The direction of the first beam from straight ahead, in rad, the others following counter-
        clockwise; and (L, 16) distances in m, infinite where nothing is seen.
    """
    step = 2 * np.pi / BINS
    # Whole bins, because robots drive along an axis of their body.
    shift = round((forward - np.pi) / step)
    distances = np.where(lidars > 0, MAX_DISTANCE * (1 - lidars), np.inf)
    return step / 2 - np.pi, np.roll(distances, -shift, axis=1)
