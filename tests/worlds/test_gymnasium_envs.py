# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import warnings

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.registry import WORLDS, make_world

gymnasium = pytest.importorskip('gymnasium')
pytest.importorskip('mujoco')
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from occ_constraints_pkg.worlds import gymnasium_envs  # noqa: E402


def _name(world):
    return f'occ_constraints/{world}-v0'


@pytest.mark.parametrize('world', WORLDS)
def test_one_robot_passes_gymnasiums_own_check(world):
    env = gymnasium.make(_name(world))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        # It advises bounds for every observation; an acceleration has none.
        warnings.filterwarnings('ignore', message='.*Box observation space (minimum|maximum).*')
        check_env(env.unwrapped, skip_render_check=True)
    assert env.spec.id == _name(world)


@pytest.mark.parametrize('world', ['simple_nav', 'CarPush1'])
def test_one_robot_does_what_the_world_does(world):
    env, simulated = gymnasium.make(_name(world)), make_world(world, 1)
    expected, _ = simulated.reset(seed=3)
    observation, info = env.reset(seed=3)
    np.testing.assert_array_equal(observation, expected[0])
    assert info['cost'] == 0.0
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 2)).astype(np.float32):
        observation, reward, terminated, truncated, info = env.step(action)
        rows, rewards, *_, told = simulated.step(action[None])
        np.testing.assert_array_equal(observation, rows[0])
        assert reward == rewards[0]
        assert info['cost'] == told['true_cost'][0]
        assert not terminated
        assert not truncated
    with pytest.raises(OccError, match='nan as'):
        env.unwrapped.step(np.array([np.nan, 0.0]))
    env.close()


def test_a_batch_starts_anew_in_the_same_step_and_hands_over_the_last_observation():
    envs = gymnasium.make_vec(_name('simple_nav'), num_envs=3)
    assert isinstance(envs, gymnasium_envs.WorldVectorEnv)
    assert envs.metadata['autoreset_mode'] == AutoresetMode.SAME_STEP
    observation, info = envs.reset(seed=0)
    assert observation in envs.observation_space
    assert info['_cost'].all()
    action = np.array([[1.0, 1.0], [0.7, 0.7], [0.0, 0.0]], dtype=np.float32)
    ends = np.zeros(3, dtype=int)
    for _ in range(160):
        observation, reward, terminated, truncated, info = envs.step(action)
        assert observation in envs.observation_space
        done = terminated | truncated
        assert ('final_obs' in info) == done.any()
        assert (np.abs(observation[done] - 0.1) < 0.03).all()
        # Costs belong to the observations beside them: the starts are free of cost.
        assert (info['cost'][done] == 0).all()
        for row in np.flatnonzero(done):
            assert info['_final_obs'][row]
            assert info['_final_info'][row]
            last = info['final_obs'][row]
            assert terminated[row] == (np.linalg.norm(last - 0.9) < 0.04)
            x, y = last
            assert info['final_info']['cost'][row] == (x < 0.7 and y > 0.3)
            assert terminated[row] == (reward[row] > 1)
        if done.any():
            np.testing.assert_array_equal(info['_final_obs'], done)
            assert all(info['final_obs'][row] is None for row in np.flatnonzero(~done))
        ends += done
    assert ends[0] > ends[1] > ends[2] == 1
    envs.close()


def test_a_batch_is_the_world_and_resets_by_mask():
    envs = gymnasium.make_vec(_name('PointGoal1'), num_envs=4, processes=1)
    world = make_world('PointGoal1', 4)
    expected, _ = world.reset(seed=5)
    observation, _ = envs.reset(seed=5)
    np.testing.assert_array_equal(observation, expected)
    actions = envs.action_space.sample()
    observation, reward, _, _, info = envs.step(actions)
    expected, rewards, _, _, told = world.step(actions)
    np.testing.assert_array_equal(observation, expected)
    np.testing.assert_array_equal(reward, rewards)
    np.testing.assert_array_equal(info['failed'], told['failed'])
    mask = np.array([True, False, False, True])
    fresh, info = envs.reset(options={'reset_mask': mask})
    np.testing.assert_array_equal(fresh[~mask], observation[~mask])
    assert (fresh[mask] != observation[mask]).any(axis=1).all()
    np.testing.assert_array_equal(info['_cost'], mask)
    envs.close()


def test_a_render_mode_may_be_none_and_another_is_refused():
    for make in (gymnasium.make, gymnasium.make_vec):
        make(_name('simple_nav'), render_mode=None).close()
        with pytest.raises(OccError, match='allowed is None'):
            make(_name('simple_nav'), render_mode='human')
