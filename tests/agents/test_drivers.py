# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.agents.drivers import DRIVERS, check_driver, find_driver
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.worlds.highway import Highway, RestrictedHighway
from occ_constraints_pkg.worlds.simple_nav import SimpleNav
from occ_constraints_pkg.worlds.stream import EpisodeStream


def _episodes(name, num_envs, seed):
    """Return return and cost of one episode of each robot, and every state in it."""
    world = SimpleNav(num_envs)
    stream = EpisodeStream(world, seed=seed)
    driver = DRIVERS['simple_nav'][name](np.random.default_rng(seed))
    batch, states = stream.reset(), []
    total, cost, alive = np.zeros(num_envs), np.zeros(num_envs), np.ones(num_envs, dtype=bool)
    while alive.any():
        states.append(batch.observation[alive])
        batch = stream.step(driver(batch.observation))
        total += batch.reward * alive
        cost += batch.true_cost * alive
        alive &= ~batch.done
    return total, cost, np.concatenate(states)


def test_the_expert_arrives_without_cost_and_shows_the_whole_safe_region():
    total, cost, states = _episodes('expert', 100, seed=0)
    assert (total > 2).all()
    assert (cost == 0).all()
    x, y = states.T
    assert ((y < 0.3) | (x > 0.7)).all()
    bottom, side = states[y < 0.3], states[x > 0.7]
    np.testing.assert_allclose(bottom.min(axis=0), [0.1, 0.1], atol=0.03)
    np.testing.assert_allclose(bottom.max(axis=0), [0.9, 0.3], atol=0.03)
    np.testing.assert_allclose(side.min(axis=0), [0.7, 0.1], atol=0.03)
    np.testing.assert_allclose(side.max(axis=0), [0.9, 0.9], atol=0.03)


def test_the_expert_takes_a_new_lane_in_each_episode():
    stream = EpisodeStream(SimpleNav(1), seed=0)
    driver = DRIVERS['simple_nav']['expert'](np.random.default_rng(0))
    batch, lanes = stream.reset(), {}
    while batch.episode[0] < 6:
        batch = stream.step(driver(batch.observation))
        x, y = batch.observation[0]
        if 0.4 < x < 0.6:
            lanes.setdefault(int(batch.episode[0]), []).append(y)
        assert batch.true_cost[0] == 0
    means = np.array([np.mean(lane) for lane in lanes.values()])
    assert len(means) == 6
    assert means.max() - means.min() > 0.04


def test_straight_is_faster_and_pays_for_it():
    total, cost, _ = _episodes('straight', 20, seed=0)
    assert (total > 2).all()
    assert (cost > 10).all()


@pytest.mark.parametrize('world', DRIVERS)
def test_random_is_uniform_and_repeatable(world):
    observation = np.zeros((500, 60))
    first, second = (
        DRIVERS[world]['random'](np.random.default_rng(3))(observation) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
    assert first.shape == (500, 2)
    assert np.abs(first).max() <= 1
    assert first.std() == pytest.approx(1 / np.sqrt(3), abs=0.03)


def test_unknown_names_and_wrong_observations_are_refused():
    with pytest.raises(ConfigurationError, match='the worlds are simple_nav, PointGoal1'):
        check_driver('maze', 'random')
    with pytest.raises(ConfigurationError, match='allowed are random, straightv, avoider'):
        check_driver('PointGoal1', 'straight')
    with pytest.raises(ConfigurationError, match=r'shape \(3, 5\)'):
        DRIVERS['simple_nav']['expert'](np.random.default_rng(0))(np.zeros((3, 5)))


def test_the_expert_of_the_highway_drives_all_restricted_scenarios_without_a_violation():
    number = RestrictedHighway.scenarios
    world = RestrictedHighway(number)
    observation, _ = world.start(np.arange(number), list(range(number)))
    drive, same = (
        find_driver(kind, 'expert', np.random.default_rng(0))
        for kind in (RestrictedHighway, Highway)
    )
    np.testing.assert_array_equal(drive(observation), same(observation))
    for _ in range(world.max_episode_steps):
        observation, _, terminated, truncated, _ = world.step(drive(observation))
        assert not terminated.any()
    assert truncated.all()
