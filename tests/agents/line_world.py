# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The smallest task with a trade-off: robots on a line, paid for going right, fined beyond 0.7."""

from __future__ import annotations

from typing import Any

import numpy as np
from occ_constraints_pkg.worlds.base import Column, World


class LineWorld(World):
    """A point on [0, 1] that moves by a tenth of its action; the reward of a step is its place.

    Episodes are truncated after 20 steps, and terminate early at the left end when ``cliff``.
    """

    name = 'line'
    columns = (Column('x', 'm', 0.0, 1.0),)
    action_columns = (Column('d_x', '1', -1.0, 1.0),)
    step_seconds = 0.1
    max_episode_steps = 20
    state_names = ('x', 't', 'rngs')

    def __init__(self, num_envs: int, *, cliff: bool = False) -> None:
        self.num_envs = num_envs
        self.cliff = cliff
        self.x = np.zeros(num_envs)
        self.t = np.zeros(num_envs, dtype=np.int64)
        self.rngs = [np.random.default_rng()]

    def _view(self) -> tuple[np.ndarray, dict[str, Any]]:
        return self.x[:, None].astype(np.float32), {'true_cost': (self.x > 0.7).astype(np.float64)}

    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start at a random place in the left half."""
        if seed is not None:
            self.rngs = [np.random.default_rng(seed)]
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else mask
        self.x[mask] = self.rngs[0].uniform(0.1, 0.5, mask.sum())
        self.t[mask] = 0
        return self._view()

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Move."""
        self.x = np.clip(self.x + 0.1 * np.clip(action[:, 0], -1.0, 1.0), 0.0, 1.0)
        self.t += 1
        observation, info = self._view()
        terminated = (self.x <= 0.0) & self.cliff
        truncated = ~terminated & (self.t >= self.max_episode_steps)
        return observation, self.x.copy(), terminated, truncated, info
