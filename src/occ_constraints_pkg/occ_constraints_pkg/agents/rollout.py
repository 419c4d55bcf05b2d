# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rollouts of a stream with next-step autoreset, and the estimates computed from them."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.worlds.stream import StepBatch


def checked_cost(
    batch: StepBatch, cost: np.ndarray, robots: int | None, columns: int
) -> np.ndarray:
    """Return the cost as (N,) float64 after checking the step.

    Args:
        batch: the states reached.
        cost: their cost.
        robots: the number of robots N; ``None`` for any.
        columns: number of columns of the observation.

    Raises:
        DataError: a shape is wrong or a number is not finite.
    """
    cost = np.asarray(cost, dtype=np.float64)
    shape = batch.observation.shape
    robots = shape[0] if robots is None else robots
    if shape != (robots, columns):
        raise DataError(
            f'the learner got an observation of shape {shape}; allowed is ({robots}, {columns})'
        )
    for name, values in (('cost', cost), ('reward', batch.reward)):
        if values.shape != (robots,) or not np.isfinite(values).all():
            raise DataError(
                f'the learner got a {name} of shape {values.shape} with '
                f'{np.count_nonzero(~np.isfinite(values))} values missing or infinite; '
                f'allowed is ({robots},), all finite'
            )
    if not np.isfinite(batch.observation).all():
        raise DataError('the learner got an observation that is not finite; allowed is finite')
    return cost


def advantages(
    signal: np.ndarray,
    values: np.ndarray,
    terminated: np.ndarray,
    valid: np.ndarray,
    gamma: float,
    lam: float,
) -> np.ndarray:
    """Generalised advantage estimates over a rollout of a stream with next-step autoreset.

    Transition t leads from state t to state t + 1. One that starts at the last state of an episode
    is not valid: its estimate is 0, which also ends the backward sum. A truncated episode is thus
    bootstrapped with the value of its last state, and a terminated one with 0.

    Args:
        signal: (T, N) reward or cost of each transition.
        values: (T + 1, N) the critic's value of each state.
        terminated: (T, N) bool, the transition ended the task.
        valid: (T, N) bool, the transition happened.
        gamma: discount per step.
        lam: weight of longer returns, 0 to 1.

    Returns:
        (T, N), same type as ``values``.
    """
    delta = signal + gamma * np.where(terminated, 0, values[1:]) - values[:-1]
    estimate = np.zeros_like(values)
    for t in range(len(signal) - 1, -1, -1):
        estimate[t] = valid[t] * (delta[t] + gamma * lam * estimate[t + 1])
    return estimate[:-1]


class Rollout:
    """T transitions of N robots, and the T + 1 states between them.

    Attributes:
        filled: transitions completed so far.
        observation: (T + 1, N, k) float32.
        action: (T, N, a) float32, taken in the state of the same index.
        reward: (T, N) float32, of the transition.
        cost: (T, N) float32, of the state it led to.
        terminated: (T, N) bool, it ended the task.
        valid: (T, N) bool, it happened: see :func:`advantages`.
    """

    def __init__(self, steps: int, robots: int, k: int, a: int) -> None:
        self.filled = 0
        self.observation = np.zeros((steps + 1, robots, k), np.float32)
        self.action = np.zeros((steps, robots, a), np.float32)
        self.reward = np.zeros((steps, robots), np.float32)
        self.cost = np.zeros((steps, robots), np.float32)
        self.terminated = np.zeros((steps, robots), bool)
        self.valid = np.zeros((steps, robots), bool)

    def state(self, rows: int) -> dict[str, Any]:
        """Return everything needed to continue, not copied; only the first rows are in use."""
        return {
            name: value if name == 'filled' else value[:rows] for name, value in vars(self).items()
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue where a rollout of the same size was when it returned ``state``."""
        for name, value in vars(self).items():
            if name != 'filled':
                value[: len(state[name])] = state[name]
        self.filled = state['filled']


class Episodes:
    """Sums of the running episode of each robot, and the sums of the last finished ones.

    Attributes:
        finished: episodes finished.
        recent: return, cost and length of the last ``window`` of them.
        sums: (N, 3) the same of each running episode.
        whole: (N,) bool, the running episode was seen from its first state. Others are not counted
            when they finish, as their sums are incomplete.
    """

    def __init__(self, robots: int, window: int) -> None:
        self.finished = 0
        self.recent: deque[tuple[float, float, float]] = deque(maxlen=window)
        self.sums = np.zeros((robots, 3))
        self.whole = np.ones(robots, bool)

    def add(
        self, reward: np.ndarray, cost: np.ndarray, valid: np.ndarray, done: np.ndarray
    ) -> None:
        """Count one transition of each robot; all arguments are (N,)."""
        self.sums[valid] += np.stack([reward, cost, np.ones_like(reward)], axis=1)[valid]
        ended = valid & done
        if ended.any():
            self.recent.extend(map(tuple, self.sums[ended & self.whole].tolist()))
            self.finished += int((ended & self.whole).sum())
            self.sums[ended] = 0.0
            self.whole |= ended

    def state(self) -> dict[str, Any]:
        """Return everything needed to continue, not copied."""
        return vars(self) | {'recent': [list(sums) for sums in self.recent]}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue where the episodes were when they returned ``state``."""
        self.recent.extend(map(tuple, state['recent']))
        self.finished, self.sums, self.whole = state['finished'], state['sums'], state['whole']

    def means(self) -> tuple[float, float, float]:
        """Return the recent ones' mean return, cost and length; NaN while none has finished."""
        if not self.recent:
            return math.nan, math.nan, math.nan
        return tuple(np.mean(self.recent, axis=0).tolist())


class Normaliser:
    """Mean and variance of all observations so far (Chan, Golub and LeVeque 1979).

    Attributes:
        count: rows seen.
        mean: (k,) float64.
        variance: (k,) float64; 1 while no row has been seen.
    """

    def __init__(self, k: int) -> None:
        self.count = 0.0
        self.mean = np.zeros(k)
        self.variance = np.ones(k)

    def fold(self, rows: np.ndarray) -> None:
        """Add rows, (..., k)."""
        rows = rows.reshape(-1, rows.shape[-1]).astype(np.float64)
        n, mean, variance = len(rows), rows.mean(axis=0), rows.var(axis=0)
        total, shift = self.count + n, mean - self.mean
        self.variance = (
            self.variance * self.count + variance * n + shift**2 * (self.count * n / total)
        ) / total
        self.mean = self.mean + shift * (n / total)
        self.count = total

    @property
    def floored_variance(self) -> np.ndarray:
        """(k,) the variance, at least 1e-4.

        Otherwise the first small change of an almost constant sensor would be scaled to the clip
        bound.
        """
        return np.maximum(self.variance, 1e-4)
