# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""States of simulated drives as the learner sees them, without nodes and recordings."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.agents.scripted import Driver
from occ_constraints_pkg.bags.feature_map import FeatureMap
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
        world = make_world(name, min(_AT_ONCE, episodes - start))
        names = [column.name for column in world.columns]
        places = [names.index(source.column) for source in feature_map.features]
        stream = EpisodeStream(world, seed=seed + start)
        batch, states, costs = stream.reset(), [], []
        for _ in range(world.max_episode_steps + 1):
            states.append(batch.observation[:, places])
            costs.append(batch.true_cost > 0)
            batch = stream.step(driver(batch.observation))
        world.close()
        values.append(np.stack(states, axis=1))
        costly.append(np.stack(costs, axis=1))
    return np.concatenate(values), np.concatenate(costly)
