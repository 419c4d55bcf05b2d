# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The commands of ``occ`` in the groups that its help shows."""

from __future__ import annotations

import click

import occ_constraints_pkg
from occ_constraints_pkg.cli.common import help_without_command
from occ_constraints_pkg.cli.comparison import compare
from occ_constraints_pkg.cli.completion import SHELLS, print_script
from occ_constraints_pkg.cli.events import events
from occ_constraints_pkg.cli.learning import learn
from occ_constraints_pkg.cli.nodes import demo, doctor, node, watch
from occ_constraints_pkg.cli.recordings import features, import_, info, play, record
from occ_constraints_pkg.cli.report import report
from occ_constraints_pkg.cli.rules import check, diff, export, prune, score, show, simplify
from occ_constraints_pkg.cli.simulation import drive, evaluate, train
from occ_constraints_pkg.cli.triage import triage

_GROUPS = {
    'Rules': (learn, show, diff, check, compare, score, prune, simplify, export, report),
    'Recordings': (info, features, record, play, triage, import_),
    'Nodes': (node, watch, events, doctor, demo),
    'Simulation': (train, evaluate, drive),
}


class _GroupedCommands(click.Group):
    """Lists the commands by group, and says where those that moved have gone."""

    def format_commands(self, _context: click.Context, formatter: click.HelpFormatter) -> None:
        width = max(map(len, self.commands))
        formatter.write_paragraph()
        for title, commands in _GROUPS.items():
            # Not as sections, whose empty lines would make it longer than a screen.
            formatter.write_heading(title)
            with formatter.indentation():
                formatter.write_dl(
                    [
                        (f'{command.name:<{width}}', command.get_short_help_str(formatter.width))
                        for command in commands
                    ]
                )

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, *rest = args
        new = {'bench': 'benchmarks', 'experiment': 'experiments'}.get(name)
        if new is not None:
            chosen = rest[0] if rest and not rest[0].startswith('-') else 'NAME'
            if (name, chosen) == ('experiment', 'depth'):
                raise click.UsageError("'occ experiment depth' is now 'occ learn --compare-depths'")
            raise click.UsageError(
                f"'occ {name} {chosen}' is now 'python -m {new} {chosen}' in a clone of the "
                'repository'
            )
        return super().resolve_command(context, args)


@click.group(
    cls=_GroupedCommands,
    invoke_without_command=True,
    context_settings={'help_option_names': ['-h', '--help']},
)
@click.version_option(occ_constraints_pkg.__version__)
@click.option(
    '--completion',
    type=click.Choice(SHELLS),
    metavar='SHELL',
    is_eager=True,
    expose_value=False,
    callback=print_script,
    help='Print what lets bash, zsh or fish complete, and exit.',
)
@click.pass_context
def cli(context: click.Context) -> None:
    """Learn a robot's safety constraints, monitor them, train within them."""
    help_without_command(context)


for _commands in _GROUPS.values():
    for _command in _commands:
        cli.add_command(_command)
