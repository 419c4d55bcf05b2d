# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Scripted drivers: they give demonstrations and points of comparison without any training."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occ_constraints_pkg.agents.safety_gym_drivers import avoider, straight_car, straight_point
from occ_constraints_pkg.errors import ConfigurationError

Driver = Callable[[np.ndarray], np.ndarray]
"""Takes an observation (N, k) and returns an action (N, a) within [-1, 1]."""

_NAV_GOAL = np.array([0.9, 0.9])
_NAV_STEP = 0.025


def make_driver(world: str, name: str, rng: np.random.Generator) -> Driver:
    """Return a scripted driver.

    Args:
        world: name of the world that it drives in.
        name: ``random`` (uniform actions) in every world; ``straight`` (to the goal, whatever
            lies between) and ``expert`` (round the forbidden corner) in ``simple_nav``. In
            ``PointGoal1`` ``straightv`` and in ``CarGoal1`` ``straight`` (to the goal, through
            hazards). ``avoider`` in the Safety-Gym tasks keeps out of hazards; in Push it is the
            ``expert`` too.
        rng: source of the driver's noise.

    Raises:
        OccError: there is no such world, or no such driver in it.
    """
    if world not in DRIVERS:
        raise ConfigurationError(
            f'there are no scripted drivers for world {world!r}; allowed are {", ".join(DRIVERS)}'
        )
    if name not in DRIVERS[world]:
        raise ConfigurationError(
            f'world {world} has no scripted driver {name!r}; '
            f'allowed are {", ".join(DRIVERS[world])}'
        )
    return DRIVERS[world][name](rng)


class _Random:
    """Uniform actions."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        return self._rng.uniform(-1.0, 1.0, (len(observation), 2))


class _NavStraight:
    """Heads straight for the goal at full speed, with a little noise."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        position = _checked(observation, 2, 'simple_nav')
        action = _toward(_NAV_GOAL, position)
        return np.clip(action + self._rng.normal(0.0, 0.03, action.shape), -1.0, 1.0)


class _NavExpert:
    """Goes along the bottom, then up the right side, and never enters the forbidden region.

    In each episode it keeps to a lane of its own, so that several episodes together show the
    width of the safe region. It gathers speed along the bottom, so it is seen least often just
    before the turn. A position that jumps is taken for the start of a new episode.
    """

    # Lanes lie at this y along the bottom and at this x up the right side.
    _LANES_Y = (0.11, 0.285)
    _LANES_X = (0.75, 0.89)
    # The corner of the forbidden region is (0.7, 0.3); the driver keeps this clear of it.
    _LOWEST_X, _HIGHEST_Y = 0.705, 0.295
    # Speed along the bottom as a share of the highest: at x = 0, and its growth per x.
    _SLOWEST, _PICK_UP = 0.05, 1.35

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._last: np.ndarray | None = None
        self._lane = np.empty((0, 2))

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        position = _checked(observation, 2, 'simple_nav')
        self._choose_lanes(position)
        x, y = position.T
        lane_x, lane_y = self._lane.T
        gain = 0.3 / _NAV_STEP
        right = x < lane_x - _NAV_STEP
        action = np.where(
            right[:, None],
            np.column_stack([self._SLOWEST + self._PICK_UP * x, gain * (lane_y - y)]),
            np.column_stack([gain * (lane_x - x), np.ones_like(y)]),
        )
        action = np.clip(action, -1.0, 1.0) + self._rng.normal(0.0, 0.15, action.shape)
        arriving = y > _NAV_GOAL[1] - 0.1
        action[arriving] = _toward(_NAV_GOAL, position[arriving])
        return np.clip(self._kept_clear(position, action), -1.0, 1.0)

    def _choose_lanes(self, position: np.ndarray) -> None:
        if self._last is None or len(self._last) != len(position):
            new = np.ones(len(position), dtype=bool)
            self._lane = np.empty((len(position), 2))
        else:
            new = np.abs(position - self._last).max(axis=1) > 3 * _NAV_STEP
        low, high = np.transpose([self._LANES_X, self._LANES_Y])
        self._lane[new] = self._rng.uniform(low, high, (int(new.sum()), 2))
        self._last = position

    def _kept_clear(self, position: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Stop whatever part of a move would end beyond the lines that bound the safe region."""
        x, y = position.T
        along_bottom = (x < self._LOWEST_X) & (y <= self._HIGHEST_Y)
        going_up = (x >= self._LOWEST_X) & (y > self._HIGHEST_Y)
        rise = np.where(along_bottom, (self._HIGHEST_Y - y) / _NAV_STEP, np.inf)
        back = np.where(going_up, (self._LOWEST_X - x) / _NAV_STEP, -np.inf)
        return np.column_stack([np.maximum(action[:, 0], back), np.minimum(action[:, 1], rise)])


def _toward(goal: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the action that goes straight to ``goal`` as fast as it can without passing it."""
    offset = (goal - position) / _NAV_STEP
    return offset / np.maximum(1.0, np.abs(offset).max(axis=1, keepdims=True))


def _checked(observation: np.ndarray, columns: int, world: str) -> np.ndarray:
    values = np.asarray(observation, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != columns:
        raise ConfigurationError(
            f'a driver for {world} was given an observation of shape {values.shape}; '
            f'allowed is (N, {columns})'
        )
    return values


def _deterministic(
    make: Callable[[str], Driver], world: str
) -> Callable[[np.random.Generator], Driver]:
    """Let a driver that takes no noise be made as the others are."""
    return lambda rng: make(world)


DRIVERS: dict[str, dict[str, Callable[[np.random.Generator], Driver]]] = {
    'simple_nav': {'random': _Random, 'straight': _NavStraight, 'expert': _NavExpert},
    'PointGoal1': {
        'random': _Random,
        'straightv': _deterministic(straight_point, 'PointGoal1'),
        'avoider': _deterministic(avoider, 'PointGoal1'),
    },
    'CarGoal1': {
        'random': _Random,
        'straight': _deterministic(straight_car, 'CarGoal1'),
        'avoider': _deterministic(avoider, 'CarGoal1'),
    },
    'PointPush1': {
        'random': _Random,
        'avoider': _deterministic(avoider, 'PointPush1'),
        'expert': _deterministic(avoider, 'PointPush1'),
    },
    'CarPush1': {
        'random': _Random,
        'avoider': _deterministic(avoider, 'CarPush1'),
        'expert': _deterministic(avoider, 'CarPush1'),
    },
    'highway': {'random': _Random},
    'highway_restricted': {'random': _Random},
}
"""The drivers that :func:`make_driver` knows, by world and name."""
