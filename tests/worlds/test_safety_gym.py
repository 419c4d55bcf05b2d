# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.agents.drivers import DRIVERS
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.safety_gym import CarGoal1, PointGoal1, PointPush1  # noqa: E402

TASKS = ('PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1')


@pytest.mark.parametrize(
    ('name', 'width', 'lidars', 'seconds'),
    [
        ('PointGoal1', 60, ['goal', 'hazards', 'vases'], 0.02),
        ('CarGoal1', 72, ['goal', 'hazards', 'vases'], 0.04),
        ('PointPush1', 76, ['goal', 'hazards', 'pillars', 'push_box'], 0.02),
        ('CarPush1', 88, ['goal', 'hazards', 'pillars', 'push_box'], 0.04),
    ],
)
def test_columns_are_those_of_safety_gym_in_its_order(name, width, lidars, seconds):
    world = make_world(name, 1)
    names = [column.name for column in world.columns]
    assert world.name == name
    assert len(names) == width
    sensors = ['accelerometer', 'velocimeter', 'gyro', 'magnetometer']
    sensors += ['ballangvel_rear'] if 'Car' in name else []
    expected = [f'{sensor}_{axis}' for sensor in sensors for axis in 'xyz']
    if 'Car' in name:
        expected += [f'ballquat_rear_{row}{column}' for row in 'xyz' for column in 'xyz']
    expected += [f'{kind}_lidar_{index}' for kind in lidars for index in range(16)]
    assert names == expected
    assert world.step_seconds == pytest.approx(seconds)
    assert world.max_episode_steps == 1000


def _drive(name, num_envs, processes, actions):
    """Return every observation and reward, with things touched and some robots reset on the way."""
    world = make_world(name, num_envs, processes=processes)
    seen = [world.reset(seed=3)[0]]
    # What can be moved stands right ahead of all robots and the goal behind it.
    rngs = [np.random.default_rng(index) for index in range(num_envs)]
    layout = world.rules.sample_layout(rngs)
    heading = layout.robot[:, 2] + world.robot.forward
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    reach = world.movable.half_extents[0]
    layout.movable[:, :2] = layout.robot[:, :2] + (0.35 + reach) * ahead
    layout.movable[:, 2] = heading
    layout.goal[:] = layout.robot[:, :2] + (0.6 + reach) * ahead
    seen.append(world.start(np.arange(num_envs), layout))
    start = world._movable.copy(), world._goal.copy()
    for step, action in enumerate(actions):
        observation, reward, *_ = world.step(action[:num_envs])
        seen += [observation, reward]
        if step == 49:
            assert (world._movable != start[0]).any(axis=1).mean() > 0.8
            assert (world._goal != start[1]).any(axis=1).mean() > 0.5
            seen.append(world.reset(mask=np.arange(num_envs) % 2 == 0)[0])
    world.close()
    return seen


@pytest.mark.parametrize('name', TASKS)
def test_a_robot_depends_on_seed_index_and_actions_only(name):
    low, high = ([0.1, -0.1], [1.0, 0.1]) if 'Point' in name else ([0.6, 0.6], [1.0, 1.0])
    actions = np.random.default_rng(0).uniform(low, high, (60, 34, 2))
    reference = _drive(name, 34, 1, actions)
    for num_envs, processes in [(1, 1), (1, 2), (7, 0), (34, 2), (34, 3)]:
        for expected, got in zip(
            reference, _drive(name, num_envs, processes, actions), strict=True
        ):
            np.testing.assert_array_equal(got, expected[:num_envs])


@pytest.mark.parametrize('name', TASKS)
def test_a_reset_leaves_the_other_rows_alone(name):
    world = make_world(name, 6)
    world.reset(seed=0)
    before, *_ = world.step(np.ones((6, 2)))
    mask = np.array([True, False] * 3)
    after, info = world.reset(mask=mask)
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert (after[mask] != before[mask]).any(axis=1).all()
    assert (info['true_cost'] == 0).all()
    unchanged, _ = world.reset(mask=np.zeros(6, dtype=bool))
    np.testing.assert_array_equal(unchanged, after)


@pytest.mark.parametrize(
    ('name', 'radius', 'tolerance'),
    [
        ('PointGoal1', 0.2, 1e-6),
        ('PointPush1', 0.3, 1e-6),
        # A car leans a little, and with it its lidar.
        ('CarGoal1', 0.2, 5e-3),
        ('CarPush1', 0.3, 5e-3),
    ],
)
def test_the_cost_is_what_the_hazard_lidar_says(name, radius, tolerance):
    world = make_world(name, 24)
    world.reset(seed=1)
    # A hazard stands a little ahead of each robot.
    layout = world.rules.sample_layout([np.random.default_rng(index) for index in range(24)])
    heading = layout.robot[:, 2] + world.robot.forward
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    layout.hazards[:, 0] = layout.robot[:, :2] + 0.5 * ahead
    world.start(np.arange(24), layout)
    action = (1.0, 0.0) if 'Point' in name else (1.0, 1.0)
    first = len(world.robot.sensors) + 16
    costs = 0
    for _ in range(60):
        observation, _, _, _, info = world.step(np.array([action] * 24))
        nearest = observation[:, first : first + 16].max(axis=1)
        bound = 1 - radius / 3
        clear_cut = np.abs(nearest - bound) > tolerance
        np.testing.assert_array_equal(
            (nearest >= bound)[clear_cut], info['true_cost'][clear_cut] == 1
        )
        costs += info['true_cost'].sum()
    assert 100 < costs < 24 * 60 - 100


