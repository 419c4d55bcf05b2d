# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.worlds.geometry import matrix_of, quaternion_of_yaw
from occ_constraints_pkg.worlds.lidar import BINS, lidar_readings

_NEAR = st.floats(-2, 2)


def _upright(yaw):
    return matrix_of(quaternion_of_yaw(np.array([yaw])))


def _read(position, axes, objects, lidars=None):
    """Return what the lidars read, or the one that sees all objects."""
    offsets = (objects - position[:, None, :2]).T
    return lidar_readings(offsets, position[:, 2], axes, lidars or (0,) * objects.shape[1])


@given(_NEAR, _NEAR, st.floats(-7, 7), _NEAR, _NEAR)
def test_the_brightest_bin_tells_distance_and_bearing(x, y, yaw, ox, oy):
    distance = np.hypot(ox - x, oy - y)
    if not 1e-3 < distance < 2.99:
        return
    objects = np.array([[[ox, oy]]])
    lidar = _read(np.array([[x, y, 0.1]]), _upright(yaw), objects)[0, 0]
    strength = (3 - distance) / 3
    np.testing.assert_allclose(lidar.max(), strength, rtol=1e-12)
    place = (np.arctan2(oy - y, ox - x) - yaw) % (2 * np.pi) / (2 * np.pi / BINS)
    holder, share = int(place) % BINS, place % 1
    expected = np.zeros(BINS)
    expected[holder] = strength
    expected[(holder + 1) % BINS] = share * strength
    expected[(holder - 1) % BINS] = (1 - share) * strength
    if 1e-6 < share < 1 - 1e-6:
        np.testing.assert_allclose(lidar, expected, atol=1e-9)


def test_an_object_out_of_reach_is_not_seen():
    objects = np.array([[[3.0, 0.0], [0.0, -9.0]]])
    assert (_read(np.zeros((1, 3)), _upright(0.0), objects) == 0).all()


def test_a_robot_that_leans_sees_the_floor_shifted():
    # Nose up by a small angle: what lies ahead on the floor seems closer by height times angle.
    angle = 0.05
    quaternion = np.array([[np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0]])
    lidar = _read(np.array([[0.0, 0.0, 0.1]]), matrix_of(quaternion), np.array([[[1.0, 0.0]]]))
    expected = np.cos(angle) - 0.1 * np.sin(angle)
    np.testing.assert_allclose(3 * (1 - lidar.max()), expected, atol=1e-12)


def test_each_lidar_reads_the_nearest_of_its_own_objects():
    rng = np.random.default_rng(0)
    position, objects = rng.uniform(-1, 1, (5, 3)), rng.uniform(-2, 2, (5, 4, 2))
    axes = matrix_of(quaternion_of_yaw(rng.uniform(0, 6, 5)))
    readings = _read(position, axes, objects, (0, 1, 1, 2))
    alone = [_read(position, axes, objects[:, [number]])[:, 0] for number in range(4)]
    np.testing.assert_array_equal(readings[:, 0], alone[0])
    np.testing.assert_array_equal(readings[:, 1], np.maximum(alone[1], alone[2]))
    np.testing.assert_array_equal(readings[:, 2], alone[3])
