# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ features suggest`` and ``check``."""

from __future__ import annotations

from pathlib import Path

import click

from occ_constraints_pkg.cli.common import (
    JSON,
    help_without_command,
    print_json,
    progress_bar,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import FEATURE_MAP, write_text
from occ_constraints_pkg.wording import count_of


@click.group(invoke_without_command=True)
@click.pass_context
def features(context: click.Context) -> None:
    """Suggest a feature map for a recording, or see what one yields.

    \b
    Example: occ features suggest bags/drive_1 -o my_robot.yaml
    """
    help_without_command(context)


@features.command()
@click.argument('bag', type=click.Path())
@click.option('-o', '--output', type=click.Path(), help='New file to write; default: print it.')
@JSON
def suggest(bag: str, output: str | None, as_json: bool) -> None:
    """Look through a recording and write a commented feature map.

    Each feature stands with its range, rate and share of missing values. What is not used stands
    in comments with the reason.

    \b
    Example: occ features suggest bags/drive_1 -o my_robot.yaml
    """
    from occ_constraints_pkg.rosbag.recording import Recording
    from occ_constraints_pkg.suggestion.suggest import suggest as suggest_map
    from occ_constraints_pkg.suggestion.text import statistics_document, suggestion_text

    if output and Path(output).exists():
        raise ConfigurationError(
            f'{output} exists already; allowed is a new file, for maps are edited'
        )
    with progress_bar('reading') as progress:
        suggestion = suggest_map(Recording(bag), progress=progress)
    for sentence in suggestion.warnings:
        warn(sentence)
    text = suggestion_text(suggestion)
    if output:
        write_text(output, FEATURE_MAP, text)
    if as_json:
        print_json(
            {
                'output': output,
                'map': text,
                'pace': suggestion.pace.name,
                'max_age': suggestion.max_age,
                **statistics_document(suggestion.seen),
                'not_used': [
                    {'name': item.entry['name'], 'topic': item.topic.name, 'reason': item.aside}
                    for item in suggestion.candidates
                    if item.aside
                ],
                'warnings': list(suggestion.warnings),
            }
        )
    elif output:
        say(f'{count_of(len(suggestion.seen.features), "feature")}; written to {output}')
    else:
        say_lines(text, nl=False)


@features.command()
@click.argument('bag', type=click.Path())
@click.argument('map_name', metavar='MAP')
@JSON
def check(bag: str, map_name: str, as_json: bool) -> int:
    """Show what a feature map yields on a recording.

    MAP is a YAML file, or a built-in name such as PointGoal1. Exit code 1 when a feature stays at
    one value other than 0 or a bound, when it is missing or outside its bounds in more than 5 %
    of the rows, or when time goes back from one row to the next.

    \b
    Example: occ features check bags/drive_1 my_robot.yaml
    """
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.rosbag.recording import Recording
    from occ_constraints_pkg.suggestion.statistics import map_statistics
    from occ_constraints_pkg.suggestion.text import describe_statistics, statistics_document

    feature_map = load_feature_map(map_name)
    with progress_bar('reading') as progress:
        seen = map_statistics(Recording(bag), feature_map, progress=progress)
    for sentence in seen.warnings:
        warn(sentence)
    if as_json:
        print_json(statistics_document(seen))
    else:
        pace = feature_map.pace or f'a rate of {feature_map.rate:g} Hz'
        say_lines(describe_statistics(seen, bag, pace))
    return 1 if seen.has_problem else 0
