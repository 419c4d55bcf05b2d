# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command line of the benchmarks."""

from __future__ import annotations

import click
from occ_constraints_pkg.cli.common import (
    JSON,
    Seconds,
    end_tidily,
    help_without_command,
    print_json,
    say,
)
from occ_constraints_pkg.errors import import_needed

from benchmarks import BENCHMARKS
from benchmarks.conditions import machine, versions


@click.group(invoke_without_command=True, context_settings={'help_option_names': ['-h', '--help']})
@click.pass_context
def cli(context: click.Context) -> None:
    """Measure speed, from the root of a clone.

    Each prints its metrics and those of its peers, which ran beside it; with --json also the
    machine and the versions of what was measured.

    \b
    Example: python -m benchmarks loop --json
    """
    help_without_command(context)


def _add(name: str, what: str) -> None:
    @cli.command(name, help=what, short_help=what)
    @click.option(
        '--seconds',
        type=Seconds(),
        help="Measured time of each form; default: the benchmark's own.",
    )
    @JSON
    def measure(seconds: float | None, as_json: bool) -> None:
        module = import_needed(f'the benchmark {name}', f'benchmarks.{name}')
        end_tidily()
        result = module.run() if seconds is None else module.run(seconds)
        if as_json:
            print_json({**result, 'machine': machine(), 'versions': versions()})
            return
        for part in ('metrics', 'peers'):
            for key, value in result[part].items():
                say(f'{key}: {value:.4g}')


for _name, _what in BENCHMARKS.items():
    _add(_name, _what)
