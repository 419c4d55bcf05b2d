# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Planted problems from simulated worlds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from occ_constraints_pkg.agents.drivers import Driver, find_driver
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.simple_nav import FORBIDDEN_X_BELOW, FORBIDDEN_Y_ABOVE
from occ_constraints_pkg.worlds.stream import EpisodeStream

from experiments.planted_problems import (
    SIZES,
    TEST_STATES,
    Problem,
    generator,
)

_FRESH_EPISODES = 200
# Test states of simple_nav lie between start and goal, in x and in y: what is beyond is not
# forbidden but was never demonstrated.
_BETWEEN = 0.1, 0.9
# How the robot slows down: at these clearances in m to these speeds in m/s, with this gain; and by
# how much faster it would have to be to violate the rule.
_SLOWING = (0.6, 1.2), (0.25, 1.5)
_GAIN, _SLACK = 8.0, 0.1
_LIDAR_REACH = 3.0


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


def _slowed(drive: Driver, near: Sequence[int], forward: int) -> Driver:
    """Return a driver that thrusts no more than the clearance to the nearest hazard allows.

    Args:
        drive: who drives else.
        near: columns of the hazards' lidar.
        forward: column of the forward speed.
    """

    def slowed(observation: np.ndarray) -> np.ndarray:
        action = np.array(drive(observation), dtype=np.float64)
        clearance = _LIDAR_REACH * (1 - observation[:, near].max(axis=1))
        wanted = np.interp(clearance, *_SLOWING)
        braking = np.clip(_GAIN * (wanted - observation[:, forward]), -1.0, 1.0)
        action[:, 0] = np.minimum(action[:, 0], braking)
        return action

    return slowed


def clearance_in_point_goal(size: str, seed: int) -> Problem:
    """PointGoal1: the faster, the farther from hazards, in any direction."""
    samples, episodes = SIZES[size]
    rng = generator('B5', size, seed)
    feature_map = load_feature_map('PointGoal1')
    space = feature_map.space
    world = make_world('PointGoal1', 1)
    names = [column.name for column in world.columns]
    columns = [names.index(source.column) for source in feature_map.features]
    sensors = space.names.index('v_x'), list(space.families[0])

    def drives(count: int, *, slow: bool) -> tuple[np.ndarray, np.ndarray]:
        drive = find_driver(world, 'straightv', rng)
        if slow:
            near = [columns[member] for member in sensors[1]]
            drive = _slowed(drive, near, columns[sensors[0]])
        steps = samples // episodes
        rows = _first_steps('PointGoal1', drive, rng, count, steps)[..., columns]
        return rows.reshape(-1, len(columns)), np.repeat(np.arange(count), steps)

    values, of_episode = drives(episodes, slow=True)
    fresh, _ = drives(max(50, episodes // 2), slow=True)
    states, _ = drives(max(50, episodes // 2), slow=False)
    states = states[rng.integers(len(states), size=TEST_STATES)]
    clearance = _LIDAR_REACH * (1 - states[:, sensors[1]].max(axis=1))
    violated = states[:, sensors[0]] > np.interp(clearance, *_SLOWING) + _SLACK
    limits = np.stack([space.lows, space.highs], axis=1)
    return Problem(
        'B5', space.names, values, of_episode, fresh, states, violated, space.families, limits
    )


def _first_steps(
    name: str, drive: Driver, rng: np.random.Generator, count: int, steps: int
) -> np.ndarray:
    """Return the observations of the first steps of some robots: (count, steps, k)."""
    world = make_world(name, count)
    stream = EpisodeStream(world, seed=int(rng.integers(2**31)))
    batch = stream.reset()
    rows = [batch.observation.astype(np.float64)]
    for _ in range(steps - 1):
        batch = stream.step(drive(batch.observation))
        rows.append(batch.observation.astype(np.float64))
    world.close()
    return np.stack(rows, axis=1)


SIMULATED: dict[str, Callable[[str, int], Problem]] = {
    'A1': simple_nav,
    'B5': clearance_in_point_goal,
}
"""Problems by name: (size, seed) to the problem."""
