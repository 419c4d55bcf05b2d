# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ demo`` and ``occ bench``."""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks import BENCHMARKS
from occ_constraints_pkg.cli.common import JSON, Seconds, end_tidily, print_json, say
from occ_constraints_pkg.errors import import_needed


@click.command()
@click.option('-o', '--output', default='demo_output', show_default=True, type=click.Path())
@click.option('--train-seconds', default=120.0, type=Seconds(), show_default=True)
def demo(output: str, train_seconds: float) -> int:
    """Run the whole loop on PointGoal1: record, learn, monitor, train; write a page.

    \b
    Example: occ demo
    """
    # Some are needed at the end only, but a missing module must show now.
    for module in ('report.demo_page', 'experiments.witness'):
        import_needed('occ demo', f'occ_constraints_pkg.{module}')
    run_demo = import_needed('occ demo', 'occ_constraints_pkg.demo.demo').run_demo
    end_tidily()
    return run_demo(Path(output), train_seconds=train_seconds)


@click.command(epilog=''.join(f'\b\n{name}: {words}\n\n' for name, words in BENCHMARKS.items()))
@click.argument('name', type=click.Choice(list(BENCHMARKS)))
@click.option(
    '--seconds',
    type=Seconds(),
    help="Measured time per form; default: the benchmark's own.",
)
@JSON
def bench(name: str, seconds: float | None, as_json: bool) -> None:
    """Measure speed; prints metrics, what ran beside them, machine and versions.

    \b
    Example: occ bench loop --json
    """
    module = import_needed(f'occ bench {name}', f'benchmarks.{name}')
    end_tidily()
    result = module.run() if seconds is None else module.run(seconds)
    if as_json:
        print_json(result)
        return
    for part in ('metrics', 'peers'):
        for key, value in result[part].items():
            say(f'{key}: {value:.4g}')
