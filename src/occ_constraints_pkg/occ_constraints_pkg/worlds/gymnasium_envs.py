# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Our worlds as gymnasium environments; importing this module registers them.

``gymnasium.make('occ_constraints/CarGoal1-v0')`` gives one robot and
``gymnasium.make_vec('occ_constraints/CarGoal1-v0', num_envs=64)`` a batch that is stepped at once.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.worlds.base import Column
from occ_constraints_pkg.worlds.registry import WORLDS, make_world

_NAMESPACE = 'occ_constraints'


class WorldEnv(gymnasium.Env):
    """One robot of a world.

    ``info['cost']`` is the world's own cost of the state just reached, 0 or 1, and
    ``info['failed']``, where the world has physics, whether that blew up.
    """

    metadata = {'render_modes': []}  # noqa: RUF012 - as gymnasium has it

    def __init__(self, world: str, render_mode: str | None = None) -> None:
        _check_render_mode(render_mode)
        self._world = make_world(world, 1, processes=1)
        self.observation_space = _box(self._world.columns)
        self.action_space = _box(self._world.action_columns)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start a new episode; see :meth:`gymnasium.Env.reset`."""
        super().reset(seed=seed)
        observation, info = self._world.reset(seed=seed)
        return observation[0], _of_one(info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Make one step; see :meth:`gymnasium.Env.step`.

        Raises:
            ConfigurationError: the action has the wrong shape or is not finite.
        """
        observation, reward, terminated, truncated, info = self._world.step(
            np.asarray(action)[None]
        )
        ends = bool(terminated[0]), bool(truncated[0])
        return observation[0], float(reward[0]), *ends, _of_one(info)

    def close(self) -> None:
        """Release the world."""
        self._world.close()


class WorldVectorEnv(VectorEnv):
    """A batch of robots of a world with same-step autoreset.

    Where an episode has ended, the observation is the first of the next one. The last one is then
    in ``info['final_obs']`` and what belongs to it in ``info['final_info']``, as gymnasium's own
    vector environments have it. ``info['cost']`` always belongs to the observation beside it.
    """

    metadata = {'autoreset_mode': AutoresetMode.SAME_STEP}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self, world: str, num_envs: int = 1, processes: int = 0, render_mode: str | None = None
    ) -> None:
        """Build the world.

        Args:
            world: its name.
            num_envs: number of robots N.
            processes: processes that step them, this one included; 0 means one per core, fewer for
                small N.
            render_mode: ``None``, as libraries pass it; nothing is rendered here.
        """
        _check_render_mode(render_mode)
        self._world = make_world(world, num_envs, processes=processes)
        self.num_envs = num_envs
        self.single_observation_space = _box(self._world.columns)
        self.single_action_space = _box(self._world.action_columns)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes of all robots, or of those in ``options['reset_mask']`` (N,) bool."""
        super().reset(seed=seed)
        mask = (options or {}).get('reset_mask')
        observation, info = self._world.reset(seed=seed, mask=mask)
        return observation, self._masked(info, mask)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Make one step with every robot; see :meth:`gymnasium.vector.VectorEnv.step`.

        Raises:
            ConfigurationError: the actions have the wrong shape or are not finite.
        """
        observation, reward, terminated, truncated, info = self._world.step(actions)
        done = terminated | truncated
        if not done.any():
            return observation, reward, terminated, truncated, self._masked(info)
        final_obs = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(done):
            final_obs[row] = observation[row]
        final_info = self._masked(info, done)
        observation, fresh = self._world.reset(mask=done)
        found: dict[str, Any] = self._masked({**info, **fresh})
        found |= {'final_obs': final_obs, '_final_obs': done}
        found |= {'final_info': final_info, '_final_info': done.copy()}
        return observation, reward, terminated, truncated, found

    def close_extras(self, **kwargs: Any) -> None:
        """Release the world."""
        self._world.close()

    def _masked(
        self, info: dict[str, np.ndarray], mask: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """Return the info of the robots in ``mask``, each entry with its mask."""
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else mask
        found = {}
        for name, value in _named(info).items():
            found[name] = np.where(mask, value, np.zeros_like(value))
            found[f'_{name}'] = mask.copy()
        return found


def _register_worlds() -> None:
    """Register every world as ``occ_constraints/<name>-v0`` where it is not registered yet."""
    for world in WORLDS:
        name = f'{_NAMESPACE}/{world}-v0'
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f'{__name__}:{WorldEnv.__name__}',
                vector_entry_point=f'{__name__}:{WorldVectorEnv.__name__}',
                kwargs={'world': world},
            )


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode is not None:
        raise ConfigurationError(
            f'render_mode is {render_mode!r}; allowed is None: occ drive draws an episode'
        )


def _box(columns: tuple[Column, ...]) -> spaces.Box:
    low, high = ([getattr(column, end) for column in columns] for end in ('low', 'high'))
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)


def _named(info: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the info under the names that gymnasium agents expect."""
    return {('cost' if name == 'true_cost' else name): value for name, value in info.items()}


def _of_one(info: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: value[0].item() for name, value in _named(info).items()}


_register_worlds()