def test_goal_rewards_add_up_to_goals_reached_and_way_gained():
    world = PointGoal1(16)
    observation, _ = world.reset(seed=2)
    driver = DRIVERS['PointGoal1']['straightv'](np.random.default_rng(0))
    goals = 0
    for _ in range(250):
        before, goal = world._position.copy(), world._goal.copy()
        observation, reward, *_ = world.step(driver(observation))
        old, new = (np.linalg.norm(goal - at, axis=1) for at in (before, world._position))
        reached = new <= 0.3
        np.testing.assert_allclose(reward, old - new + reached, atol=1e-12)
        np.testing.assert_array_equal((world._goal != goal).any(axis=1), reached)
        goals += reached.sum()
    assert goals > 20


def test_push_rewards_count_the_way_to_the_box_and_of_the_box_in_three_dimensions():
    world = PointPush1(8)
    layout = world.rules.sample_layout([np.random.default_rng(index) for index in range(8)])
    ahead = np.column_stack([np.cos(layout.robot[:, 2]), np.sin(layout.robot[:, 2])])
    layout.movable[:] = np.column_stack([layout.robot[:, :2] + 0.6 * ahead, layout.robot[:, 2]])
    layout.goal[:] = layout.robot[:, :2] + 1.1 * ahead
    world.start(np.arange(8), layout)

    def ways(goal):
        box, robot = world.physics.movable[:, :3], np.full((8, 3), 0.1)
        robot[:, :2] = world._position
        to_goal = np.linalg.norm(box - np.column_stack([goal, np.full(8, 0.16)]), axis=1)
        return np.linalg.norm(box - robot, axis=1), to_goal

    goals = 0
    for _ in range(80):
        goal = world._goal.copy()
        old = sum(ways(goal))
        _, reward, *_ = world.step(np.array([[1.0, 0.0]] * 8))
        to_box, to_goal = ways(goal)
        reached = to_goal <= 0.3
        np.testing.assert_allclose(reward, old - to_box - to_goal + reached, atol=1e-12)
        np.testing.assert_array_equal((world._goal != goal).any(axis=1), reached)
        goals += reached.sum()
    assert goals > 2


def test_episodes_end_by_truncation_after_1000_steps():
    stream = EpisodeStream(PointGoal1(2), seed=0)
    stream.reset()
    for step in range(1, 1002):
        batch = stream.step(np.zeros((2, 2)))
        assert not batch.terminated.any()
        assert batch.truncated.all() == (step == 1000)
    assert (batch.episode == 1).all()


def test_no_room_for_the_next_goal_ends_the_episode(monkeypatch):
    world = PointGoal1(1)
    layout = world.rules.sample_layout([np.random.default_rng(0)])
    monkeypatch.setattr(world, 'rules', type('Full', (), {'sample_goal': lambda *_: None})())
    layout.goal[0] = layout.robot[0, :2]
    world.start(np.array([0]), layout)
    _, reward, terminated, _, info = world.step(np.zeros((1, 2)))
    assert terminated[0]
    assert not info['failed'][0]
    assert reward[0] == pytest.approx(1.0)


@pytest.mark.parametrize('speed', [1e12, np.nan, np.inf])
@pytest.mark.parametrize('kind', [PointGoal1, CarGoal1])
def test_a_robot_whose_physics_blows_up_ends_alone(kind, speed, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning into a file in the working folder.
    world, twin = kind(4), kind(4)
    last, _ = world.reset(seed=0)
    twin.reset(seed=0)
    world.physics.qvel[1, 0] = speed
    observation, reward, terminated, truncated, info = world.step(np.ones((4, 2)))
    assert info['failed'].tolist() == terminated.tolist() == [False, True, False, False]
    assert reward[1] == -10
    assert not truncated.any()
    np.testing.assert_array_equal(observation[1], last[1])
    others = [0, 2, 3]
    np.testing.assert_array_equal(observation[others], twin.step(np.ones((4, 2)))[0][others])
    fresh, _ = world.reset(mask=terminated)
    assert (fresh[1] != last[1]).any()
    assert not world.step(np.ones((4, 2)))[4]['failed'].any()
