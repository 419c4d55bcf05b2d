# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands that run nodes: ``occ node``, ``record`` and ``play``."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import click


@click.command(context_settings={'ignore_unknown_options': True, 'allow_interspersed_args': False})
@click.argument('name')
@click.argument('arguments', nargs=-1, type=click.UNPROCESSED)
def node(name: str, arguments: tuple[str, ...]) -> int:
    """Run a ROS 2 node; what follows its name are ROS arguments, or --help for its parameters.

    The nodes are sim, policy, recorder, player, tree_learner, monitor, gate and
    constrained_learner.

    \b
    Example: occ node monitor -p constraints_file:=constraints.yaml -r __ns:=/robot1
    """
    from occ_constraints_pkg.nodes import run

    return run(name, ['--ros-args', *arguments])


_CHOICE = (
    click.option('-e', '--regex', default='', help='Topics with this pattern in their name too.'),
    click.option(
        '--exclude-topic', 'exclude_topics', multiple=True, help='Not this; may be repeated.'
    ),
    click.option('--exclude-regex', default='', help='Nor topics with this pattern in their name.'),
)


def _choice_of_topics(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that recorder and player share."""
    for option in reversed(_CHOICE):
        command = option(command)
    return command


def _is_default(context: click.Context, _parameter: Any, given: object) -> None:
    if given:
        raise click.UsageError(
            'topics are given as arguments, as in occ record odom scan -o bag, and without any '
            'all are recorded: -a, --all and --topics are not needed',
            context,
        )


@click.command()
@click.argument('topics', nargs=-1)
# Habits of other recorders: eager, so that they are told of before what else is missing.
@click.option(
    *('-a', '--all', '--all-topics', 'everything'),
    is_flag=True,
    is_eager=True,
    hidden=True,
    expose_value=False,
    callback=_is_default,
)
@click.option(
    *('--topics', 'named'), is_eager=True, hidden=True, expose_value=False, callback=_is_default
)
@click.option('-o', '--output', required=True, type=click.Path(), help='Directory of the new bag.')
@_choice_of_topics
@click.option('--compression', default='zstd', show_default=True, help='zstd, lz4 or none.')
@click.option(
    '-b',
    '--max-bag-size',
    default=0,
    show_default=True,
    help='Bytes after which a new file is begun; 0: never.',
)
@click.option(
    '-d',
    '--max-bag-duration',
    default=0.0,
    show_default=True,
    help='Seconds after which a new file is begun; 0: never.',
)
@click.option('--use-sim-time', is_flag=True, help='Stamp messages with the time of /clock.')
def record(**options: Any) -> int:
    """Record topics (default: all) to a bag until Ctrl-C.

    \b
    Example: occ record odom scan cmd_vel -o bags/drive_7
    """
    from occ_constraints_pkg.nodes import run

    return run('recorder', _parameters(options))


@click.command()
@click.argument('bag', type=click.Path())
@click.option('--topic', 'topics', multiple=True, help='Play only this topic; may be repeated.')
@_choice_of_topics
@click.option('-r', '--rate', default=1.0, show_default=True, help='Speed, 1.0: as recorded.')
@click.option('-l', '--loop', is_flag=True, help='Start again at the end.')
@click.option(
    '--start-offset', default=0.0, show_default=True, help='Seconds of the recording to leave out.'
)
@click.option(
    '--clock',
    type=float,
    is_flag=False,
    flag_value=40.0,
    default=0.0,
    help='Publish /clock as many times per second; without a number 40 times.',
)
@click.option('-p', '--start-paused', is_flag=True, help='Wait for the service ~/resume.')
@click.option(
    '--wait-for-subscribers',
    default=0,
    show_default=True,
    help='Subscriptions over all topics before the start.',
)
def play(**options: Any) -> int:
    """Publish the messages of a recording.

    \b
    Example: occ play bags/drive_7 --rate 2 --clock
    """
    from occ_constraints_pkg.nodes import run

    return run('player', _parameters(options))


def _parameters(values: Mapping[str, Any]) -> list[str]:
    """Return node parameters as ROS arguments; empty ones are left to their defaults."""
    arguments = ['--ros-args']
    for name, value in values.items():
        if value not in ('', ()):
            arguments += ['-p', f'{name}:={json.dumps(value)}']
    return arguments
