# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands that run nodes: ``occ node``, ``record`` and ``play``."""

from __future__ import annotations

import json
from typing import Any

import click


@click.command(context_settings={'ignore_unknown_options': True, 'allow_extra_args': True})
@click.argument('name')
@click.argument('arguments', nargs=-1, type=click.UNPROCESSED)
def node(name: str, arguments: tuple[str, ...]) -> int:
    """Run a ROS 2 node; what follows its name are ROS arguments.

    The nodes are sim, policy, recorder, player, tree_learner, monitor and constrained_learner.

    \b
    Example: occ node monitor -p constraints_file:=constraints.yaml -r __ns:=/robot1
    """
    from occ_constraints_pkg.nodes import run

    return run(name, ['--ros-args', *arguments])


@click.command()
@click.argument('topics', nargs=-1)
@click.option('-o', '--output', required=True, type=click.Path(), help='Directory of the new bag.')
def record(topics: tuple[str, ...], output: str) -> int:
    """Record topics (default: all) to a bag until Ctrl-C.

    \b
    Example: occ record odom scan cmd_vel -o bags/drive_7
    """
    from occ_constraints_pkg.nodes import run

    return run('recorder', _parameters(output=output, topics=list(topics)))


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--rate', default=1.0, show_default=True, help='Speed, 1.0: as recorded.')
@click.option('--loop', is_flag=True, help='Start again at the end.')
@click.option('--topic', 'topics', multiple=True, help='Play only this topic; may be repeated.')
def play(bag: str, rate: float, loop: bool, topics: tuple[str, ...]) -> int:
    """Publish the messages of a recording.

    \b
    Example: occ play bags/drive_7 --rate 2
    """
    from occ_constraints_pkg.nodes import run

    return run('player', _parameters(bag=bag, rate=rate, loop=loop, topics=list(topics)))


def _parameters(**values: Any) -> list[str]:
    """Return node parameters as ROS arguments; empty ones are left to their defaults."""
    arguments = ['--ros-args']
    for name, value in values.items():
        if value not in ('', []):
            arguments += ['-p', f'{name}:={json.dumps(value)}']
    return arguments
