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


def matrix_of_yaw(yaw: np.ndarray) -> np.ndarray:
    """Return the (N, 3, 3) matrices of rotations about the z axis by (N,) ``yaw`` in rad."""
    matrix = np.zeros((len(yaw), 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = np.cos(yaw)
    matrix[:, 1, 0] = np.sin(yaw)
    matrix[:, 0, 1] = -matrix[:, 1, 0]
    matrix[:, 2, 2] = 1.0
    return matrix


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the (N, 3, 3) matrices of (N, 4) unit quaternions; columns are the body's axes."""
    w, x, y, z = quaternion.T
    matrix = np.empty((len(quaternion), 3, 3))
    matrix[:, 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[:, 0, 1] = 2 * (x * y - w * z)
    matrix[:, 0, 2] = 2 * (x * z + w * y)
    matrix[:, 1, 0] = 2 * (x * y + w * z)
    matrix[:, 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[:, 1, 2] = 2 * (y * z - w * x)
    matrix[:, 2, 0] = 2 * (x * z - w * y)
    matrix[:, 2, 1] = 2 * (y * z + w * x)
    matrix[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the (4,) quaternion of turning by (4,) ``second`` in the frame of ``first``."""
    w, x, y, z = first
    a, b, c, d = second
    return np.array(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the (N,) lengths of (N, 2) or (N, 3) vectors."""
    squares = (vectors * vectors).T
    # Column by column: NumPy takes longer to add up many rows of three.
    total = squares[0] + squares[1]
    return np.sqrt(total + squares[2] if len(squares) > 2 else total)
