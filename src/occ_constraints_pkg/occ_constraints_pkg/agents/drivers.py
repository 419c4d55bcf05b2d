# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Drivers by name: trained policy files, shipped experts, scripted drivers."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from importlib.resources.abc import Traversable

import numpy as np

from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.safety_gym_drivers import avoider, straight_car, straight_point
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import check_world
from occ_constraints_pkg.worlds.simple_nav import GOAL, STEP_LENGTH

Driver = Callable[[np.ndarray], np.ndarray]
"""Takes an observation (N, k) and returns an action (N, a) within [-1, 1]."""


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
        action = _toward(GOAL, position)
        return np.clip(action + self._rng.normal(0.0, 0.03, action.shape), -1.0, 1.0)


class _NavExpert:
    """Goes along the bottom, then up the right side, and never enters the forbidden region.

    It takes another lane in each episode, so that several episodes cover the width of the safe
    region. It accelerates along the bottom, so there are fewest samples just before the turn. A
    jump in position counts as the start of a new episode.
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
        gain = 0.3 / STEP_LENGTH
        right = x < lane_x - STEP_LENGTH
        action = np.where(
            right[:, None],
            np.column_stack([self._SLOWEST + self._PICK_UP * x, gain * (lane_y - y)]),
            np.column_stack([gain * (lane_x - x), np.ones_like(y)]),
        )
        action = np.clip(action, -1.0, 1.0) + self._rng.normal(0.0, 0.15, action.shape)
        arriving = y > GOAL[1] - 0.1
        action[arriving] = _toward(GOAL, position[arriving])
        return np.clip(self._kept_clear(position, action), -1.0, 1.0)

    def _choose_lanes(self, position: np.ndarray) -> None:
        if self._last is None or len(self._last) != len(position):
            new = np.ones(len(position), dtype=bool)
            self._lane = np.empty((len(position), 2))
        else:
            new = np.abs(position - self._last).max(axis=1) > 3 * STEP_LENGTH
        low, high = np.transpose([self._LANES_X, self._LANES_Y])
        self._lane[new] = self._rng.uniform(low, high, (int(new.sum()), 2))
        self._last = position

    def _kept_clear(self, position: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Clip moves that would leave the safe region."""
        x, y = position.T
        along_bottom = (x < self._LOWEST_X) & (y <= self._HIGHEST_Y)
        going_up = (x >= self._LOWEST_X) & (y > self._HIGHEST_Y)
        rise = np.where(along_bottom, (self._HIGHEST_Y - y) / STEP_LENGTH, np.inf)
        back = np.where(going_up, (self._LOWEST_X - x) / STEP_LENGTH, -np.inf)
        return np.column_stack([np.maximum(action[:, 0], back), np.minimum(action[:, 1], rise)])


def _toward(goal: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the action that goes straight to ``goal`` as fast as it can without passing it."""
    offset = (goal - position) / STEP_LENGTH
    return offset / np.maximum(1.0, np.abs(offset).max(axis=1, keepdims=True))


def _checked(observation: np.ndarray, columns: int, world: str) -> np.ndarray:
    values = np.asarray(observation, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != columns:
        raise ConfigurationError(
            f'a driver for {world} was given an observation of shape {values.shape}; '
            f'allowed is (N, {columns})'
        )
    return values


DRIVERS: dict[str, dict[str, Callable[[np.random.Generator], Driver]]] = {
    'simple_nav': {'random': _Random, 'straight': _NavStraight, 'expert': _NavExpert},
    'PointGoal1': {
        'random': _Random,
        'straightv': lambda _: straight_point('PointGoal1'),
        'avoider': lambda _: avoider('PointGoal1'),
    },
    'CarGoal1': {
        'random': _Random,
        'straight': lambda _: straight_car('CarGoal1'),
        'avoider': lambda _: avoider('CarGoal1'),
    },
    'PointPush1': {
        'random': _Random,
        'avoider': lambda _: avoider('PointPush1'),
        'expert': lambda _: avoider('PointPush1'),
    },
    'CarPush1': {
        'random': _Random,
        'avoider': lambda _: avoider('CarPush1'),
        'expert': lambda _: avoider('CarPush1'),
    },
    'highway': {'random': _Random},
    'highway_restricted': {'random': _Random},
}
"""The scripted drivers by world and name; each is made from the generator of its noise.

``random`` acts uniformly. In ``simple_nav``, ``straight`` heads for the goal and ``expert`` goes
round the forbidden corner. ``straightv`` (Point) and ``straight`` (Car) head for the goal through
hazards; ``avoider`` keeps out of them, and is the ``expert`` of the Push tasks.
"""


_EXPERTS = resources.files(__package__).joinpath('experts')
# Worlds that differ from another one in nothing but their scenarios share its expert.
_EXPERT_OF = {'highway_restricted': 'highway'}


def check_name(name: str) -> None:
    """Refuse a name that is neither a policy file nor a driver of any world.

    Raises:
        ConfigurationError: no driver of any world has that name.
    """
    names = sorted({'expert'}.union(*DRIVERS.values()))
    if not name.endswith('.npz') and name not in names:
        raise ConfigurationError(
            f'there is no driver {name!r}{did_you_mean(name, names) or ";"} allowed are '
            f'{", ".join(names)}, as far as the world has them, and a policy file (.npz)'
        )


def find_driver(
    world: type[World] | World, name: str, rng: np.random.Generator, *, explore: bool = False
) -> Driver:
    """Return a driver for ``world``.

    Args:
        world: the world that it drives in, or its class.
        name: a policy file (``.npz``); ``expert`` for the trained expert that is shipped for some
            worlds; else a scripted driver of that name.
        rng: source of the driver's random choices.
        explore: sample the actions of a trained policy instead of taking their mean.

    Raises:
        ConfigurationError: there is no such driver, or the policy belongs to another world.
    """
    check_driver(world.name, name)
    shipped = _expert_file(world.name)
    if name.endswith('.npz'):
        policy = GaussianPolicy.load(name)
    elif name == 'expert' and shipped.is_file():
        with resources.as_file(shipped) as path:
            policy = GaussianPolicy.load(path)
    else:
        return DRIVERS[world.name][name](rng)
    policy.check_world(world.columns, world.action_columns)
    return lambda observation: policy.act(observation, rng if explore else None)


def check_driver(world: str, name: str) -> None:
    """Refuse a name that is neither a driver of the world nor a policy file.

    Raises:
        ConfigurationError: there is no such driver or no such world.
    """
    check_world(world)
    names = list(DRIVERS[world])
    if 'expert' not in names and _expert_file(world).is_file():
        names.append('expert')
    if not (name.endswith('.npz') or name in names):
        hint = did_you_mean(name, names) or ';'
        raise ConfigurationError(
            f'world {world} has no driver {name!r}{hint} allowed are {", ".join(names)} and a '
            'policy file (.npz)'
        )


def _expert_file(world: str) -> Traversable:
    return _EXPERTS.joinpath(f'{_EXPERT_OF.get(world, world)}.npz')
