# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Whoever can drive, by name: trained policy files, shipped experts, scripted drivers."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable

import numpy as np

from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.scripted import DRIVERS, Driver, make_driver
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import check_world

_EXPERTS = resources.files(__package__).joinpath('experts')
# Worlds that differ from another one in nothing but their scenarios share its expert.
_EXPERT_OF = {'highway_restricted': 'highway'}


def check_name(name: str) -> None:
    """Do nothing if a policy file, or a driver of some world, can be called so.

    Raises:
        OccError: no driver of any world has that name.
    """
    names = sorted({'expert'}.union(*DRIVERS.values()))
    if not name.endswith('.npz') and name not in names:
        raise ConfigurationError(
            f'there is no driver {name!r}{did_you_mean(name, names) or ";"} allowed are '
            f'{", ".join(names)}, as far as the world has them, and a policy file (.npz)'
        )


def find_driver(
    world: type[World] | World, name: str, rng: np.random.Generator, *, explore: bool = False
) -> Driver:
    """Return a driver for ``world``.

    Args:
        world: the world that it drives in, or its class.
        name: a policy file (``.npz``); ``expert`` for the trained expert that is shipped for some
            worlds; else a scripted driver of that name.
        rng: source of the driver's random choices.
        explore: sample the actions of a trained policy instead of taking their mean.

    Raises:
        OccError: there is no such driver, or the policy belongs to another world.
    """
    check_driver(world.name, name)
    shipped = _expert_file(world.name)
    if name.endswith('.npz'):
        policy = GaussianPolicy.load(name)
    elif name == 'expert' and shipped.is_file():
        with resources.as_file(shipped) as path:
            policy = GaussianPolicy.load(path)
    else:
        return make_driver(world.name, name, rng)
    policy.check_world(world.columns, world.action_columns)
    return lambda observation: policy.act(observation, rng if explore else None)


def check_driver(world: str, name: str) -> None:
    """Refuse a name that is no driver's and no policy file's, before anything is built or read.

    Raises:
        OccError: there is no such driver or no such world.
    """
    check_world(world)
    names = list(DRIVERS[world])
    if 'expert' not in names and _expert_file(world).is_file():
        names.append('expert')
    if not (name.endswith('.npz') or name in names):
        hint = did_you_mean(name, names) or ';'
        raise ConfigurationError(
            f'world {world} has no driver {name!r}{hint} allowed are {", ".join(names)} and a '
            'policy file (.npz)'
        )


def _expert_file(world: str) -> Traversable:
    return _EXPERTS.joinpath(f'{_EXPERT_OF.get(world, world)}.npz')
