# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The executables, one module each; every module translates between topics and the library."""

from __future__ import annotations

import sys
from importlib import import_module

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import OccError

# Node name -> the extra that a plain pip install needs beyond 'ros'.
NODES = {
    'sim': 'train',
    'policy': '',
    'recorder': '',
    'player': '',
    'tree_learner': '',
    'monitor': '',
    'constrained_learner': 'train',
}


def run(name: str, argv: list[str] | None = None) -> int:
    """Run the node ``name`` until it ends; return its exit code.

    Args:
        name: one of :data:`NODES`.
        argv: arguments for ROS, ``--ros-args`` included.

    Returns:
        0 after a clean end, Ctrl-C and SIGTERM included; 2 after a mistake in the input.
    """
    try:
        return node_main(name)(argv)
    except KeyboardInterrupt:
        return 0
    except OccError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2


def node_main(name: str):
    """Return the ``main`` of a node's module.

    Raises:
        OccError: there is no such node, or a package that it needs is not installed.
    """
    if name not in NODES:
        hint = did_you_mean(name, NODES) or ';'
        raise OccError(f'there is no node {name!r}{hint} the nodes are {", ".join(NODES)}')
    try:
        return import_module(f'{__name__}.{name}').main
    except ModuleNotFoundError as error:
        extra = {'torch': 'train', 'mujoco': 'train'}.get(str(error.name).split('.')[0], 'ros')
        if str(error.name).startswith('occ_constraints_pkg'):
            raise
        raise OccError(
            f'node {name!r} needs the module {error.name!r}, which is not installed: '
            f"pip install 'occ_constraints_pkg[{extra}]', or source the ROS 2 setup file"
        ) from error
