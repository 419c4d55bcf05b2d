# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.registry import WORLDS, make_world, world_class
from occ_constraints_pkg.worlds.simple_nav import SimpleNav
from occ_constraints_pkg.worlds.stream import EpisodeStream


def test_the_last_state_is_seen_and_a_fresh_one_follows():
    stream = EpisodeStream(SimpleNav(3), seed=0)
    batch = stream.reset()
    assert not batch.done.any()
    assert (batch.reward == 0).all()
    ends = 0
    for _ in range(200):
        last = batch
        batch = stream.step(np.ones((3, 2)) * [[1.0], [0.7], [0.0]])
        fresh = last.done
        ends += fresh.sum()
        assert (batch.episode == last.episode + fresh).all()
        assert (batch.reward[fresh] == 0).all()
        assert not batch.done[fresh].any()
        assert (np.abs(batch.observation[fresh] - 0.1) < 0.03).all()
        reached = np.linalg.norm(batch.observation - 0.9, axis=1) < 0.03
        np.testing.assert_array_equal(batch.terminated, reached)
        assert (batch.reward[reached] > 1).all()
    assert ends > 5
    # Robot 2 never moves: it is truncated after 150 steps and starts anew.
    assert batch.episode[2] == 1


@pytest.mark.parametrize('name', ['simple_nav', 'PointGoal1'])
def test_a_batch_handed_out_is_not_changed_later(name):
    if name != 'simple_nav':
        pytest.importorskip('mujoco')
    stream = EpisodeStream(make_world(name, 2), seed=0)
    batch = stream.reset()
    kept = batch.observation.copy(), batch.true_cost.copy()
    for _ in range(5):
        stream.step(np.ones((2, 2)))
    np.testing.assert_array_equal(batch.observation, kept[0])
    np.testing.assert_array_equal(batch.true_cost, kept[1])


@pytest.mark.parametrize('name', WORLDS)
def test_a_restored_stream_goes_on_exactly(name):
    if name != 'simple_nav':
        pytest.importorskip('mujoco')
    kind = world_class(name)
    stream = EpisodeStream(make_world(name, 3, processes=1), seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (kind.max_episode_steps + 60, 3, 2))
    begin = kind.max_episode_steps - 20
    for action in actions[:begin]:
        batch = stream.step(action)
    twin = EpisodeStream(make_world(name, 3, processes=2), seed=5)
    shown = twin.restore(stream.state())
    np.testing.assert_array_equal(shown.observation, batch.observation)
    for action in actions[begin:]:
        one, other = stream.step(action), twin.step(action)
        for field in dataclasses.fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
    assert (one.episode >= 1).all()
    twin.world.close()


def test_the_state_of_another_number_of_robots_is_refused():
    with pytest.raises(OccError, match='simple_nav has _rngs of shape'):
        EpisodeStream(SimpleNav(2), seed=0).restore(EpisodeStream(SimpleNav(3), seed=0).state())
