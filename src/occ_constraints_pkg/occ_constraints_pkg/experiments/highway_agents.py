# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The highway with a count of how episodes end, and with an engineered reward to compare with."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.worlds.highway import GOAL_DISTANCE, GOAL_REWARD, Highway
from occ_constraints_pkg.worlds.highway_features import NAMES

OUTCOMES = ('episodes', 'collision', 'off_road', 'goal', 'return')
"""What is counted: episodes, how many ended in which way, and the sum of their returns."""

# Coefficients of CommonRoad-RL's hybrid reward; see docs/driving.md. A metre towards the goal.
_CLOSER = 0.5
_TERMINAL = {'goal': 50.0, 'collision': -30.0, 'off_road': -50.0}
_TIME_OUT = -10.0
_SAFE_DISTANCE, _SAFE_DECAY, _SAFE_BRAKING, _SAFE_LEAST = -1.0, 5.0, 11.5, 4.0
# All of it is scaled so that the way to the goal counts as in the world's own reward.
_SCALE = GOAL_REWARD / (GOAL_DISTANCE * _CLOSER)

_V_X, _AHEAD = NAMES.index('v_x'), NAMES.index('p_rel4')
_AHEAD_RELATIVE = [column.name for column in Highway.columns].index('v_rel4')


class CountedHighway(Highway):
    """Counts finished episodes; with ``engineered`` the learner is given the hybrid reward.

    Attributes:
        totals: (5,) float64, see :data:`OUTCOMES`; returns are those of the world's own reward.

    Args:
        num_envs: number of robots.
        scenarios: how many scenarios there are to draw from.
        engineered: give the hybrid reward instead of the world's own.
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
        ended = [done & info[name] for name in ('collision', 'off_road', 'goal')]
        self.totals += [done.sum(), *(mask.sum() for mask in ended), self._returns[done].sum()]
        if self._engineered:
            reward = hybrid_reward(observation, reward, truncated, info)
        return observation, reward, terminated, truncated, info

    def start(self, rows: np.ndarray, numbers: list[int]) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in given scenarios; see :meth:`Highway.start`."""
        self._returns[rows], self._open[rows] = 0.0, True
        return super().start(rows, numbers)


def hybrid_reward(
    observation: np.ndarray, progress: np.ndarray, truncated: np.ndarray, info: dict[str, Any]
) -> np.ndarray:
    """Return CommonRoad-RL's hybrid reward, (N,) scaled to the world's own.

    The way gained, the end of the episode, and a penalty for following too closely. Terms of the
    goal's time, orientation and speed are paid at the goal only and are left out, as are those of
    a reference path, which a highway does not have.

    Args:
        observation: (N, k) states just reached.
        progress: (N,) the world's own reward.
        truncated: (N,) bool, time is up.
        info: what the world's step told.
    """
    speed, gap = observation[:, _V_X], observation[:, _AHEAD]
    ahead = speed + observation[:, _AHEAD_RELATIVE]
    wanted = np.maximum((speed**2 - ahead**2) / (2 * _SAFE_BRAKING), _SAFE_LEAST)
    close = np.where(gap < wanted, _SAFE_DISTANCE * np.exp(-_SAFE_DECAY * gap / wanted), 0.0)
    terminal = sum(value * info[name] for name, value in _TERMINAL.items())
    return progress + _SCALE * (terminal + _TIME_OUT * truncated + close)
