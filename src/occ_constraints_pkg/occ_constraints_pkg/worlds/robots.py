# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Utilities of batches of robots: a random generator per robot, checks of actions and masks."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError


def robot_generators(seed: int | None, num_envs: int) -> list[np.random.Generator]:
    """Return one generator per robot; robot i's depends on ``seed`` and i only.

    Args:
        seed: ``None`` draws fresh entropy from the operating system.
        num_envs: number of robots.

    Raises:
        ConfigurationError: the seed is negative.
    """
    if seed is not None and seed < 0:
        raise ConfigurationError(f'a seed was {seed}; allowed are whole numbers from 0')
    entropy = np.random.SeedSequence(seed).entropy
    # spawn_key rather than spawn(): the same stream whatever was spawned before.
    return [
        np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(index,)))
        for index in range(num_envs)
    ]


def checked_action(action: np.ndarray, num_envs: int, names: tuple[str, ...]) -> np.ndarray:
    """Return ``action`` as (N, a) float64 clipped to [-1, 1].

    Args:
        action: what the caller of ``step`` passed.
        num_envs: number of robots N.
        names: names of the a action columns.

    Raises:
        ConfigurationError: the shape is wrong or a number is not finite.
    """
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (num_envs, len(names)):
        raise ConfigurationError(
            f'an action has shape {values.shape}; allowed is {(num_envs, len(names))}, '
            f'one row per robot with {", ".join(names)}'
        )
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise ConfigurationError(
            f'an action holds {values[row, column]} as {names[column]} of robot {row}; '
            f'allowed are finite numbers'
        )
    return values.clip(-1.0, 1.0)


def selected_rows(mask: np.ndarray | None, num_envs: int) -> np.ndarray:
    """Return the indices that a reset ``mask`` selects; ``None`` selects every robot.

    Raises:
        ConfigurationError: the mask is not (N,) bool.
    """
    if mask is None:
        return np.arange(num_envs)
    mask = np.asarray(mask)
    if mask.shape != (num_envs,) or mask.dtype != bool:
        raise ConfigurationError(
            f'a reset mask has shape {mask.shape} and type {mask.dtype}; '
            f'allowed is ({num_envs},) bool'
        )
    return np.flatnonzero(mask)
