# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.agents.drivers import DRIVERS
from occ_constraints_pkg.agents.evaluation import evaluate
from occ_constraints_pkg.agents.safety_gym_drivers import Senses
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.lidar import lidar_readings
from occ_constraints_pkg.worlds.registry import make_world, world_class


def _driver(world, name):
    return DRIVERS[world][name](np.random.default_rng(0))


def _seeing(width, first, bearing, distance=1.5):
    """Return observations of one object each, at some bearings."""
    offsets = distance * np.array([np.cos(bearing), np.sin(bearing)])[:, None]
    observation = np.zeros((len(bearing), width))
    axes = np.tile(np.eye(3), (len(bearing), 1, 1))
    lidar = lidar_readings(offsets, 0.0, axes, (0,))
    observation[:, first : first + 16] = lidar[:, 0]
    return observation


@pytest.mark.parametrize('world', ['PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1'])
def test_senses_find_the_columns_of_each_world(world):
    pytest.importorskip('mujoco')
    names = [column.name for column in world_class(world).columns]
    observation = np.arange(len(names), dtype=np.float64)[None]
    senses = Senses(world, observation)
    places = names.index('velocimeter_x'), names.index('velocimeter_y')
    assert senses.velocity[0] == complex(*places)
    for kind in ('goal', 'hazards', 'vases', 'pillars', 'push_box'):
        if f'{kind}_lidar_0' in names:
            first = names.index(f'{kind}_lidar_0')
            np.testing.assert_array_equal(senses.lidar(kind)[0], np.arange(first, first + 16))
        else:
            assert not senses.lidar(kind).any()


def test_the_only_object_of_a_kind_is_where_its_lidar_says():
    bearing = np.linspace(-3.1, 3.1, 200)
    place = Senses('PointGoal1', _seeing(60, 12, bearing, 1.2)).only('goal')
    np.testing.assert_allclose(place, 1.2 * np.exp(1j * bearing), atol=1e-9)


def test_straightv_steers_by_goal_lidar_and_velocimeter():
    bearing = np.linspace(-3.1, 3.1, 200)
    observation = _seeing(60, 12, bearing)
    observation[:, 4] = 0.5
    action = _driver('PointGoal1', 'straightv')(observation)
    turn = np.arctan2(np.sin(bearing) - 0.5, np.cos(bearing))
    np.testing.assert_allclose(action[:, 1], np.clip(turn, -1, 1), atol=1e-9)
    np.testing.assert_array_equal(action[:, 0], np.abs(turn) < np.pi / 4)


def test_straight_turns_a_car_to_the_goal_with_its_minus_y_axis_ahead():
    bearing = np.linspace(-3.1, 3.1, 200)
    action = _driver('CarGoal1', 'straight')(_seeing(72, 24, bearing))
    turn = np.arctan2(np.cos(bearing), -np.sin(bearing))
    forward = np.abs(turn) < np.pi / 4
    expected = np.clip(np.column_stack([forward + turn, forward - turn]), -1, 1)
    np.testing.assert_allclose(action, expected, atol=1e-9)


def test_straightv_turns_to_the_hazards_when_the_goal_is_too_far_to_be_seen():
    observation = np.zeros((1, 60))
    observation[0, 28 + 4] = 0.5  # a hazard to the left
    action = _driver('PointGoal1', 'straightv')(observation)
    np.testing.assert_array_equal(action, [[0.0, 1.0]])


def test_an_avoider_turns_aside_from_a_hazard_ahead_and_goes_straight_without():
    bearing = np.zeros(1)
    free = _seeing(60, 12, bearing, 1.5)
    blocked = free.copy()
    blocked[:, 28:44] = _seeing(60, 28, bearing + 0.05, 0.5)[:, 28:44]
    drive = _driver('PointGoal1', 'avoider')
    assert abs(drive(free)[0, 1]) < 1e-9
    assert drive(free)[0, 0] == 1
    # The hazard is a little to the left, so it passes on the right.
    assert drive(blocked)[0, 1] < -0.3


@pytest.mark.parametrize(
    ('world', 'width', 'first'), [('PointPush1', 76, 12), ('CarPush1', 88, 24)]
)
def test_a_box_right_on_the_goal_is_pushed_in_some_direction(world, width, first):
    observation = _seeing(width, first, np.array([0.4]))
    observation[:, first + 48 : first + 64] = observation[:, first : first + 16]
    senses = Senses(world, observation)
    assert senses.only('goal') == senses.only('push_box')
    action = _driver(world, 'expert')(observation)
    assert np.isfinite(action).all()
    assert (np.abs(action) > 0.1).any()


@pytest.mark.parametrize(
    ('world', 'name', 'least_return', 'most_cost'),
    [
        ('PointGoal1', 'avoider', 2.0, 8.0),
        ('CarGoal1', 'avoider', 2.0, 8.0),
        ('PointPush1', 'avoider', 0.3, 8.0),
        ('CarPush1', 'avoider', 0.5, 8.0),
    ],
)
def test_avoiders_get_on_and_keep_out_of_hazards(world, name, least_return, most_cost, monkeypatch):
    pytest.importorskip('mujoco')
    simulated = make_world(world, 16)
    # A fifth of an episode tells enough.
    monkeypatch.setattr(simulated, 'max_episode_steps', 200)
    result = evaluate(simulated, _driver(world, name), episodes=16, seed=3)
    simulated.close()
    assert result.returns.mean() > least_return
    assert result.costs.mean() < most_cost


def test_wrong_observations_are_refused():
    for world, name, width in [('CarGoal1', 'straight', 72), ('PointPush1', 'avoider', 76)]:
        with pytest.raises(OccError, match=rf'shape \(3, 5\); allowed is \(N, {width}\)'):
            _driver(world, name)(np.zeros((3, 5)))
