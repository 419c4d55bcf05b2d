# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.worlds.lidar import BINS, lidar_returns

_NEAR = st.floats(-2, 2)


@given(_NEAR, _NEAR, st.floats(-7, 7), _NEAR, _NEAR)
def test_the_brightest_bin_tells_distance_and_bearing(x, y, yaw, ox, oy):
    distance = np.hypot(ox - x, oy - y)
    if not 1e-3 < distance < 2.99:
        return
    lidar = lidar_returns(np.array([[x, y]]), np.array([yaw]), np.array([[[ox, oy]]]))[0, 0]
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
    lidar = lidar_returns(np.zeros((1, 2)), np.zeros(1), np.array([[[3.0, 0.0], [0.0, -9.0]]]))
    assert (lidar == 0).all()
