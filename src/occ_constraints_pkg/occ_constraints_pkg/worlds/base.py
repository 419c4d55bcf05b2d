# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The interface of a simulated task that steps many robots at once."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.worlds.view import RobotView


@dataclass(frozen=True)
class Column:
    """One named number of an observation or an action.

    Attributes:
        name: lower-case identifier, unique within its world, for example ``hazards_lidar_3``.
        unit: SI unit, or ``1`` for a pure number.
        low: smallest possible value, in ``unit``.
        high: largest possible value, in ``unit``.
    """

    name: str
    unit: str = '1'
    low: float = -np.inf
    high: float = np.inf


class World(ABC):
    """A batch of independent robots that all perform one task.

    Follows the ``gymnasium.vector.VectorEnv`` conventions with automatic reset disabled: after a
    step that ends some episodes the caller resets those rows with ``reset(mask=...)`` before it
    steps them again. :class:`~occ_constraints_pkg.worlds.stream.EpisodeStream` does so.

    Every robot draws from its own random generator, so the trajectory of one robot depends only
    on the seed, its index and its own actions: not on the size of the batch, nor on processes.

    Attributes:
        name: the name under which the world is registered.
        num_envs: number of robots N.
        columns: the observation's columns, in order (k of them).
        action_columns: the action's columns, in order (a of them).
        step_seconds: simulated seconds per step.
        max_episode_steps: steps after which an episode is truncated.
        state_names: attributes that, with the actions, determine everything that follows: arrays,
            which :meth:`restore` fills in place, and lists of generators. Dotted names are allowed.
        view_kinds: types of things in the ranges of :meth:`view`; ``None`` if the world has no view
            of its robots.
    """

    state_names: ClassVar[tuple[str, ...]]
    name: str
    num_envs: int
    columns: tuple[Column, ...]
    action_columns: tuple[Column, ...]
    step_seconds: float
    max_episode_steps: int
    view_kinds: tuple[str, ...] | None = None

    @abstractmethod
    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: reseeds the generators of all robots; ``None`` keeps them.
            mask: (N,) bool, the robots to reset; ``None`` means all.

        Returns:
            ``(observation, info)`` for all robots: (N, k) float32, rows of robots that were not
            reset unchanged; ``info['true_cost']`` is (N,) float64.
        """

    @abstractmethod
    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step.

        Args:
            action: (N, a) finite numbers; values outside the columns' bounds are clipped.

        Returns:
            ``(observation, reward, terminated, truncated, info)`` with shapes (N, k) float32,
            (N,) float64, (N,) bool, (N,) bool. ``info['true_cost']`` is (N,) float64, the cost of
            the state just reached, 0 or 1.

        Raises:
            ConfigurationError: the action has the wrong shape or is not finite.
        """

    def view(self, row: int) -> RobotView:
        """Return the view of one robot for ROS and pictures; requires :attr:`view_kinds`.

        Args:
            row: index of the robot.
        """
        raise ConfigurationError(f'world {self.name} has no view of its robots')

    def action_for(self, row: int, speed: float, turning: float) -> np.ndarray:
        """Return the action that follows a velocity command; requires :attr:`view_kinds`.

        Args:
            row: index of the robot.
            speed: forward, in m/s.
            turning: in rad/s, counter-clockwise.

        Returns:
            (a,) within the bounds of the action columns.
        """
        raise ConfigurationError(
            f'robots of world {self.name} cannot be driven by velocity commands'
        )

    def close(self) -> None:  # noqa: B027 - most worlds have nothing to release
        """Release memory and end worker processes; the world may not be used afterwards."""

    def state(self) -> dict[str, np.ndarray | list[str]]:
        """Return copies of the complete state, for :meth:`restore`; generators as JSON text."""
        state: dict[str, np.ndarray | list[str]] = {}
        for name in self.state_names:
            value = attrgetter(name)(self)
            if isinstance(value, np.ndarray):
                state[name] = value.copy()
            else:
                state[name] = [json.dumps(rng.bit_generator.state) for rng in value]
        return state

    def restore(self, state: dict[str, np.ndarray | list[str]]) -> None:
        """Continue where a world of the same class and size was when it returned ``state``.

        Raises:
            ConfigurationError: the state is that of another class or of another number of robots.
        """
        for name in self.state_names:
            saved: Any = state.get(name)
            value = attrgetter(name)(self)
            if np.shape(saved) != np.shape(value):
                raise ConfigurationError(
                    f'the saved state of world {self.name} has {name} of shape {np.shape(saved)}; '
                    f'allowed is {np.shape(value)} for {self.num_envs} robots'
                )
            if isinstance(value, np.ndarray):
                value[...] = saved
            else:
                for rng, text in zip(value, saved, strict=True):
                    rng.bit_generator.state = json.loads(text)
