# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Planted problems from simulated worlds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.experiments.planted_problems import (
    SIZES,
    TEST_STATES,
    Problem,
    generator,
)
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.simple_nav import FORBIDDEN_X_BELOW, FORBIDDEN_Y_ABOVE
from occ_constraints_pkg.worlds.stream import EpisodeStream

_FRESH_EPISODES = 200
# Test states of simple_nav lie between start and goal, in x and in y: what is beyond is not
# forbidden but was never demonstrated.
_BETWEEN = 0.1, 0.9


def _episodes(
    name: str, driver: str, rng: np.random.Generator, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (n, k) observations of whole episodes, one after the other, and (n,) theirs."""
    world = make_world(name, count)
    drive = find_driver(world, driver, rng)
    stream = EpisodeStream(world, seed=int(rng.integers(2**31)))
    batch, rows, robots = stream.reset(), [], []
    while (batch.episode == 0).any():
        first = np.flatnonzero(batch.episode == 0)
        rows.append(batch.observation[first].astype(np.float64))
        robots.append(first)
        batch = stream.step(drive(batch.observation))
    world.close()
    values, of_robot = np.concatenate(rows), np.concatenate(robots)
    order = np.argsort(of_robot, kind='stable')
    return values[order], of_robot[order]


def simple_nav(size: str, seed: int) -> Problem:
    """The forbidden corner of the unit square that the paper's expert goes round."""
    samples, _ = SIZES[size]
    rng = generator('A1', size, seed)
    steps = len(_episodes('simple_nav', 'expert', generator('A1'), 10)[0]) // 10
    values, episodes = _episodes('simple_nav', 'expert', rng, -(-samples // steps))
    fresh, _ = _episodes('simple_nav', 'expert', rng, _FRESH_EPISODES)
    states = rng.uniform(*_BETWEEN, size=(TEST_STATES, 2))
    violated = (states[:, 0] < FORBIDDEN_X_BELOW) & (states[:, 1] > FORBIDDEN_Y_ABOVE)
    limits = np.array([[0.0, 1.0], [0.0, 1.0]])
    return Problem('A1', ('x', 'y'), values, episodes, fresh, states, violated, (), limits)


SIMULATED: dict[str, Callable[[str, int], Problem]] = {'A1': simple_nav}
"""Problems by name: (size, seed) to the problem."""
