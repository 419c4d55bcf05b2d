# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The episodes of a world as one endless stream of states, as published on topics."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.worlds.base import World


@dataclass(frozen=True)
class StepBatch:
    """The states that N robots have just reached, and the results of the step.

    The last state of an episode has ``terminated`` or ``truncated`` set; the next batch has the
    first state of the next episode, with reward 0, and the action taken in the last state has no
    effect (next-step autoreset in gymnasium). So every state appears once in the stream, the last
    one of each episode included.

    Attributes:
        observation: (N, k) float32.
        reward: (N,) float64, of the step that led here.
        terminated: (N,) bool, the task ended here.
        truncated: (N,) bool, the time limit was reached here.
        episode: (N,) int64, number of the episode, counted per robot from 0.
        true_cost: (N,) float64, the world's own cost of this state.
    """

    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    episode: np.ndarray
    true_cost: np.ndarray

    @property
    def done(self) -> np.ndarray:
        """(N,) bool: this is the last state of its episode."""
        return self.terminated | self.truncated


class EpisodeStream:
    """Steps a world and starts a new episode wherever one has ended."""

    def __init__(self, world: World, *, seed: int) -> None:
        self.world = world
        self._seed = seed
        self._last: StepBatch | None = None

    def reset(self) -> StepBatch:
        """Seed the world and return the first states of the first episodes."""
        n = self.world.num_envs
        observation, info = self.world.reset(seed=self._seed)
        never = np.zeros(n, dtype=bool)
        self._last = StepBatch(
            observation, np.zeros(n), never, never, np.zeros(n, dtype=np.int64), info['true_cost']
        )
        return self._last

    def step(self, action: np.ndarray) -> StepBatch:
        """Apply ``action`` (N, a) and return the next states.

        Raises:
            ConfigurationError: the action has the wrong shape or is not finite.
        """
        last = self._last if self._last is not None else self.reset()
        observation, reward, terminated, truncated, info = self.world.step(action)
        true_cost, episode = info['true_cost'], last.episode
        fresh = last.done
        if fresh.any():
            observation, info = self.world.reset(mask=fresh)
            reward = np.where(fresh, 0.0, reward)
            terminated, truncated = terminated & ~fresh, truncated & ~fresh
            true_cost = np.where(fresh, info['true_cost'], true_cost)
            episode = episode + fresh
        self._last = StepBatch(observation, reward, terminated, truncated, episode, true_cost)
        return self._last

    def state(self) -> dict[str, Any]:
        """Return the state of the world and the last batch, for :meth:`restore`."""
        last = self._last if self._last is not None else self.reset()
        return {'world': self.world.state(), 'last': asdict(last)}

    def restore(self, state: dict[str, Any]) -> StepBatch:
        """Continue where a stream was when it returned ``state``; return its last batch.

        Raises:
            ConfigurationError: the state is that of another world or of another number of robots.
        """
        self.world.restore(state['world'])
        self._last = StepBatch(**state['last'])
        return self._last
