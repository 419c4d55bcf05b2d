# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.point_physics import PointPhysics  # noqa: E402


def _physics(robot, vase):
    physics = PointPhysics(len(robot), threads=1)
    sensors = physics.place(np.arange(len(robot)), np.array(robot), np.array(vase))
    return physics, sensors


def test_sensors_at_rest():
    _, sensors = _physics([[0, 0, 0.0], [1, 1, np.pi / 2]], [[5, 5, 0.0], [5, 5, 0.0]])
    expected = np.zeros((2, 12))
    expected[:, 2] = 9.81
    expected[:, 9:11] = [[0, -0.5], [-0.5, 0]]
    np.testing.assert_allclose(sensors, expected, atol=1e-12)


def test_full_thrust_reaches_the_known_speeds():
    physics, _ = _physics([[0, 0, 0.0]], [[0, 3, 0.0]])
    speeds = []
    for _ in range(400):
        sensors, _ = physics.step(np.array([[1.0, 0.0]]))
        speeds.append(sensors[0, 3])
    # Measured on the reference: 0.479 and 1.281 m/s after 10 and 50 steps, 1.50 in the end.
    np.testing.assert_allclose([speeds[9], speeds[49], speeds[-1]], [0.479, 1.281, 1.5], atol=2e-3)


def test_a_vase_that_is_hit_moves_and_comes_to_rest():
    physics, _ = _physics([[-0.6, 0.02, 0.0]], [[0, 0, 0.3]])
    for _ in range(50):
        physics.step(np.array([[1.0, 0.0]]))
    assert physics.vase[0, 0] > 0.1
    for _ in range(150):
        physics.step(np.array([[-1.0, 0.0]]))
    resting = physics.vase.copy()
    assert abs(resting[0, 2] - 0.1) < 1e-3
    for _ in range(50):
        physics.step(np.array([[0.0, 0.0]]))
    np.testing.assert_array_equal(physics.vase, resting)


def test_the_robot_alone_moves_as_it_does_beside_a_vase():
    # One vase is near enough to be simulated, yet out of the robot's way.
    physics, _ = _physics([[0, 0, 0.0]] * 2, [[0.0, 0.38, 0.0], [0.0, 3.0, 0.0]])
    for _ in range(20):
        sensors, _ = physics.step(np.full((2, 2), [0.03, 0.0]))
    np.testing.assert_allclose(physics.robot[0], physics.robot[1], atol=1e-12)
    np.testing.assert_allclose(sensors[0], sensors[1], atol=1e-9)
    # A vase at rest that is simulated stays where one that is not simulated is kept.
    np.testing.assert_allclose(physics.vase[0], [0, 0.38, 0.1, 1, 0, 0, 0], atol=1e-4)
