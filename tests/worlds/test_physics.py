# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.bodies import CAR, CAR_BOX, POINT, POINT_BOX, VASE  # noqa: E402
from occ_constraints_pkg.worlds.physics import Physics  # noqa: E402


def _physics(kind, movable, robot, thing, pillars=()):
    count = len(robot)
    pillars = np.array(pillars, dtype=float).reshape(count, -1, 2)
    physics = Physics(kind, movable, pillars=pillars.shape[1], num_envs=count)
    return physics, physics.place(np.arange(count), np.array(robot), np.array(thing), pillars)


def _drive(physics, action, steps):
    for _ in range(steps):
        sensors, failed = physics.step(np.array([action] * len(physics.qpos), dtype=float))
        assert not failed.any()
    return sensors


def test_sensors_of_a_point_at_rest():
    _, sensors = _physics(POINT, VASE, [[0, 0, 0.0], [1, 1, np.pi / 2]], [[5, 5, 0.0]] * 2)
    expected = np.zeros((2, 12))
    expected[:, 2] = 9.81
    expected[:, 9:11] = [[0, -0.5], [-0.5, 0]]
    np.testing.assert_allclose(sensors, expected, atol=1e-12)


def test_sensors_of_a_car_at_rest():
    physics, _ = _physics(CAR, VASE, [[0, 0, np.pi / 2]], [[5, 5, 0.0]])
    sensors = _drive(physics, (0, 0), 100)[0]
    np.testing.assert_allclose(sensors[:3], [0, 0, 9.81], atol=0.1)
    np.testing.assert_allclose(sensors[3:9], 0, atol=0.02)
    np.testing.assert_allclose(sensors[9:12], [-0.5, 0, 0], atol=0.01)
    ball = sensors[15:].reshape(3, 3)
    np.testing.assert_allclose(ball @ ball.T, np.eye(3), atol=1e-12)


def test_full_thrust_reaches_the_known_speeds():
    physics, _ = _physics(POINT, VASE, [[0, 0, 0.0]], [[0, 3, 0.0]])
    speeds = []
    for _ in range(400):
        speeds.append(_drive(physics, (1, 0), 1)[0, 3])
    # Measured on the reference: 0.479 and 1.281 m/s after 10 and 50 steps, 1.50 in the end.
    np.testing.assert_allclose([speeds[9], speeds[49], speeds[-1]], [0.479, 1.281, 1.5], atol=2e-3)


def test_a_car_drives_along_minus_y_and_turns_on_the_spot():
    physics, _ = _physics(CAR, VASE, [[0, 0, 0.0]], [[0, 9, 0.0]])
    velocity = np.mean([_drive(physics, (1, 1), 1)[0, 3:6] for _ in range(100)][50:], axis=0)
    assert -0.85 < velocity[1] < -0.7
    assert physics.qpos[0, 1] < -1
    rates = [_drive(physics, (1, -1), 1)[0, 8] for _ in range(100)][50:]
    assert 1.0 < abs(np.mean(rates)) < 1.4


@pytest.mark.parametrize(
    ('kind', 'movable', 'action', 'start', 'least'),
    [
        (POINT, VASE, (1, 0), [-0.6, 0.02, 0.0], 0.1),
        (POINT, POINT_BOX, (1, 0), [-0.8, 0.02, 0.0], 0.1),
        (CAR, VASE, (1, 1), [-0.6, 0.02, np.pi / 2], 0.1),
        (CAR, CAR_BOX, (1, 1), [-0.6, 0.02, np.pi / 2], 0.1),
    ],
)
def test_a_thing_that_is_hit_moves_and_comes_to_rest(kind, movable, action, start, least):
    physics, _ = _physics(kind, movable, [start], [[0, 0, 0.0]])
    _drive(physics, action, 60)
    assert physics.movable[0, 0] > least
    _drive(physics, tuple(-np.array(action)), 150)
    resting = physics.movable.copy()
    assert abs(resting[0, 2] - movable.half_size) < 1e-3
    assert not physics._moves.any()
    _drive(physics, (0, 0), 50)
    np.testing.assert_array_equal(physics.movable, resting)


@pytest.mark.parametrize(
    ('kind', 'movable', 'action', 'yaw'),
    [(POINT, POINT_BOX, (1, 0), 0.0), (CAR, CAR_BOX, (1, 1), np.pi / 2)],
)
def test_a_pillar_stops_a_robot_where_it_stands_for_that_robot(kind, movable, action, yaw):
    starts, pillars = [[-0.8, 0, yaw]] * 3, [[[0, 0]], [[5, 5]], [[0.3, 0]]]
    physics, _ = _physics(kind, movable, starts, [[0, 9, 0.0]] * 3, pillars)
    _drive(physics, action, 120)
    reached = physics.qpos[:, 0]
    assert reached[0] < -0.3
    assert reached[1] > 0.5
    assert 0.15 < reached[2] - reached[0] < 0.35


def test_stepping_far_robots_alone_changes_nothing_but_rounding(monkeypatch):
    rng = np.random.default_rng(0)
    starts = np.column_stack([rng.uniform(-0.3, 0.3, (6, 2)), rng.uniform(0, 6, 6)])
    things, pillars = [[1.0, 1.0, 0.4]] * 6, [[[-1.0, 1.0]]] * 6
    alone, _ = _physics(POINT, POINT_BOX, starts, things, pillars)
    together, _ = _physics(POINT, POINT_BOX, starts, things, pillars)
    monkeypatch.setattr(together, '_near', lambda rows: np.ones(6, dtype=bool))
    for _ in range(40):
        action = rng.uniform(-1, 1, (6, 2))
        first, _ = alone.step(action)
        second, _ = together.step(action)
    assert not alone._moves.any()
    np.testing.assert_allclose(alone.qpos, together.qpos, atol=1e-4)
    np.testing.assert_allclose(alone.movable, together.movable, atol=1e-7)
    np.testing.assert_allclose(first[:, 3:5], second[:, 3:5], atol=1e-3)
