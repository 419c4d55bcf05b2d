# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The commands of ``occ experiment`` that read recordings: each compares with what was recorded."""

from __future__ import annotations

import json
from pathlib import Path

import click

from occ_constraints_pkg.cli.common import JSON, print_json, progress_bar, say_lines, tell
from occ_constraints_pkg.errors import import_needed
from occ_constraints_pkg.files import RESULTS, TABLE, write_text


@click.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of the recordings; default: robots in OCC_TEST_DATA or in ../shared/data.',
)
@click.option('--kind', 'kinds', multiple=True, help='Only this kind of robot; may be repeated.')
@JSON
def robots(output: str, data: str | None, kinds: tuple[str, ...], as_json: bool) -> None:
    """Learn from safe recordings of robots, and judge those held back and those with contact.

    Recordings are named safe_KIND_NAME, contact_KIND_NAME or bump_KIND_NAME. Writes robots.json,
    robots.md and the feature maps.

    \b
    Example: occ experiment robots --data recordings --kind tb3 -o results
    """
    from experiments.robots import run_robots

    with progress_bar('kinds') as progress:
        result = run_robots(
            Path(output),
            folder=Path(data) if data else None,
            kinds=kinds,
            progress=progress,
        )
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'robots.md').read_text(encoding='utf-8'))


@click.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of ngsim_us101 and ngsim_i80; default: driving in OCC_TEST_DATA or in '
    '../shared/data.',
)
@click.option('--seeds', default=10, type=click.IntRange(min=1), show_default=True)
@JSON
def ngsim(output: str, data: str | None, seeds: int, as_json: bool) -> None:
    """Learn from real drivers on highways, judge others; writes ngsim.json and ngsim.md.

    \b
    Example: occ experiment ngsim -o results
    """
    from experiments.ngsim import run_ngsim

    with progress_bar('learning') as progress:
        result = run_ngsim(
            Path(output), folder=Path(data) if data else None, seeds=seeds, progress=progress
        )
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'ngsim.md').read_text(encoding='utf-8'))


@click.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--episodes', default=50, type=click.IntRange(min=2), show_default=True, help='For the means.'
)
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of the records; default: safety_gym_traces in OCC_TEST_DATA or ../shared/data.',
)
@JSON
def worlds(output: str, episodes: int, data: str | None, as_json: bool) -> None:
    """Compare the Safety-Gym tasks with safety-gymnasium; writes worlds.json and worlds.md.

    \b
    Example: occ experiment worlds -o results
    """
    module = import_needed('occ experiment', 'experiments.worlds')
    with progress_bar('comparing') as progress:
        result = module.run_worlds(
            episodes=episodes, folder=Path(data) if data else None, progress=progress
        )
    for reason in result['skipped'].values():
        tell(f'skipped: {reason}')
    table = module.markdown(result)
    document = json.dumps(result, indent=2) + '\n'
    for name, kind, text in (('worlds.json', RESULTS, document), ('worlds.md', TABLE, table)):
        write_text(Path(output) / name, kind, text)
    if as_json:
        print_json(result)
        return
    say_lines(table)


@click.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of the recordings; default: robots in OCC_TEST_DATA or in ../shared/data.',
)
@click.option(
    '--bags', default='bags', show_default=True, type=click.Path(), help="This project's bags."
)
@click.option(
    '--set', 'sets', multiple=True, help='Only this kind of robot, or world; may be repeated.'
)
@JSON
def warnings(
    output: str, data: str | None, bags: str, sets: tuple[str, ...], as_json: bool
) -> None:
    """Measure how early violations are warned of, and how often in vain.

    On recordings as of `occ experiment robots`, and on those of this project. Writes warnings.json
    and warnings.md.

    \b
    Example: occ experiment warnings -o results
    """
    from experiments.warnings import run_warnings

    with progress_bar('sets') as progress:
        result = run_warnings(
            Path(output),
            folder=Path(data) if data else None,
            bags=Path(bags),
            names=sets,
            progress=progress,
        )
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'warnings.md').read_text(encoding='utf-8'))


@click.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of the recordings; default: robots in OCC_TEST_DATA or in ../shared/data.',
)
@JSON
def debouncing(output: str, data: str | None, as_json: bool) -> None:
    """Compare ways of debouncing verdicts before the gate stops a robot.

    On recordings as of `occ experiment robots`. Writes debouncing.json and debouncing.md.

    \b
    Example: occ experiment debouncing -o results
    """
    from experiments.debouncing import run_debouncing

    result = run_debouncing(Path(output), folder=Path(data) if data else None)
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'debouncing.md').read_text(encoding='utf-8'))
