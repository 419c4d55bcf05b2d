# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The worlds by name."""

from __future__ import annotations

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.worlds.base import World

MOST_ROBOTS = 100_000
"""More do not fit into the memory of usual machines."""


def make_world(name: str, num_envs: int, *, processes: int = 0) -> World:
    """Build a world of ``num_envs`` robots.

    Args:
        name: one of :data:`WORLDS`.
        num_envs: number of robots, from 1 to :data:`MOST_ROBOTS`.
        processes: processes that step them, this one included; 0: one per core, fewer for few
            robots. Worlds that need no processes ignore it.

    Raises:
        ConfigurationError: there is no such world, or a number is out of range.
        MissingDependencyError: MuJoCo is not installed.
    """
    world = world_class(name)
    if not 1 <= num_envs <= MOST_ROBOTS:
        raise ConfigurationError(
            f'world {name} was asked for {num_envs} robots; allowed are 1 to {MOST_ROBOTS}'
        )
    if processes < 0:
        raise ConfigurationError(
            f'world {name} was asked for {processes} processes; 0 or more are allowed'
        )
    return world(num_envs, processes=processes)  # type: ignore[call-arg]


def check_world(name: str) -> None:
    """Refuse a name of no world, without importing anything.

    Raises:
        ConfigurationError: there is no such world.
    """
    if name not in _CLASSES:
        hint = did_you_mean(name, WORLDS) or ';'
        raise ConfigurationError(
            f'there is no world {name!r}{hint} the worlds are {", ".join(WORLDS)}'
        )


def world_class(name: str) -> type[World]:
    """Return the class of a world, which has its columns as attributes.

    Raises:
        ConfigurationError: there is no such world.
        MissingDependencyError: MuJoCo is not installed.
    """
    check_world(name)
    module, class_name = _CLASSES[name]
    # Imported late: MuJoCo is an extra that a robot that only monitors does not need.
    return getattr(import_needed(f'world {name}', f'{__package__}.{module}'), class_name)


_CLASSES = {
    'simple_nav': ('simple_nav', 'SimpleNav'),
    'PointGoal1': ('safety_gym', 'PointGoal1'),
    'PointPush1': ('safety_gym', 'PointPush1'),
    'CarGoal1': ('safety_gym', 'CarGoal1'),
    'CarPush1': ('safety_gym', 'CarPush1'),
    'highway': ('highway', 'Highway'),
    'highway_restricted': ('highway', 'RestrictedHighway'),
}

WORLDS: tuple[str, ...] = tuple(_CLASSES)
"""Names that :func:`make_world` knows."""
