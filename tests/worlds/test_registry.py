# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import sys

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.registry import WORLDS, make_world


@pytest.fixture(params=WORLDS)
def world(request):
    if request.param != 'simple_nav':
        pytest.importorskip('mujoco')
    world = make_world(request.param, 3)
    yield world
    world.close()


def test_a_world_is_what_its_columns_say(world):
    observation, info = world.reset(seed=0)
    assert observation.shape == (3, len(world.columns))
    assert observation.dtype == np.float32
    assert info['true_cost'].shape == (3,)
    names = [column.name for column in world.columns + world.action_columns]
    assert len(set(names)) == len(names)
    low = np.array([column.low for column in world.columns])
    high = np.array([column.high for column in world.columns])
    rng = np.random.default_rng(0)
    for _ in range(20):
        observation, reward, terminated, truncated, info = world.step(
            rng.uniform(-1, 1, (3, len(world.action_columns)))
        )
        assert ((observation >= low) & (observation <= high)).all()
        assert observation.dtype == np.float32
        assert reward.dtype == info['true_cost'].dtype == np.float64
        assert terminated.dtype == truncated.dtype == bool


def test_an_action_beyond_the_bounds_is_clipped(world):
    world.reset(seed=1)
    far, *_ = world.step(np.full((3, 2), 50.0))
    world.reset(seed=1)
    near, *_ = world.step(np.full((3, 2), 1.0))
    np.testing.assert_array_equal(far, near)


@pytest.mark.parametrize(
    ('action', 'told'),
    [
        (np.zeros((2, 2)), r'shape \(2, 2\)'),
        (np.zeros((3, 3)), r'shape \(3, 3\)'),
        (np.zeros(6), r'shape \(6,\)'),
        (np.array([[0, 0], [0, np.nan], [0, 0]]), 'nan as .* of robot 1'),
        (np.array([[0, 0], [0, 0], [np.inf, 0]]), 'inf as .* of robot 2'),
    ],
)
def test_a_faulty_action_is_refused_and_changes_nothing(world, action, told):
    world.reset(seed=2)
    expected = world.step(np.full((3, 2), 0.5))[0]
    world.reset(seed=2)
    with pytest.raises(OccError, match=told):
        world.step(action)
    np.testing.assert_array_equal(world.step(np.full((3, 2), 0.5))[0], expected)


def test_a_faulty_reset_is_refused(world):
    with pytest.raises(OccError, match=r'mask has shape \(2,\)'):
        world.reset(mask=np.ones(2, dtype=bool))
    with pytest.raises(OccError, match='type int64'):
        world.reset(mask=np.ones(3, dtype=np.int64))
    with pytest.raises(OccError, match='seed was -1'):
        world.reset(seed=-1)


@pytest.mark.parametrize(
    ('name', 'num_envs', 'processes', 'told'),
    [
        ('PointGaol1', 1, 0, 'the worlds are simple_nav, PointGoal1, PointPush1'),
        ('simple_nav', 0, 0, '0 robots; allowed are 1 to 100000'),
        ('PointGoal1', 100_001, 0, '100001 robots; allowed are 1 to 100000'),
        ('simple_nav', 1, -1, '0 or more'),
    ],
)
def test_a_faulty_request_is_refused(name, num_envs, processes, told):
    with pytest.raises(OccError, match=told):
        make_world(name, num_envs, processes=processes)


def test_without_mujoco_the_message_says_what_to_install(monkeypatch):
    for module in [name for name in sys.modules if name.endswith(('safety_gym', 'worlds.physics'))]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with pytest.raises(OccError, match=r"pip install 'occ_constraints_pkg\[train\]'"):
        make_world('PointGoal1', 1)
