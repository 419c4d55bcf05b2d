# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""States of simulated episodes as the learner sees them, without nodes and recordings."""

from __future__ import annotations

import numpy as np
from occ_constraints_pkg.agents.drivers import Driver
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream

# More robots at once are hardly faster, and their states would fill the cache.
_AT_ONCE = 100


def drive_states(
    name: str, driver: Driver, feature_map: FeatureMap, episodes: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Let a driver drive whole episodes.

    Args:
        name: the world.
        driver: drives all robots.
        feature_map: the features, all of them columns of the world's observation.
        episodes: number of episodes.
        seed: of the world.

    Returns:
        (episodes, steps + 1, k) float32 features of every state, and (episodes, steps + 1) bool,
        whether the state is truly costly. Episodes must all have the same length, which those of
        the Safety-Gym tasks have.
    """
    values, costly = [], []
    for start in range(0, episodes, _AT_ONCE):
        count = min(_AT_ONCE, episodes - start)
        world = make_world(name, count)
        states, robots, costs = first_episodes(world, driver, feature_map, seed + start)
        by_robot = np.argsort(robots, kind='stable')
        values.append(states[by_robot].reshape(count, -1, states.shape[1]))
        costly.append(costs[by_robot].reshape(count, -1))
        world.close()
    return np.concatenate(values), np.concatenate(costly)


def first_episodes(
    world: World, driver: Driver, feature_map: FeatureMap, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Let a driver drive until the first episode of every robot is over.

    Args:
        world: the world, with any number of robots.
        driver: drives all robots.
        feature_map: the features, all of them columns of the world's observation.
        seed: of the world.

    Returns:
        (n, k) float32 features of every state, first and last ones included, in the order of
        time; (n,) int64, the robot of each; (n,) bool, whether the state is truly costly.
    """
    names = [column.name for column in world.columns]
    places = [names.index(source.column) for source in feature_map.features]
    stream = EpisodeStream(world, seed=seed)
    batch, states, robots, costs = stream.reset(), [], [], []
    while (batch.episode == 0).any():
        first = np.flatnonzero(batch.episode == 0)
        states.append(batch.observation[first][:, places])
        robots.append(first)
        costs.append(batch.true_cost[first] > 0)
        batch = stream.step(driver(batch.observation))
    return np.concatenate(states), np.concatenate(robots), np.concatenate(costs)
