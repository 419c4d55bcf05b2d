# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.worlds.simple_nav import GOAL, SimpleNav


def test_rewards_add_up_to_the_way_gained_plus_the_bonus():
    world = SimpleNav(4)
    start, _ = world.reset(seed=0)
    total, done = np.zeros(4), np.zeros(4, dtype=bool)
    while not done.all():
        observation, reward, terminated, truncated, _ = world.step(np.ones((4, 2)))
        total += np.where(done, 0.0, reward)
        if not done.any():
            last = observation
        done |= terminated
        assert not truncated.any()
    gained = np.linalg.norm(start - GOAL, axis=1) - np.linalg.norm(last - GOAL, axis=1)
    assert (total <= 1.0 + np.linalg.norm(start - GOAL, axis=1)).all()
    assert (total >= 1.0 + gained - 0.04).all()


def test_an_episode_that_does_not_arrive_is_truncated():
    world = SimpleNav(2)
    world.reset(seed=0)
    for step in range(1, world.max_episode_steps + 1):
        _, _, terminated, truncated, _ = world.step(np.zeros((2, 2)))
        assert not terminated.any()
        assert truncated.all() == (step == world.max_episode_steps)


@given(st.integers(0, 2**31), st.lists(st.tuples(*[st.floats(-1, 1)] * 2), max_size=60))
def test_robots_stay_on_the_square_and_the_cost_is_that_of_the_region(seed, actions):
    world = SimpleNav(1)
    observation, info = world.reset(seed=seed)
    for action in actions:
        observation, _, _, _, info = world.step(np.array([action]))
        (x, y) = observation[0].astype(np.float64)
        assert 0 <= x <= 1
        assert 0 <= y <= 1
        if abs(x - 0.7) > 1e-6 and abs(y - 0.3) > 1e-6:
            assert info['true_cost'][0] == (x < 0.7 and y > 0.3)


def test_a_robot_depends_on_seed_and_index_only():
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 7, 2))
    many, few = SimpleNav(7), SimpleNav(2)
    np.testing.assert_array_equal(many.reset(seed=5)[0][:2], few.reset(seed=5)[0])
    for action in actions:
        np.testing.assert_array_equal(many.step(action)[0][:2], few.step(action[:2])[0])
    mask = np.arange(7) % 2 == 0
    before = many._position.astype(np.float32)
    after, _ = many.reset(mask=mask)
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert (np.abs(after[mask] - 0.1) < 0.03).all()
