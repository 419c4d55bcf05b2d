# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The executables, one module or package each: between topics and the library.

Beside them is what several of them share: ``lockstep`` and ``robot_sensors`` of the simulation,
``bag_topics`` of recorder and player, ``help`` of all.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from occ_constraints_pkg.errors import (
    ConfigurationError,
    MissingDependencyError,
    OccError,
    import_needed,
)
from occ_constraints_pkg.nodes.help import asks_for_help, print_help
from occ_constraints_pkg.ros.environment import check_environment
from occ_constraints_pkg.stopping import stop_request

NODES = (
    'sim',
    'policy',
    'recorder',
    'player',
    'tree_learner',
    'monitor',
    'gate',
    'event_recorder',
    'constrained_learner',
    'dashboard',
)
# Where the module is not of the node's name.
_MODULES = {'monitor': 'monitor.node', 'event_recorder': 'event_recorder.node'}


def run(name: str, argv: list[str] | None = None) -> int:
    """Run the node ``name`` until it ends; return its exit code.

    Args:
        name: one of :data:`NODES`.
        argv: arguments for ROS, ``--ros-args`` included; with ``--help`` among them the node is
            only described.

    Returns:
        0 after a clean end, Ctrl-C and SIGTERM included; 2 after a mistake in the input.
    """
    with stop_request.listening():
        try:
            with stop_request.ending_at_once(0):
                check_environment()
                main = node_main(name)
            return print_help(name, main) if asks_for_help(argv or ()) else main(argv)
        except OccError as error:
            print(f'error: {error}', file=sys.stderr)
            return 2


def node_main(name: str) -> Callable[[list[str] | None], int]:
    """Return the ``main`` of a node's module.

    Raises:
        OccError: there is no such node, or a package that it needs is not installed.
    """
    if name not in NODES:
        # Imported late, for until `run` listens to signals they end the process with noise.
        from occ_constraints_pkg.documents import did_you_mean

        hint = did_you_mean(name, NODES) or ';'
        raise ConfigurationError(
            f'there is no node {name!r}{hint} the nodes are {", ".join(NODES)}'
        )
    what = f'node {name!r}'
    try:
        return import_needed(what, f'{__name__}.{_MODULES.get(name, name)}').main
    except MissingDependencyError:
        # It names the extra already.
        raise
    except ImportError as error:
        package = __name__.partition('.')[0]
        if (error.name or '').partition('.')[0] == package:
            # A mistake of this package, which a user cannot mend.
            raise
        # Most likely it was started outside of the environment that it was installed into.
        reason = str(error).strip().partition('\n')[0]
        raise ConfigurationError(
            f'{what} cannot be loaded: {reason}; allowed is an installation with all it needs: '
            f'activate its environment (source .venv/bin/activate), or pip install {package}'
        ) from error
