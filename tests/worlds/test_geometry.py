# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.worlds.geometry import matrix_of, quaternion_of_yaw


@given(st.floats(-7, 7))
def test_a_yaw_turns_in_the_plane(yaw):
    matrix = matrix_of(quaternion_of_yaw(np.array([yaw])))[0]
    expected = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    np.testing.assert_allclose(matrix, expected, atol=1e-12)


def test_columns_are_the_axes_of_the_body():
    # A quarter turn about x: the body's y axis points up.
    half = np.sqrt(0.5)
    matrix = matrix_of(np.array([[half, half, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(matrix, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
