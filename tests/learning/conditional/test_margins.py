# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.learning.conditional.margins import outward_margin

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
