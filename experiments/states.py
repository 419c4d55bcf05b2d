# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""States of simulated episodes as the learner sees them, without nodes and recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from occ_constraints_pkg.agents.drivers import DRIVERS, Driver, find_driver
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream

# More robots at once are hardly faster, and their states would fill the cache.
_AT_ONCE = 100


def heedless_driver_name(world: str) -> str:
    """Return the name of the driver of a world that ignores what must not be.

    That is a scripted one that goes straight to the goal or, where there is none, ``blind expert``:
    the expert with its hazard lidar covered up.
    """
    names = (name for name in ('straightv', 'straight') if name in DRIVERS[world])
    return next(names, 'blind expert')


def driver_of(world: World, name: str, rng: np.random.Generator) -> Driver:
    """Return a driver by its name, which may be ``blind expert``; see :func:`find_driver`.

    Policies sample their actions.
    """
    driver = find_driver(world, name.removeprefix('blind '), rng, explore=True)
    if name.startswith('blind '):
        return blinded(driver, [column.name for column in world.columns])
    return driver


def blinded(driver: Driver, names: Sequence[str]) -> Driver:
    """Return the driver with its hazard lidar covered up: it sees no hazard anywhere."""
    hidden = [place for place, name in enumerate(names) if name.startswith('hazards_lidar')]

    def drive(observation: np.ndarray) -> np.ndarray:
        seen = observation.copy()
        seen[:, hidden] = 0.0
        return driver(seen)

    return drive


def demonstrate(
    world: str, driver: str, episodes: int, *, seed: int, explore: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Let a driver demonstrate one episode with each of several robots.

    Args:
        world: name of the world, which is that of its feature map too.
        driver: a policy file, or the name of a driver.
        episodes: number of robots.
        seed: of world and driver.
        explore: sample the actions of a trained policy.

    Returns:
        (n, k) float32 features of every state in the order of time; (n,) int64, the episode of
        each.
    """
    simulated = make_world(world, episodes)
    drive = find_driver(simulated, driver, np.random.default_rng(seed), explore=explore)
    values, robots, _ = first_episodes(simulated, drive, load_feature_map(world), seed)
    simulated.close()
    return values, robots


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
