# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ import``: recordings of road traffic as bags."""

from __future__ import annotations

from dataclasses import asdict

import click

from occ_constraints_pkg.cli.common import JSON, end_tidily, print_json, progress_bar, say, warn
from occ_constraints_pkg.traffic.formats import FORMATS


@click.command(
    'import',
    epilog=''.join(f'\b\n{name}: {item.input}\n\n' for name, item in FORMATS.items()),
)
@click.argument('format_name', metavar='FORMAT', type=click.Choice(list(FORMATS)))
@click.argument('path', metavar='INPUT', type=click.Path())
@click.option('-o', '--output', required=True, type=click.Path(), help='Directory of the new bag.')
@click.option(
    '--keep-gaps',
    is_flag=True,
    help='Write gaps between vehicles even if these were not on the road at the same time.',
)
@JSON
def import_(format_name: str, path: str, output: str, keep_gaps: bool, as_json: bool) -> None:
    """Write recorded road traffic to a bag, with one episode for each vehicle.

    The features are those of the built-in map highway, or, of a recording that does not have all
    of them, of highway_road or highway_following.

    \b
    Example: occ import commonroad USA_US101-11_4_T-1.xml -o bags/us101_11
    """
    from occ_constraints_pkg.traffic.convert import import_trajectories

    end_tidily()
    with progress_bar('importing') as progress:
        result = import_trajectories(
            format_name, path, output, keep_gaps=keep_gaps, progress=progress
        )
    for sentence in result.warnings:
        warn(sentence)
    if as_json:
        print_json({'output': output, 'format': format_name, **asdict(result)})
        return
    drives = '1 drive' if result.trajectories == 1 else f'{result.trajectories} drives'
    say(
        f'{output}: {drives}, {result.rows} rows, {result.seconds:.1f} s; '
        f'features {", ".join(result.features)}'
    )
    say(f'Learn from it with: occ learn {output} -m {result.feature_map}')
