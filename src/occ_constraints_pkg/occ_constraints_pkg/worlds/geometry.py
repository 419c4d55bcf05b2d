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
    matrix = np.zeros((3, 3, len(yaw)))
    matrix[0, 0] = matrix[1, 1] = np.cos(yaw)
    matrix[1, 0] = np.sin(yaw)
    matrix[0, 1] = -matrix[1, 0]
    matrix[2, 2] = 1.0
    return matrix.transpose(2, 0, 1)


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the (N, 3, 3) matrices of (N, 4) unit quaternions; columns are the body's axes."""
    scalar, vector = quaternion.T[0], quaternion.T[1:]
    # Twice each product of two components.
    double = 2 * vector
    xx, yy, zz = vector * double
    wx, wy, wz = scalar * double
    xy, yz = vector[:2] * double[1:]
    xz = vector[0] * double[2]
    matrix = np.empty((3, 3, len(quaternion)))
    matrix[0, 0] = 1 - (yy + zz)
    matrix[0, 1] = xy - wz
    matrix[0, 2] = xz + wy
    matrix[1, 0] = xy + wz
    matrix[1, 1] = 1 - (xx + zz)
    matrix[1, 2] = yz - wx
    matrix[2, 0] = xz - wy
    matrix[2, 1] = yz + wx
    matrix[2, 2] = 1 - (xx + yy)
    return matrix.transpose(2, 0, 1)


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


def lengths(x: np.ndarray, y: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
    """Return the (N,) lengths of N vectors with the components ``x``, ``y`` and perhaps ``z``."""
    squares = x * x + y * y
    return np.sqrt(squares if z is None else squares + z * z)
