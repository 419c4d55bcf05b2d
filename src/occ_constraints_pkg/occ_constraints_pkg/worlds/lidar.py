# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The pseudo-lidar of Safety-Gym: how near the objects of one kind are, by direction."""

from __future__ import annotations

import numpy as np

BINS = 16
MAX_DISTANCE = 3.0
# Middle of each bin, in bins; bin 0 starts straight along x and bins go counter-clockwise.
_CENTRES = np.arange(BINS) + 0.5


def lidar_returns(position: np.ndarray, axes: np.ndarray, objects: np.ndarray) -> np.ndarray:
    """Return what each object on its own contributes to each bin.

    An object at distance d gives the bin that holds its bearing ``max(0, 3 - d) / 3``, and its
    two neighbours a share of that which grows linearly, up to all of it, as the bearing nears
    their common edge. The lidar of one kind of object is the maximum over its objects.

    Objects are taken to lie on the floor, where a robot that leans sees them shifted, as in
    Safety-Gym.

    Args:
        position: (N, 3) centres of the robots, in m.
        axes: (N, 3, 3) axes of the robots' bodies as columns, world frame.
        objects: (N, M, 2) positions of the M objects that each robot sees, in m.

    Returns:
        (N, M, 16), within [0, 1].
    """
    x, y = np.moveaxis(objects - position[:, None, :2], 2, 0)
    z = -position[:, 2:]
    ahead, aside = (
        x * axes[:, 0, i, None] + y * axes[:, 1, i, None] + z * axes[:, 2, i, None] for i in (0, 1)
    )
    distance = np.hypot(ahead, aside)
    strength = np.maximum(0.0, MAX_DISTANCE - distance) / MAX_DISTANCE
    bearing = np.arctan2(aside, ahead)
    from_centre = bearing[..., None] * (BINS / (2 * np.pi)) - _CENTRES
    from_centre -= BINS * np.rint(from_centre / BINS)
    # All of it within half a bin of the centre, falling to none one bin further out.
    share = np.clip(1.5 - np.abs(from_centre), 0.0, 1.0)
    return strength[..., None] * share
