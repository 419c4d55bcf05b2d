# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ node``, ``occ watch``, ``occ doctor`` and ``occ demo``."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import click

from occ_constraints_pkg.cli.common import (
    JSON,
    Seconds,
    discard,
    end_tidily,
    print_json,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.completion import node_names
from occ_constraints_pkg.errors import MissingDependencyError, import_needed
from occ_constraints_pkg.stopping import stop_request


@click.command(context_settings={'ignore_unknown_options': True, 'allow_interspersed_args': False})
@click.argument('name', shell_complete=node_names)
@click.argument('arguments', nargs=-1, type=click.UNPROCESSED)
def node(name: str, arguments: tuple[str, ...]) -> int:
    """Run a ROS 2 node, or describe it: node NAME --help.

    What follows its name are ROS arguments. The nodes are sim, policy, recorder, player,
    tree_learner, monitor, gate, event_recorder, constrained_learner and dashboard.

    \b
    Example: occ node monitor -p constraints_file:=constraints.yaml -r __ns:=/robot1
             occ node monitor --help
    """
    from occ_constraints_pkg.nodes import run

    return run(name, ['--ros-args', *arguments])


@click.command()
@click.option('--plain', is_flag=True, help='Print a line for each change instead.')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object for each change.')
def watch(plain: bool, as_json: bool) -> int:
    """Show live what monitors and gates say, and change rules.

    Every robot whose monitor is found in the ROS domain (ROS_DOMAIN_ID): verdict, margin over
    time, rules by closeness, events, gate. Where there is no terminal to draw on, or with
    NO_COLOR, each change is a plain line.

    \b
    Example: occ watch
             occ watch --json > changes.jsonl
    """
    from occ_constraints_pkg.ros.environment import check_environment
    from occ_constraints_pkg.watch.lines import document_of, is_plain, line_of

    check_environment()
    app = import_needed('occ watch', 'occ_constraints_pkg.watch.app')
    if not (plain or as_json or is_plain(os.environ)):
        try:
            return app.run_screen()
        except MissingDependencyError as error:
            warn(f'{error}; here each change is a line')
    if as_json:
        return app.run_lines(lambda *item: _say_next(json.dumps(document_of(*item))))
    return app.run_lines(lambda *item: _say_next(line_of(*item)))


def _say_next(line: str) -> None:
    """Print one more line; when the reader has gone, as in ``| head``, there are no more."""
    try:
        click.echo(line)
    except BrokenPipeError:
        discard(sys.stdout)
        stop_request.made = True


@click.command()
@click.option(
    '--bags',
    default='.',
    show_default=True,
    type=click.Path(file_okay=False),
    help='Folder that recordings are written to.',
)
@JSON
def doctor(bags: str, as_json: bool) -> int:
    """Find out why nodes do not run or do not hear each other here.

    Looks at Python, ROS, the domain, clocks and the disk, lets two processes talk, and says what
    to do. Takes up to ten seconds; exit code 1 if something has to be done.

    \b
    Example: occ doctor
    """
    from occ_constraints_pkg.doctor.examination import document_of, examine, summary_of, text_of

    findings = []
    for finding in examine(Path(bags)):
        findings.append(finding)
        if not as_json:
            say_lines(text_of(finding))
    document = document_of(findings)
    if as_json:
        print_json(document)
    else:
        say_lines(summary_of(findings))
    return 0 if document['ok'] else 1


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
