# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.learning.conditional.margins import is_noise, outward_margin

EPISODES = np.repeat(np.arange(50), 100)
SHARE = 0.001


def test_levels_of_their_own_need_a_margin_and_a_common_edge_needs_none():
    rng = np.random.default_rng(0)
    level = np.repeat(rng.normal(size=50), 100) + rng.normal(0, 0.01, 5_000)
    assert outward_margin(level, EPISODES, SHARE) > 0.2
    assert outward_margin(-level, EPISODES, SHARE) > 0.2
    edge = np.minimum(rng.normal(size=5_000), 0.5)
    assert outward_margin(edge, EPISODES, SHARE) == 0


def test_fresh_episodes_hardly_go_beyond():
    rng = np.random.default_rng(1)

    def draw():
        return np.repeat(rng.normal(size=50), 100) + rng.normal(0, 0.1, 5_000)

    beyond = []
    for _ in range(40):
        values = draw()
        highest = values.max() + outward_margin(values, EPISODES, SHARE)
        beyond.append((draw() > highest).mean())
    assert np.mean(beyond) < 5 * SHARE
    assert np.median(beyond) == 0


def test_a_smaller_share_takes_a_wider_margin():
    level = np.repeat(np.random.default_rng(0).normal(size=50), 100)
    margins = [outward_margin(level, EPISODES, share) for share in (0.01, 0.001, 0.0001)]
    assert margins == sorted(margins)
    assert margins[0] < margins[2]


def test_few_episodes_say_too_little():
    rng = np.random.default_rng(0)
    levels = rng.normal(size=10)
    assert outward_margin(np.repeat(levels[:9], 100), np.repeat(np.arange(9), 100), SHARE) == 0
    assert outward_margin(np.repeat(levels, 100), np.repeat(np.arange(10), 100), SHARE) > 0


def test_where_many_episodes_come_to_the_end_the_bound_stays_there():
    # Speeds of cars in stop-and-go traffic: each stands at times, some never.
    rng = np.random.default_rng(0)
    slowest = np.maximum(rng.normal(2, 3, 50), 0)
    speed = (slowest[:, None] + rng.exponential(4, (50, 100))).ravel()
    speed[::100] = slowest
    assert outward_margin(-speed, EPISODES, SHARE) == 0


def test_hardly_any_fresh_episode_comes_beyond_however_short_its_stay():
    rng = np.random.default_rng(0)
    share = 0.01

    def draw():
        values = rng.normal(0, 0.05, (50, 100))
        # Each has its speed, and reaches it once.
        values[:, 40] += rng.gumbel(6, 0.3, 50)
        return values.ravel()

    came = []
    for _ in range(40):
        values = draw()
        highest = values.max() + outward_margin(values, EPISODES, share)
        came.append((draw().reshape(50, 100) > highest).any(axis=1).mean())
    assert np.mean(came) < 1.5 * share


def test_one_episode_that_went_far_does_not_move_the_bound_far():
    rng = np.random.default_rng(0)
    speed = rng.uniform(0, 1, (50, 100)) * rng.uniform(10, 17, (50, 1))
    speed[7] *= 27 / speed[7].max()
    assert outward_margin(speed.ravel(), EPISODES, SHARE) <= 2.7


def test_noise_is_told_from_what_lasts():
    rng = np.random.default_rng(0)
    goes_on = np.diff(EPISODES, append=-1) == 0
    noise = rng.normal(size=5_000)
    lasting = np.convolve(noise, np.ones(5), mode='same')
    assert is_noise(noise, goes_on)
    assert not is_noise(lasting, goes_on)
    assert not is_noise(noise, np.zeros(5_000, dtype=bool))
