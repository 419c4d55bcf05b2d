# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ export``: rules for programs that do without this package."""

from __future__ import annotations

import click

from occ_constraints_pkg.cli.common import help_without_command, say, say_lines


@click.group(invoke_without_command=True)
@click.pass_context
def export(context: click.Context) -> None:
    """Write rules in a form that other programs use without this package.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """
    help_without_command(context)


@export.command()
@click.argument('constraints', type=click.Path())
@click.option('-o', '--output', type=click.Path(), help='File to write; default: stdout.')
@click.option('--prefix', default='occ', show_default=True, help='Begins every name in the file.')
def c(constraints: str, output: str | None, prefix: str) -> None:
    """Write the rules as one C99 header with a function PREFIX_judge.

    It gives the same verdict, rule and margin as the monitor.

    \b
    Example: occ export c constraints.yaml -o rules.h
    """
    from occ_constraints_pkg.files import C_HEADER, check_outputs, write_text
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.rules.export_c import export_c

    if output is not None:
        check_outputs({output: C_HEADER}, [constraints])
    text = export_c(load_constraints(constraints).rule_set, prefix)
    if output is None:
        say_lines(text, nl=False)
        return
    write_text(output, C_HEADER, text)
    say(f'Written to {output}')
