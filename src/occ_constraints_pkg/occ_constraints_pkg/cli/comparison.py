# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ compare``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from occ_constraints_pkg.cli.common import (
    DEFINITIONS,
    JSON,
    Seconds,
    print_json,
    progress_bar,
    refuse_options,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.judging import BRIDGE, MAX_LAG, TIMEOUT
from occ_constraints_pkg.cli.report import HTML, named_title
from occ_constraints_pkg.errors import ConfigurationError, OccError, import_needed
from occ_constraints_pkg.files import PAGE, check_outputs

if TYPE_CHECKING:
    from occ_constraints_pkg.checking.comparison import Side
    from occ_constraints_pkg.rules.constraints_file import Constraints


@click.command()
@click.argument('first', metavar='A', type=click.Path())
@click.argument('second', metavar='B', type=click.Path())
@click.argument('paths', metavar='[DATA...]', nargs=-1, type=click.Path())
@DEFINITIONS
@click.option(
    '-c',
    '--constraints',
    type=click.Path(),
    help='Constraints file that judges A and B, which are then recordings.',
)
@click.option('--by-order', is_flag=True, help='With -c: pair recordings by order, not by name.')
@click.option(
    '--tolerance',
    type=Seconds(above_zero=False),
    help='Lengths that differ by no more seconds count as the same, and violations no further '
    'apart as of one moment; default: 0.5, and 0 rows of tables.',
)
@click.option(
    '--allow-shorter',
    is_flag=True,
    help='A recording may end earlier than its counterpart, as that of a robot that got faster.',
)
@click.option(
    '--clock',
    type=click.Choice(['auto', 'stamps', 'start']),
    default='auto',
    show_default=True,
    help="With -c: match moments by header stamps, or by the time since each recording's start; "
    'auto: by stamps where they overlap.',
)
@HTML
@TIMEOUT
@MAX_LAG
@BRIDGE
@JSON
def compare(
    first: str,
    second: str,
    paths: tuple[str, ...],
    constraints: str | None,
    by_order: bool,
    tolerance: float | None,
    allow_shorter: bool,
    clock: str,
    html: str | None,
    timeout: float,
    max_lag: float,
    bridge: float,
    as_json: bool,
) -> int:
    """Tell whether violations got more, longer or deeper from A to B.

    With -c, A and B are recordings before and after a change of the robot: each a recording, a
    table, a manifest, or a folder of them. Without it, they are two constraints files, which judge
    the same DATA. Time that cannot be judged any more is worse, too. Exit code 1 when anything is
    worse or a recording is missing on one side.

    \b
    Example: occ compare -c constraints.yaml before/ after/
             occ compare old.yaml new.yaml bags/drive_*
    """
    from occ_constraints_pkg.checking.comparison import compare_sides
    from occ_constraints_pkg.checking.comparison_text import (
        comparison_document,
        describe_comparison,
    )
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.rules.matching import matched_rules

    if html is not None:
        check_outputs(
            {html: PAGE}, [first, second, *paths, *([constraints] if constraints else [])]
        )
    pages = html and import_needed('occ compare --html', 'occ_constraints_pkg.report.comparison')
    limits = {'timeout': timeout, 'max_lag': max_lag, 'bridge': bridge}
    if constraints is not None:
        if paths:
            raise ConfigurationError(
                f'got -c and {len(paths) + 2} recordings; allowed are two: a recording, or a '
                'folder or manifest of several, before and after'
            )
        loaded = load_constraints(constraints)
        sides = [_side(path, [path], loaded, constraints, **limits) for path in (first, second)]
        rules = [(place, place) for place in range(len(loaded.rules))]
    else:
        refuse_options(
            ('by_order', 'clock'), 'has no effect without -c, for both files judge the same'
        )
        if not paths:
            raise ConfigurationError(
                f'got {first} and {second} only; allowed are -c CONSTRAINTS with two recordings '
                'or folders, or two constraints files and the recordings that both judge'
            )
        files = [_load(path) for path in (first, second)]
        sides = [
            _side(path, paths, loaded, path, **limits)
            for path, loaded in zip((first, second), files, strict=True)
        ]
        rules = matched_rules(*files)
    result = compare_sides(
        *sides,
        rules,
        same_recordings=constraints is None,
        by_order=by_order,
        tolerance=tolerance,
        allow_shorter=allow_shorter,
        clock=clock,
    )
    if pages:
        pages.write_comparison_page(
            html, f'{named_title([second])} against {named_title([first])}', result
        )
    if as_json:
        print_json(comparison_document(result))
    else:
        say_lines(describe_comparison(result))
    return 1 if result.is_worse else 0


def _load(path: str) -> Constraints:
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    try:
        return load_constraints(path)
    except OccError as error:
        raise ConfigurationError(
            f'{error}; without -c, the first two arguments are constraints files'
        ) from error


def _side(
    name: str,
    paths: Sequence[str],
    loaded: Constraints,
    where: str,
    *,
    timeout: float,
    max_lag: float,
    bridge: float,
) -> Side:
    """Read one side and judge it."""
    from occ_constraints_pkg.checking.comparison import Side
    from occ_constraints_pkg.checking.timeline import check_data
    from occ_constraints_pkg.datasets.folders import named_sources
    from occ_constraints_pkg.datasets.reading import read_for_rules

    if loaded.rule_set.problem:
        warn(f'{where} enables no rule, so every verdict is UNKNOWN')
    found = [source for path in paths for source in named_sources(path)]
    with progress_bar('reading') as progress:
        data = read_for_rules(
            [source for _, source in found], loaded, where, max_lag=max_lag, progress=progress
        )
    for sentence in data.warnings:
        warn(sentence)
    timeline = check_data(data, loaded.rule_set, timeout=timeout, bridge=bridge)
    return Side(name, timeline, loaded.rule_set, tuple(title for title, _ in found))
