# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ node`` and ``occ demo``."""

from __future__ import annotations

from pathlib import Path

import click

from occ_constraints_pkg.cli.common import Seconds, end_tidily
from occ_constraints_pkg.errors import import_needed


@click.command(context_settings={'ignore_unknown_options': True, 'allow_interspersed_args': False})
@click.argument('name')
@click.argument('arguments', nargs=-1, type=click.UNPROCESSED)
def node(name: str, arguments: tuple[str, ...]) -> int:
    """Run a ROS 2 node, or describe it: node NAME --help.

    What follows its name are ROS arguments. The nodes are sim, policy, recorder, player,
    tree_learner, monitor, gate and constrained_learner.

    \b
    Example: occ node monitor -p constraints_file:=constraints.yaml -r __ns:=/robot1
             occ node monitor --help
    """
    from occ_constraints_pkg.nodes import run

    return run(name, ['--ros-args', *arguments])


@click.command()
@click.option('-o', '--output', default='demo_output', show_default=True, type=click.Path())
@click.option('--train-seconds', default=120.0, type=Seconds(), show_default=True)
def demo(output: str, train_seconds: float) -> int:
    """Record, learn, monitor and train on PointGoal1; write a page.

    \b
    Example: occ demo
    """
    # Some are needed at the end only, but a missing module must show now.
    for module in ('page', 'observer'):
        import_needed('occ demo', f'occ_constraints_pkg.demo.{module}')
    run_demo = import_needed('occ demo', 'occ_constraints_pkg.demo.demo').run_demo
    end_tidily()
    return run_demo(Path(output), train_seconds=train_seconds)
