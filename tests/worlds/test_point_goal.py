# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.agents.scripted import make_driver
from occ_constraints_pkg.worlds.layout import sample_layout
from occ_constraints_pkg.worlds.stream import EpisodeStream

pytest.importorskip('mujoco')
point_goal = pytest.importorskip('occ_constraints_pkg.worlds.point_goal')
PointGoal1 = point_goal.PointGoal1


def _drive(num_envs, threads, actions):
    """Return every observation and reward, and the vases, with some robots reset on the way."""
    world = PointGoal1(num_envs, threads=threads)
    seen = [world.reset(seed=3)[0]]
    # Vases right ahead of all robots, goals behind them: every robot does all there is to do.
    layout = sample_layout([np.random.default_rng(index) for index in range(num_envs)])
    ahead = np.column_stack([np.cos(layout.robot[:, 2]), np.sin(layout.robot[:, 2])])
    layout.vase[:, :2] = layout.robot[:, :2] + 0.45 * ahead
    layout.goal[:] = layout.robot[:, :2] + 0.7 * ahead
    seen.append(world.start(np.arange(num_envs), layout))
    start = world._vase.copy(), world._goal.copy()
    for step, action in enumerate(actions):
        observation, reward, *_ = world.step(action[:num_envs])
        seen += [observation, reward]
        if step == 59:
            assert (world._vase != start[0]).any(axis=1).all()
            assert (world._goal != start[1]).any(axis=1).mean() > 0.8
            seen.append(world.reset(mask=np.arange(num_envs) % 2 == 0)[0])
    world.close()
    return seen


def test_a_robot_depends_on_seed_index_and_actions_only():
    actions = np.random.default_rng(0).uniform([0.1, -0.1], [1.0, 0.1], (100, 40, 2))
    reference = _drive(40, 1, actions)
    for num_envs, threads in [(1, 1), (7, 0), (40, 3)]:
        for expected, got in zip(reference, _drive(num_envs, threads, actions), strict=True):
            np.testing.assert_array_equal(got, expected[:num_envs])


def test_a_reset_leaves_the_other_rows_alone():
    world = PointGoal1(6)
    world.reset(seed=0)
    before, *_ = world.step(np.ones((6, 2)))
    mask = np.array([True, False] * 3)
    after, info = world.reset(mask=mask)
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert (after[mask] != before[mask]).any(axis=1).all()
    assert (info['true_cost'] == 0).all()
    unchanged, _ = world.reset(mask=np.zeros(6, dtype=bool))
    np.testing.assert_array_equal(unchanged, after)


def test_the_cost_is_what_the_hazard_lidar_says():
    world = PointGoal1(32)
    observation, _ = world.reset(seed=1)
    driver = make_driver('PointGoal1', 'straightv', np.random.default_rng(0))
    costs = 0
    for _ in range(300):
        observation, _, _, _, info = world.step(driver(observation))
        nearest = observation[:, 28:44].max(axis=1)
        clear_cut = np.abs(nearest - (1 - 0.2 / 3)) > 1e-6
        np.testing.assert_array_equal(
            (nearest >= 1 - 0.2 / 3)[clear_cut], info['true_cost'][clear_cut] == 1
        )
        costs += info['true_cost'].sum()
    assert costs > 50


def test_rewards_add_up_to_goals_reached_and_way_gained():
    world = PointGoal1(16)
    observation, _ = world.reset(seed=2)
    driver = make_driver('PointGoal1', 'straightv', np.random.default_rng(0))
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


def test_episodes_end_by_truncation_after_1000_steps():
    stream = EpisodeStream(PointGoal1(2), seed=0)
    stream.reset()
    for step in range(1, 1002):
        batch = stream.step(np.zeros((2, 2)))
        assert not batch.terminated.any()
        assert batch.truncated.all() == (step == 1000)
    assert (batch.episode == 1).all()


def test_no_room_for_the_next_goal_ends_the_episode(monkeypatch):
    monkeypatch.setattr(point_goal, 'sample_goal', lambda rng, obstacles: None)
    world = PointGoal1(1)
    layout = sample_layout([np.random.default_rng(0)])
    layout.goal[0] = layout.robot[0, :2]
    world.start(np.array([0]), layout)
    _, reward, terminated, _, info = world.step(np.zeros((1, 2)))
    assert terminated[0]
    assert not info['failed'][0]
    assert reward[0] == pytest.approx(1.0)


@pytest.mark.parametrize('speed', [1e12, np.nan, np.inf])
def test_a_robot_whose_physics_blows_up_ends_alone(speed, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning into a file in the working folder.
    world, twin = PointGoal1(4), PointGoal1(4)
    last, _ = world.reset(seed=0)
    twin.reset(seed=0)
    world._physics.robot_velocity[1, 0] = speed
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


def test_returns_and_costs_are_those_of_the_reference():
    # Means of 50 episodes of safety-gymnasium 1.0.0: return 18.36 +- 1.40, cost 44.1 +- 33.0 and
    # speed 0.732 m/s; the bands are about four standard errors of both means.
    world = PointGoal1(48)
    observation, _ = world.reset(seed=4)
    driver = make_driver('PointGoal1', 'straightv', np.random.default_rng(0))
    total, cost, speed = np.zeros(48), np.zeros(48), 0.0
    for _ in range(1000):
        observation, reward, _, _, info = world.step(driver(observation))
        total += reward
        cost += info['true_cost']
        speed += np.hypot(observation[:, 3], observation[:, 4]).mean() / 1000
    assert abs(total.mean() - 18.36) < 1.2
    assert abs(cost.mean() - 44.1) < 28
    assert abs(speed - 0.732) < 0.02
