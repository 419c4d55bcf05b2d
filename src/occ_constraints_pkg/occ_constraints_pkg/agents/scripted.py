# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Scripted drivers: they give demonstrations and points of comparison without any training."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occ_constraints_pkg.errors import OccError

Driver = Callable[[np.ndarray], np.ndarray]
"""Takes an observation (N, k) and returns an action (N, a) within [-1, 1]."""

_NAV_GOAL = np.array([0.9, 0.9])
_NAV_STEP = 0.025
_LIDAR_BINS = 16
_POINT_COLUMNS = 12 + 3 * _LIDAR_BINS


def make_driver(world: str, name: str, rng: np.random.Generator) -> Driver:
    """Return a scripted driver.

    Args:
        world: name of the world that it drives in.
        name: ``random`` (uniform actions) in every world; ``straight`` (to the goal, whatever
            lies between) and ``expert`` (round the forbidden corner) in ``simple_nav``;
            ``straightv`` (to the goal, velocity compensated, through hazards) in ``PointGoal1``.
        rng: source of the driver's noise.

    Raises:
        OccError: there is no such world, or no such driver in it.
    """
    if world not in DRIVERS:
        raise OccError(
            f'there are no scripted drivers for world {world!r}; allowed are {", ".join(DRIVERS)}'
        )
    if name not in DRIVERS[world]:
        raise OccError(
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


class _PointStraightV:
    """Turns until its velocity will point at the goal, and thrusts while it nearly does.

    It reads the goal's bearing from the goal lidar and its own velocity from the velocimeter, and
    knows nothing of hazards.
    """

    _CRUISE = 1.0
    _WIDEST = np.pi / 4
    _CENTRES = (np.arange(_LIDAR_BINS) + 0.5) * (2 * np.pi / _LIDAR_BINS)

    def __init__(self, rng: np.random.Generator) -> None:
        """Take no noise from ``rng``: the driver is deterministic."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        observation = _checked(observation, _POINT_COLUMNS, 'PointGoal1')
        velocity = observation[:, 3:5]
        goal = _bearing(observation[:, 12:28])
        # A goal more than 3 m away is not seen; the hazards then tell where the middle is.
        hazards = observation[:, 28:44] @ np.exp(1j * self._CENTRES)
        goal = np.where(observation[:, 12:28].any(axis=1), goal, np.angle(hazards))
        wanted = self._CRUISE * np.column_stack([np.cos(goal), np.sin(goal)]) - velocity
        turn = np.arctan2(wanted[:, 1], wanted[:, 0])
        forward = (np.abs(turn) < self._WIDEST).astype(np.float64)
        return np.column_stack([forward, np.clip(turn, -1.0, 1.0)])


def _bearing(lidar: np.ndarray) -> np.ndarray:
    """Return the bearing, in rad, of the only object that a (N, 16) pseudo-lidar sees.

    The brightest bin holds it; the next bin's share of that brightness is how far into the
    brightest bin it lies.
    """
    rows = np.arange(len(lidar))
    brightest = lidar.argmax(axis=1)
    strength = lidar[rows, brightest]
    following = lidar[rows, (brightest + 1) % _LIDAR_BINS]
    share = np.divide(following, strength, out=np.zeros_like(strength), where=strength > 0)
    return (brightest + share) * (2 * np.pi / _LIDAR_BINS)


def _toward(goal: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the action that goes straight to ``goal`` as fast as it can without passing it."""
    offset = (goal - position) / _NAV_STEP
    return offset / np.maximum(1.0, np.abs(offset).max(axis=1, keepdims=True))


def _checked(observation: np.ndarray, columns: int, world: str) -> np.ndarray:
    values = np.asarray(observation, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != columns:
        raise OccError(
            f'a driver for {world} was given an observation of shape {values.shape}; '
            f'allowed is (N, {columns})'
        )
    return values


DRIVERS: dict[str, dict[str, Callable[[np.random.Generator], Driver]]] = {
    'simple_nav': {'random': _Random, 'straight': _NavStraight, 'expert': _NavExpert},
    'PointGoal1': {'random': _Random, 'straightv': _PointStraightV},
    'PointPush1': {'random': _Random},
    'CarGoal1': {'random': _Random},
    'CarPush1': {'random': _Random},
}
"""The drivers that :func:`make_driver` knows, by world and name."""
