# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ report``: one HTML file to read and to hand on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from occ_constraints_pkg.cli.common import DEFINITIONS, JSON, print_json, read_data, say, warn
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS
from occ_constraints_pkg.files import PAGE, check_outputs

HTML = click.option('--html', type=click.Path(), help='Write a page (HTML) to this file, too.')


@click.command()
@click.argument('paths', metavar='[DATA]...', nargs=-1, type=click.Path())
@click.option('-c', '--constraints', type=click.Path(), help='Constraints file.')
@click.option('--training', type=click.Path(), help='Directory that `occ train` wrote.')
@click.option(
    '--demonstrations',
    metavar='DATA',
    multiple=True,
    type=click.Path(),
    help='Draw the density of this recording or table with the rules; may be repeated.',
)
@click.option(
    '-o',
    '--output',
    default='report.html',
    show_default=True,
    type=click.Path(),
    help='Page to write.',
)
@click.option('--title', help='Title of the page; default: the names of the inputs.')
@DEFINITIONS
@JSON
def report(
    paths: tuple[str, ...],
    constraints: str | None,
    training: str | None,
    demonstrations: tuple[str, ...],
    output: str,
    title: str | None,
    as_json: bool,
) -> None:
    """Write rules, judged recordings or a training as one HTML file.

    The page loads nothing from elsewhere. Recordings are judged as by `occ check`; on the page,
    other bounds can be tried.

    \b
    Example: occ report -c constraints.yaml bags/drive_7 -o drive_7.html
             occ report -c constraints.yaml --demonstrations bags/drives
             occ report --training runs/mine -o mine.html
    """
    if constraints is None and training is None:
        raise ConfigurationError(
            'got nothing to report on; allowed are -c CONSTRAINTS, with recordings or without, and '
            '--training DIRECTORY'
        )
    if constraints is None and (paths or demonstrations):
        raise ConfigurationError('got recordings without the rules that judge them (-c)')
    inputs = [*paths, *demonstrations, *([constraints] if constraints else [])]
    check_outputs({output: PAGE}, inputs)
    pages = import_needed('occ report', 'occ_constraints_pkg.report.page')
    if demonstrations:
        import_needed('occ report --demonstrations', 'matplotlib')
    checked = import_needed('occ report', 'occ_constraints_pkg.report.checked')
    title = title or named_title(paths or inputs or (str(training),))
    if constraints is None:
        trainings = import_needed('occ report --training', 'occ_constraints_pkg.report.training')
        page = trainings.training_page(title, training)
    else:
        from occ_constraints_pkg.checking.timeline import (
            BRIDGE_SECONDS,
            TIMEOUT_SECONDS,
            check_data,
        )
        from occ_constraints_pkg.rules.constraints_file import load_constraints

        loaded = load_constraints(constraints)
        timeline = None
        if paths:
            data = read_data(paths, loaded, constraints, max_lag=MAX_LAG_SECONDS, provenance=True)
            if loaded.rule_set.problem:
                warn(f'{constraints} enables no rule, so every verdict is UNKNOWN')
            timeline = check_data(data, loaded.rule_set)
        samples, sources = None, ()
        if demonstrations:
            shown = read_data(demonstrations, loaded, constraints, provenance=True)
            samples, sources = shown.values, shown.sources
        settings = {
            'timeout [s]': TIMEOUT_SECONDS,
            'bridge [s]': BRIDGE_SECONDS,
            'largest lag [s]': MAX_LAG_SECONDS,
        }
        page = checked.constraints_page(
            title,
            constraints,
            loaded,
            timeline=timeline,
            samples=samples,
            sources=sources,
            settings=settings if paths else {},
        )
        if training is not None:
            import_needed(
                'occ report --training', 'occ_constraints_pkg.report.training'
            ).add_training(page, training)
    pages.write_page(page, output)
    if as_json:
        print_json(
            {
                'output': output,
                'bytes': Path(output).stat().st_size,
                'sections': [section.title for section in page.sections],
            }
        )
    else:
        say(f'Written to {output}' + (f': {page.summary}' if page.summary else ''))


def named_title(paths: Sequence[str]) -> str:
    """Return what a page is called that is about these files or folders."""
    names = [Path(path).resolve().name for path in paths]
    return ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')
