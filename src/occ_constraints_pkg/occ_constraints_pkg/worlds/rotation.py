# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rotations of many bodies at once, as unit quaternions (w, x, y, z)."""

from __future__ import annotations

import numpy as np


def quaternion_of_yaw(yaw: np.ndarray) -> np.ndarray:
    """Return the (N, 4) quaternions of rotations about the z axis by (N,) ``yaw`` in rad."""
    quaternion = np.zeros((len(yaw), 4))
    quaternion[:, 0] = np.cos(yaw / 2)
    quaternion[:, 3] = np.sin(yaw / 2)
    return quaternion


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the (N, 3, 3) matrices of (N, 4) unit quaternions; columns are the body's axes."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
