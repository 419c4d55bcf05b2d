# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A point in the unit square that must avoid a forbidden corner: the 2-D example of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.worlds.base import Column, World
from occ_constraints_pkg.worlds.robots import checked_action, robot_generators, selected_rows

_START = np.array([0.1, 0.1])
GOAL = np.array([0.9, 0.9])
_GOAL_RADIUS = 0.03
_GOAL_BONUS = 1.0
# Each axis moves by at most this much in a step, so a step is at most 0.035 long.
STEP_LENGTH = 0.025
FORBIDDEN_X_BELOW = 0.7
FORBIDDEN_Y_ABOVE = 0.3
_START_JITTER = 0.01


class SimpleNav(World):
    """Go from (0.1, 0.1) to (0.9, 0.9) and keep out of the upper left part of the square.

    The state is the observation: x and y in [0, 1]. An action moves the robot by up to
    :data:`STEP_LENGTH` along each axis. The reward is the decrease of the distance to the goal,
    plus 1 on reaching it, which ends the episode. The true cost is 1 where x < 0.7 and y > 0.3:
    the region that the two boxes of the paper's example (section 3, simple navigation) leave out
    and that its pruned rule describes. The straight way to the goal crosses it.
    """

    name = 'simple_nav'
    columns = (Column('x', low=0.0, high=1.0), Column('y', low=0.0, high=1.0))
    action_columns = (Column('d_x', low=-1.0, high=1.0), Column('d_y', low=-1.0, high=1.0))
    step_seconds = 0.1
    max_episode_steps = 150
    state_names = ('_rngs', '_position', '_steps')

    def __init__(self, num_envs: int, *, processes: int = 0) -> None:
        self.num_envs = num_envs
        self._rngs = robot_generators(None, num_envs)
        self._position = np.tile(_START, (num_envs, 1))
        self._steps = np.zeros(num_envs, dtype=np.int64)

    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes; see :meth:`World.reset`."""
        rows = selected_rows(mask, self.num_envs)
        if seed is not None:
            self._rngs = robot_generators(seed, self.num_envs)
        for row in rows:
            self._position[row] = _START + self._rngs[row].uniform(-_START_JITTER, _START_JITTER, 2)
        self._steps[rows] = 0
        return self._position.astype(np.float32), {'true_cost': self._cost()}

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step; see :meth:`World.step`."""
        move = checked_action(action, self.num_envs, ('d_x', 'd_y'))
        before = np.linalg.norm(self._position - GOAL, axis=1)
        self._position = np.clip(self._position + STEP_LENGTH * move, 0.0, 1.0)
        self._steps += 1
        distance = np.linalg.norm(self._position - GOAL, axis=1)
        terminated = distance <= _GOAL_RADIUS
        reward = before - distance + _GOAL_BONUS * terminated
        truncated = ~terminated & (self._steps >= self.max_episode_steps)
        info = {'true_cost': self._cost()}
        return self._position.astype(np.float32), reward, terminated, truncated, info

    def _cost(self) -> np.ndarray:
        x, y = self._position.T
        return ((x < FORBIDDEN_X_BELOW) & (y > FORBIDDEN_Y_ABOVE)).astype(np.float64)
