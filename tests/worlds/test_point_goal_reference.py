# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Step by step against traces of safety-gymnasium 1.0.0 (MuJoCo 2.3.3), random actions."""

import os
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.worlds.layout import Layout

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.point_goal import PointGoal1  # noqa: E402

_DATA = Path(os.environ.get('OCC_TEST_DATA', Path(__file__).parents[3] / 'shared' / 'data'))
_TRACES = _DATA / 'safety_gym_traces' / 'PointGoal1_random.npz'
# The robot's reach plus the corner of the vase; nothing touches the vase further off than this.
_VASE_REACH = 0.31


@pytest.fixture(scope='module')
def episodes():
    if not _TRACES.is_file():
        pytest.skip(f'no reference traces at {_TRACES}')
    with np.load(_TRACES) as file:
        keys = ('obs', 'pos', 'yaw', 'vel', 'goal', 'act', 'rew', 'cost', 'hazards', 'vase')
        episodes = [{key: file[f'{number}_{key}'] for key in keys} for number in range(5)]
    for episode in episodes:
        gap = np.linalg.norm(episode['pos'][:, :2] - episode['vase'][0, :2], axis=1)
        touched = np.flatnonzero(gap < _VASE_REACH)
        episode['steps'] = touched[0] if len(touched) else len(gap)
    return episodes


def _layout(episode, steps):
    count = len(steps)
    return Layout(
        robot=np.column_stack([episode['pos'][steps, :2], episode['yaw'][steps]]),
        goal=episode['goal'][steps, :2],
        hazards=np.repeat(episode['hazards'][None, :, :2], count, axis=0),
        # The vase's yaw is not recorded; nothing here depends on it.
        vase=np.tile([*episode['vase'][0, :2], 0.0], (count, 1)),
    )


def test_every_single_step(episodes):
    """From each recorded state, one step gives the next: state, reward, cost, every column."""
    compared = 0
    for episode in episodes:
        steps = np.arange(episode['steps'] - 1)
        world = PointGoal1(len(steps))
        # The yaw rate is what the gyro read.
        velocity = np.column_stack([episode['vel'][steps, :2], episode['obs'][steps, 8]])
        world.start(steps, _layout(episode, steps), velocity)
        observation, reward, terminated, truncated, info = world.step(episode['act'][steps])
        expected = episode['obs'][steps + 1]
        np.testing.assert_allclose(
            world._physics.robot[:, :2], episode['pos'][steps + 1, :2], atol=1e-13
        )
        turn = world._physics.robot[:, 2] - episode['yaw'][steps + 1]
        np.testing.assert_allclose(np.remainder(turn + 1, 2 * np.pi) - 1, 0, atol=1e-11)
        np.testing.assert_allclose(reward, episode['rew'][steps], atol=1e-12)
        np.testing.assert_array_equal(info['true_cost'], episode['cost'][steps])
        same_goal = (episode['goal'][steps] == episode['goal'][steps + 1]).all(axis=1)
        np.testing.assert_allclose(observation[:, :12], expected[:, :12], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(observation[:, 28:], expected[:, 28:], atol=1e-6)
        np.testing.assert_allclose(
            observation[same_goal, 12:28], expected[same_goal, 12:28], atol=1e-6
        )
        assert not (terminated | truncated | info['failed']).any()
        compared += len(steps)
    assert compared > 4000


def test_first_observation(episodes):
    for episode in episodes:
        world = PointGoal1(1)
        observation = world.start(np.array([0]), _layout(episode, np.array([0])))
        np.testing.assert_allclose(observation[0], episode['obs'][0], atol=1e-6)


def test_a_whole_episode_from_its_start(episodes):
    """The turning servo chatters, which amplifies rounding: the path still stays within 10 cm."""
    for episode in episodes:
        world = PointGoal1(1)
        world.start(np.array([0]), _layout(episode, np.array([0])))
        for step in range(episode['steps']):
            error = np.linalg.norm(world._position[0] - episode['pos'][step, :2])
            assert error < (1e-9 if step < 10 else 0.1)
            world.step(episode['act'][step : step + 1])
