# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A world whose true returns and costs are counted, whatever the learner is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.robots import selected_rows

_WINDOW = 100

Reward = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Maps states before (N, k), actions (N, a), states after (N, k) and rewards (N,) to rewards."""


class WatchedWorld(World):
    """Passes everything on to another world, and counts.

    The counts are part of the state, so they survive a checkpoint.

    Attributes:
        reward: what the learner is given instead of the world's reward; ``None``: just that.

    Args:
        world: the world.
    """

    state_names = ('_observation', '_sums', '_open', '_steps', '_totals', '_recent', '_finished')

    def __init__(self, world: World) -> None:
        self._world = world
        self.reward: Reward | None = None
        for name in ('name', 'num_envs', 'columns', 'action_columns', 'step_seconds'):
            setattr(self, name, getattr(world, name))
        self.max_episode_steps = world.max_episode_steps
        shape = self.num_envs, len(self.columns)
        self._observation = np.zeros(shape, np.float32)
        self._sums, self._steps = np.zeros(shape), np.zeros(self.num_envs)
        self._open = np.zeros(self.num_envs, dtype=bool)
        self._totals = np.zeros((self.num_envs, 2))
        self._recent, self._finished = np.zeros((_WINDOW, 2)), np.zeros(1, np.int64)

    @property
    def observation_means(self) -> np.ndarray:
        """(N, k) mean of the states of each running episode so far."""
        return self._sums / self._steps[:, None]

    def recent(self) -> tuple[float, float] | None:
        """Return mean return and true cost of the last 100 finished episodes, if there are any."""
        count = min(int(self._finished[0]), _WINDOW)
        if not count:
            return None
        mean = self._recent[:count].mean(axis=0)
        return float(mean[0]), float(mean[1])

    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes; see :meth:`World.reset`."""
        rows = selected_rows(mask, self.num_envs)
        observation, info = self._world.reset(seed=seed, mask=mask)
        self._observation = observation.copy()
        self._sums[rows], self._steps[rows] = observation[rows], 1.0
        self._totals[rows], self._open[rows] = 0.0, True
        return observation, info

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step; see :meth:`World.step`."""
        observation, reward, terminated, truncated, info = self._world.step(action)
        before, self._observation = self._observation, observation.copy()
        self._sums += observation
        self._steps += 1
        # A stream steps robots once more after their last state, for nothing.
        self._totals += np.stack([reward, info['true_cost']], axis=1) * self._open[:, None]
        ended = np.flatnonzero((terminated | truncated) & self._open)
        self._open[ended] = False
        for total in self._totals[ended]:
            self._recent[self._finished[0] % _WINDOW] = total
            self._finished += 1
        if self.reward is not None:
            reward = self.reward(before, action, observation, reward)
        return observation, reward, terminated, truncated, info

    def close(self) -> None:
        """Release what the world holds; see :meth:`World.close`."""
        self._world.close()

    def state(self) -> dict[str, np.ndarray | list[str]]:
        """Return the state of the world and the counts; see :meth:`World.state`."""
        counts = {f'watched {name}': value for name, value in super().state().items()}
        return {**self._world.state(), **counts}

    def restore(self, state: dict[str, np.ndarray | list[str]]) -> None:
        """Continue from a state; see :meth:`World.restore`."""
        self._world.restore(state)
        super().restore({name: state.get(f'watched {name}') for name in self.state_names})
