# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The pseudo-lidar of Safety-Gym: how near the objects of one kind are, by direction."""

from __future__ import annotations

import numpy as np

BINS = 16
MAX_DISTANCE = 3.0
# Middle of each bin, in bins; bin 0 starts straight ahead and bins go counter-clockwise.
_CENTRES = np.arange(BINS) + 0.5


def lidar_returns(position: np.ndarray, yaw: np.ndarray, objects: np.ndarray) -> np.ndarray:
    """Return what each object on its own contributes to each bin.

    An object at distance d gives the bin that holds its bearing ``max(0, 3 - d) / 3``, and its
    two neighbours a share of that which grows linearly, up to all of it, as the bearing nears
    their common edge. The lidar of one kind of object is the maximum over its objects.

    Args:
        position: (N, 2) robots' positions, in m.
        yaw: (N,) robots' headings, in rad.
        objects: (N, M, 2) positions of the M objects that each robot sees, in m.

    Returns:
        (N, M, 16), within [0, 1].
    """
    offset = objects - position[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    strength = np.maximum(0.0, MAX_DISTANCE - distance) / MAX_DISTANCE
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) - yaw[:, None]
    from_centre = bearing[..., None] * (BINS / (2 * np.pi)) - _CENTRES
    from_centre -= BINS * np.rint(from_centre / BINS)
    # All of it within half a bin of the centre, falling to none one bin further out.
    share = np.clip(1.5 - np.abs(from_centre), 0.0, 1.0)
    return strength[..., None] * share
