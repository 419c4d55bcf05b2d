# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ``: one module for each group of commands."""

from __future__ import annotations

import signal
from collections.abc import Sequence

import click

import occ_constraints_pkg
from occ_constraints_pkg.cli.demo_and_bench import bench, demo
from occ_constraints_pkg.cli.drive import drive
from occ_constraints_pkg.cli.experiments import experiment
from occ_constraints_pkg.cli.export import export
from occ_constraints_pkg.cli.features import features
from occ_constraints_pkg.cli.importing import import_
from occ_constraints_pkg.cli.learning import learn
from occ_constraints_pkg.cli.nodes import node, play, record
from occ_constraints_pkg.cli.rules import check, prune, score, show, simplify
from occ_constraints_pkg.cli.training import evaluate, train
from occ_constraints_pkg.errors import OccError


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``occ``; return 0 (done), 1 (problems were found) or 2 (bad input)."""
    handler = signal.getsignal(signal.SIGTERM)
    try:
        code = cli.main(args=None if argv is None else list(argv), standalone_mode=False)
        return code if isinstance(code, int) else 0
    except OccError as error:
        click.echo(f'error: {error}', err=True)
        return 2
    except click.ClickException as error:
        context = getattr(error, 'ctx', None)
        hint = f"; see '{context.command_path} --help'" if context else ''
        click.echo(f'error: {error.format_message().rstrip(".")}{hint}', err=True)
        return 2
    except (click.Abort, KeyboardInterrupt):
        click.echo('stopped', err=True)
        return 130
    except SystemExit:
        # This is how click says that the reader of our output has gone, as in `occ show | head`.
        return 0
    finally:
        signal.signal(signal.SIGTERM, handler)


@click.group(invoke_without_command=True, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(occ_constraints_pkg.__version__)
@click.pass_context
def cli(context: click.Context) -> None:
    """Learn a robot's safety constraints from demonstrations, monitor them, train within them."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for _command in (
    *(features, learn, show, check, score, prune, simplify, export),
    *(train, evaluate, drive),
    *(node, record, play, import_),
    *(demo, bench, experiment),
):
    cli.add_command(_command)
