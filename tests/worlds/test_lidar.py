# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.worlds.lidar import BINS, lidar_returns
from occ_constraints_pkg.worlds.rotation import matrix_of, quaternion_of_yaw

_NEAR = st.floats(-2, 2)


def _upright(yaw):
    return matrix_of(quaternion_of_yaw(np.array([yaw])))


@given(_NEAR, _NEAR, st.floats(-7, 7), _NEAR, _NEAR)
def test_the_brightest_bin_tells_distance_and_bearing(x, y, yaw, ox, oy):
    distance = np.hypot(ox - x, oy - y)
    if not 1e-3 < distance < 2.99:
        return
    objects = np.array([[[ox, oy]]])
    lidar = lidar_returns(np.array([[x, y, 0.1]]), _upright(yaw), objects)[0, 0]
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
    assert (lidar_returns(np.zeros((1, 3)), _upright(0.0), objects) == 0).all()


def test_a_robot_that_leans_sees_the_floor_shifted():
    # Nose up by a small angle: what lies ahead on the floor seems closer by height times angle.
    angle = 0.05
    quaternion = np.array([[np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0]])
    lidar = lidar_returns(
        np.array([[0.0, 0.0, 0.1]]), matrix_of(quaternion), np.array([[[1.0, 0.0]]])
    )
    expected = np.cos(angle) - 0.1 * np.sin(angle)
    np.testing.assert_allclose(3 * (1 - lidar.max()), expected, atol=1e-12)
