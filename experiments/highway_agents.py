# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The highway with a count of how episodes end, and with an engineered reward to compare with."""

from __future__ import annotations

from typing import Any

import numpy as np
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.highway import Highway
from occ_constraints_pkg.worlds.highway_features import NAMES
from occ_constraints_pkg.worlds.stream import StepBatch

OUTCOMES = ('episodes', 'collision', 'off_road', 'return')
"""What is counted: episodes, how many ended in which way, and the sum of their returns."""

# Coefficients of CommonRoad-RL's hybrid reward; see docs/driving.md.
_TERMINAL = {'collision': -30.0, 'off_road': -50.0}
_SAFE_DISTANCE, _SAFE_DECAY, _SAFE_BRAKING, _SAFE_LEAST = -1.0, 5.0, 11.5, 4.0

_V_X, _AHEAD = NAMES.index('v_x'), NAMES.index('p_rel4')
_AHEAD_RELATIVE = [column.name for column in Highway.columns].index('v_rel4')


class CountedHighway(Highway):
    """Counts finished episodes; with ``engineered`` the learner is given a safer reward.

    Attributes:
        totals: (4,) float64, see :data:`OUTCOMES`; returns are those of the world's own reward.

    Args:
        num_envs: number of robots.
        scenarios: how many scenarios there are to draw from.
        engineered: add :func:`safety_reward` to the world's own.
    """

    state_names = (*Highway.state_names, 'totals', '_returns', '_open')

    def __init__(self, num_envs: int, *, scenarios: int, engineered: bool = False) -> None:
        super().__init__(num_envs)
        self.scenarios = scenarios
        self.totals = np.zeros(len(OUTCOMES))
        self._returns = np.zeros(num_envs)
        self._open = np.zeros(num_envs, dtype=bool)
        self._engineered = engineered

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step; see :meth:`World.step`."""
        observation, reward, terminated, truncated, info = super().step(action)
        # A stream steps robots once more after their last state, for nothing.
        self._returns += reward
        done = (terminated | truncated) & self._open
        self._open &= ~done
        collided, left = done & info['collision'], done & info['off_road']
        self.totals += [done.sum(), collided.sum(), left.sum(), self._returns[done].sum()]
        if self._engineered:
            reward = reward + safety_reward(observation, info)
        return observation, reward, terminated, truncated, info

    def start(self, rows: np.ndarray, numbers: list[int]) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in given scenarios; see :meth:`Highway.start`."""
        self._returns[rows], self._open[rows] = 0.0, True
        return super().start(rows, numbers)


class LastingRuleCost(RuleCost):
    """Costs from rules; an episode that ends in a violation counts as violated to the end of time.

    A collision ends an episode. Were only the states before it counted, the surest way to few
    violations would be an early one.

    Args:
        constraints: the rules.
        world: the world whose steps are judged; it tells how much time was left.
    """

    def __init__(self, constraints: Constraints, world: Highway) -> None:
        super().__init__(constraints, world)
        self._world = world

    def __call__(self, batch: StepBatch) -> np.ndarray:
        """Return (N,) 1.0 where a state is not SAFE, and as many more as steps have been lost."""
        cost = super().__call__(batch)
        return cost * np.where(batch.terminated, 1.0 + self._world.steps_left, 1.0)


def safety_reward(observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
    """Return the part of CommonRoad-RL's hybrid reward that is about safety, (N,).

    Penalties for a collision, for leaving the road and for following too closely: below the
    distance that braking to the speed of the car ahead takes, exponentially.

    Args:
        observation: (N, k) states just reached.
        info: of the world's step.
    """
    speed, gap = observation[:, _V_X], observation[:, _AHEAD]
    ahead = speed + observation[:, _AHEAD_RELATIVE]
    wanted = np.maximum((speed**2 - ahead**2) / (2 * _SAFE_BRAKING), _SAFE_LEAST)
    close = np.where(gap < wanted, _SAFE_DISTANCE * np.exp(-_SAFE_DECAY * gap / wanted), 0.0)
    return close + sum(value * info[name] for name, value in _TERMINAL.items())
