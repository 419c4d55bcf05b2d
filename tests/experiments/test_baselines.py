# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The baselines, on the paper's two-dimensional example."""

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream

pytest.importorskip('sklearn', reason="needs the extra 'dev'")

from experiments.baselines import STATIC, HullOfMeans, minimum_and_maximum
from experiments.paper.watched import WatchedWorld
from experiments.states import demonstrate, driver_of, first_episodes

WORLD = 'simple_nav'


@pytest.fixture(scope='module')
def expert():
    values, episodes = demonstrate(WORLD, 'expert', 30, seed=1)
    return values.astype(np.float64), episodes


@pytest.fixture(scope='module')
def straight():
    """Return states of the driver that heads straight for the goal, episodes, and true cost."""
    world = make_world(WORLD, 20)
    driver = driver_of(world, 'straight', np.random.default_rng(1))
    values, episodes, costly = first_episodes(world, driver, load_feature_map(WORLD), 3)
    return values.astype(np.float64), episodes, costly


def test_minimum_and_maximum_flags_just_what_was_not_demonstrated(expert):
    values, _ = expert
    flags = minimum_and_maximum(values)
    assert not flags(values).any()
    corners = np.array([values.min(axis=0), values.max(axis=0)])
    assert not flags(corners).any()
    assert flags(corners + [[-1e-9, 0.0], [0.0, 1e-9]]).all()


@pytest.mark.parametrize('name', STATIC)
def test_what_judges_single_states_accepts_the_expert(name, expert, straight):
    values, _ = expert
    flags = STATIC[name](values)
    assert flags(values).mean() <= 0.02
    # A box cannot see the corner, nor does a forest that flags 1 % of the demonstrations.
    found = score_flags(flags(straight[0]), straight[2]).f1
    assert (found > 0.8) == (name == 'one-class SVM')


def test_the_hull_of_means_judges_episodes(expert, straight):
    hull = HullOfMeans.of(*expert)
    values, episodes = expert
    last = np.array([np.flatnonzero(episodes == name)[-1] for name in np.unique(episodes)])
    assert not hull.flags(values, episodes)[last].any()
    values, episodes, _ = straight
    last = np.array([np.flatnonzero(episodes == name)[-1] for name in np.unique(episodes)])
    assert hull.flags(values, episodes)[last].all()


@pytest.mark.parametrize('features', [1, 2, 7])
def test_a_hull_holds_all_mixtures_of_its_means_and_nothing_far_away(features):
    rng = np.random.default_rng(features)
    means = rng.normal(size=(30, features))
    hull = HullOfMeans.of(means, np.arange(30))
    mixtures = rng.dirichlet(np.ones(30), 50) @ means
    assert not hull.outside(mixtures).any()
    assert hull.outside(means.mean(axis=0) + 10 * hull.directions).all()


@pytest.mark.parametrize('name', ['ICRL', 'MCE-ICRL-style'])
def test_a_learned_cost_grows_where_only_the_policy_is(name, expert, straight):
    torch = pytest.importorskip('torch', reason="needs the extra 'train'")
    # Threads wait for one another at every small layer.
    torch.set_num_threads(1)
    from experiments.inverse_learning import LEARNERS, Episodes

    learner = LEARNERS[name](Episodes(*expert), 0)
    policy = Episodes(*straight[:2])
    for _ in range(30):
        learner.improve(policy)
    forbidden = learner.cost(straight[0][straight[2]])
    allowed = learner.cost(expert[0])
    assert forbidden.mean() > 3 * allowed.mean()
    again = LEARNERS[name](Episodes(*expert), 1)
    again.restore(learner.state())
    np.testing.assert_array_equal(again.cost(straight[0]), learner.cost(straight[0]))
    for item in (learner, again):
        item.improve(policy)
    np.testing.assert_array_equal(again.cost(straight[0]), learner.cost(straight[0]))


def test_what_is_watched_is_counted_and_goes_on_where_it_was():
    def stream_of():
        world = WatchedWorld(make_world(WORLD, 3))
        world.reward = lambda before, action, after, reward: reward - after[:, 0]
        return world, EpisodeStream(world, seed=1)

    world, stream = stream_of()
    plain = EpisodeStream(make_world(WORLD, 3), seed=1)
    driver = driver_of(world, 'straight', np.random.default_rng(1))
    batch, other = stream.reset(), plain.reset()
    returns, costs, seen = np.zeros(3), np.zeros(3), []
    for step in range(120):
        action = driver(batch.observation)
        was_done = batch.done
        batch, other = stream.step(action), plain.step(action)
        returns += np.where(was_done, 0.0, other.reward)
        costs += np.where(was_done, 0.0, other.true_cost)
        np.testing.assert_allclose(
            batch.reward, np.where(was_done, 0.0, other.reward - other.observation[:, 0])
        )
        for row in np.flatnonzero(batch.done):
            seen.append((returns[row], costs[row]))
            returns[row] = costs[row] = 0.0
        if step == 60:
            state = stream.state()
    assert len(seen) > 3
    np.testing.assert_allclose(world.recent(), np.mean(seen, axis=0))
    again, restored = stream_of()
    batch = restored.restore(state)
    assert again.recent() is not None
    np.testing.assert_array_equal(
        again.state()['watched _totals'], state['world']['watched _totals']
    )
