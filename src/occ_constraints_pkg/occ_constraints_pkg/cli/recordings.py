# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands on recordings: ``occ info``, ``features``, ``record``, ``play`` and ``import``.

``record`` and ``play`` take the options of ``ros2 bag`` where the same thing exists here.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from occ_constraints_pkg.cli.common import (
    DEFINITIONS,
    JSON,
    end_tidily,
    help_without_command,
    print_json,
    progress_bar,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.completion import feature_maps
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import FEATURE_MAP, write_text
from occ_constraints_pkg.traffic.formats import FORMATS
from occ_constraints_pkg.wording import count_of


@click.command()
@click.argument('bag', type=click.Path())
@DEFINITIONS
@JSON
def info(bag: str, as_json: bool) -> None:
    """Show the topics, rates, gaps and clocks of a recording.

    And for each topic, what can be learned from: how many fields are numbers or arrays, or why it
    cannot be read. "Stamp to log" is the median time from header stamps to log times.

    \b
    Example: occ info bags/drive_1
    """
    from occ_constraints_pkg.datasets.overview import overview_of
    from occ_constraints_pkg.datasets.overview_text import describe_overview, overview_document
    from occ_constraints_pkg.rosbag.recording import Recording

    with progress_bar('reading') as progress:
        seen = overview_of(Recording(bag), progress)
    for sentence in seen.warnings:
        warn(sentence)
    if as_json:
        print_json(overview_document(seen))
    else:
        say_lines(describe_overview(seen))


@click.group(invoke_without_command=True)
@click.pass_context
def features(context: click.Context) -> None:
    """Suggest a feature map for a recording, or check what one extracts.

    \b
    Example: occ features suggest bags/drive_1 -o my_robot.yaml
    """
    help_without_command(context)


@features.command()
@click.argument('bags', metavar='BAG...', nargs=-1, required=True, type=click.Path())
@click.option(
    '-o',
    '--output',
    type=click.Path(),
    help='New file to write; default: print it. With several robots, one file for each, whose '
    'name ends in that of the robot.',
)
@click.option('--robot', help='Namespace of the robot to suggest a map for; default: each.')
@DEFINITIONS
@JSON
def suggest(bags: tuple[str, ...], output: str | None, robot: str | None, as_json: bool) -> int:
    """Inspect recordings of a robot and write a commented feature map.

    Each feature is listed with its range, rate and share of missing values. What is not used is
    commented out, with the reason. Several recordings are used together: what one of them shows
    and the others do not is told. Exit code 1 when no feature can be used.

    \b
    Example: occ features suggest bags/drive_1 -o my_robot.yaml
             occ features suggest bags/drive_* -o my_robot.yaml
    """
    from occ_constraints_pkg.rosbag.recording import Recording
    from occ_constraints_pkg.suggestion.suggest import suggest_each
    from occ_constraints_pkg.suggestion.text import suggestion_document, suggestion_text

    _refuse_existing([output] if output else [])
    with progress_bar('reading') as progress:
        suggestions = suggest_each(*map(Recording, bags), progress=progress)
    names = [item.robot for item in suggestions]
    if robot is not None:
        suggestions = [item for item in suggestions if item.robot == robot.strip('/')]
        if not suggestions:
            found = f'its robots are {", ".join(names)}' if names != [''] else 'it has one robot'
            raise ConfigurationError(f'{", ".join(bags)}: there is no robot {robot!r}; {found}')
    outputs = [output] * len(suggestions)
    if output and len(suggestions) > 1:
        stem, ending = Path(output).with_suffix(''), Path(output).suffix
        outputs = [f'{stem}_{item.robot.replace("/", "_")}{ending}' for item in suggestions]
        _refuse_existing(outputs)
    for place, suggestion in enumerate(suggestions):
        for sentence in suggestion.warnings:
            warn(sentence)
        text = suggestion_text(suggestion)
        if outputs[place]:
            write_text(outputs[place], FEATURE_MAP, text)
        if not as_json and outputs[place]:
            count = count_of(len(suggestion.seen.features), 'feature')
            say(f'{count}; written to {outputs[place]}')
        elif not as_json and not place:
            say_lines(text, nl=False)
        if not suggestion.used:
            warn('no feature can be used as it is; the map says why')
    if len(suggestions) > 1 and not output:
        warn(
            f'there are {len(names)} robots, {", ".join(names)}; the map shown is of {names[0]}. '
            'Use -o for one map each, or --robot'
        )
    if as_json:
        documents = [
            suggestion_document(suggestion, target)
            for suggestion, target in zip(suggestions, outputs, strict=True)
        ]
        print_json(documents[0] | ({'robots': documents} if len(documents) > 1 else {}))
    return 0 if all(item.used for item in suggestions) else 1


def _refuse_existing(paths: Sequence[str | None]) -> None:
    for path in paths:
        if path and Path(path).exists():
            raise ConfigurationError(
                f'{path} exists already; allowed is a new file, for maps are edited'
            )


@features.command('check')
@click.argument('bag', type=click.Path())
@click.argument('map_name', metavar='MAP', shell_complete=feature_maps)
@DEFINITIONS
@JSON
def check_map(bag: str, map_name: str, as_json: bool) -> int:
    """Show what a feature map extracts from a recording.

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


class _BagCommand(click.Command):
    """Reads options as ``ros2 bag`` does: ``--topics a b`` is a list, without repeating the option.

    Options of ``ros2 bag`` that have no counterpart here are answered with a hint.
    """

    lists = frozenset({'--topics', '--exclude-topics', '--remap', '-m'})
    # Other names, of earlier versions and of `ros2 bag`; each takes one value at most.
    others: Mapping[str, str] = {
        '--topic': '--topics',
        '--exclude-topic': '--exclude-topics',
        '--all-topics': '--all',
        '--compression-format': '--compression',
    }
    hints: Mapping[str, str] = {
        '--services': 'services are neither recorded nor played',
        '--all-services': 'services are not recorded',
        '--exclude-services': 'services are neither recorded nor played',
        '--topic-types': 'topics are chosen by name or --regex, not by type',
        '--exclude-topic-types': 'topics are excluded by name or --exclude-regex, not by type',
        '--include-hidden-topics': 'hidden topics are recorded when --topics or --regex names them',
        '--include-unpublished-topics': 'a topic is recorded once it has a publisher',
        '--compression-mode': 'chunks of the bag are compressed; see --compression',
        '--max-cache-size': 'messages are written to the file as they come',
        '--snapshot-mode': 'every message is written',
        '-p': 'new topics are found within a second, and recording starts at once',
        '--polling-interval': 'new topics are found within a second',
        '--no-discovery': 'name the topics to record only those',
        '--qos-profile-overrides-path': 'QoS is that of the publishers, or as recorded',
        '--start-paused': 'recording starts at once',
        '--storage-config-file': 'see --compression',
        '--storage-preset-profile': 'see --compression',
        '--playback-duration': 'stop the player when it is enough',
        '--playback-until-sec': 'stop the player when it is enough',
        '--playback-until-nsec': 'stop the player when it is enough',
        '--read-ahead-queue-size': 'messages are read as they are played',
        '-d': 'see --start-paused and --wait-for-subscribers',
        '--delay': 'see --start-paused and --wait-for-subscribers',
        '--wait-for-all-acked': 'the last messages are always waited for',
        '--clock-topics': 'see --clock, a rate in Hz',
        '--clock-topics-all': 'see --clock, a rate in Hz',
    }

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, self._repeated(args))
        except click.NoSuchOption as error:
            hint = self.hints.get(error.option_name)
            if hint is None:
                raise
            raise click.UsageError(
                f'{ctx.command_path} has no {error.option_name}: {hint}', ctx
            ) from error

    def _repeated(self, args: Sequence[str]) -> list[str]:
        """Return the arguments with a list's option before each of its values."""
        result: list[str] = []
        option, is_first = '', True
        for argument in args:
            if argument.startswith('-'):
                option, is_first = argument if argument in self.lists else '', True
                name, equals, value = argument.partition('=')
                argument = self.others.get(name, name) + equals + value
            elif option:
                result += [] if is_first else [option]
                is_first = False
            result.append(argument)
        return result


_CHOICE = (
    click.option('-e', '--regex', default='', help='Pattern of topics to add.'),
    click.option(
        '--exclude-topics', multiple=True, metavar='TOPIC...', help='Topics to leave out.'
    ),
    click.option(
        *('-x', '--exclude-regex'),
        default='',
        help='Pattern of topics to leave out.',
    ),
    click.option('--node-name', hidden=True),
    click.option('--log-level', hidden=True),
    # There are none; who switches them off has what they want.
    click.option('--disable-keyboard-controls', is_flag=True, hidden=True, expose_value=False),
)


def _bag_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that recorder and player share."""
    for option in reversed(_CHOICE):
        command = option(command)
    return command


@click.command(cls=_BagCommand)
@click.argument('topics', nargs=-1)
@click.option('-a', '--all', 'everything', is_flag=True, help='Record all topics; the default.')
@click.option(
    '--topics',
    'named',
    multiple=True,
    metavar='TOPIC...',
    help='The same as the arguments.',
)
@click.option(
    '-o',
    '--output',
    type=click.Path(),
    help='Directory of the new bag; default: rosbag2_ and the time.',
)
@_bag_options
@click.option('--compression', default='zstd', show_default=True, help='zstd, lz4 or none.')
@click.option(
    '-b',
    '--max-bag-size',
    default=0,
    show_default=True,
    help='Bytes after which a new file is begun; 0: never.',
)
@click.option(
    '-d',
    '--max-bag-duration',
    default=0.0,
    show_default=True,
    help='Seconds after which a new file is begun; 0: never.',
)
@click.option(
    '--duration',
    default=0.0,
    show_default=True,
    help='Seconds from the first message after which recording ends; 0: never.',
)
@click.option('--use-sim-time', is_flag=True, help='Stamp messages with the time of /clock.')
@click.option('-s', '--storage', type=click.Choice(['mcap']), hidden=True, expose_value=False)
@click.option(
    *('-f', '--serialization-format'),
    type=click.Choice(['cdr']),
    hidden=True,
    expose_value=False,
)
def record(
    topics: tuple[str, ...],
    named: tuple[str, ...],
    everything: bool,
    output: str | None,
    **options: Any,
) -> int:
    """Record topics (default: all) to a bag until Ctrl-C, or for a time.

    \b
    Example: occ record odom scan cmd_vel -o bags/drive_7
             occ record --all --exclude-topics /camera/image -o bags/drive_8
    """
    from occ_constraints_pkg.nodes import run

    chosen = (*topics, *named)
    if everything and chosen:
        raise click.UsageError(f'got both --all and the topics {", ".join(chosen)}')
    output = output or time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
    return run('recorder', _ros_arguments(topics=chosen, output=output, **options))


@click.command(cls=_BagCommand)
@click.argument('bag', type=click.Path())
@click.option('--topics', multiple=True, metavar='TOPIC...', help='Play only these.')
@_bag_options
@click.option(
    '-m', '--remap', multiple=True, metavar='FROM:=TO...', help='Publish under other names.'
)
@click.option('-r', '--rate', default=1.0, show_default=True, help='Speed, 1.0: as recorded.')
@click.option('-l', '--loop', is_flag=True, help='Start again at the end.')
@click.option(
    '--start-offset', default=0.0, show_default=True, help='Seconds of the recording to leave out.'
)
@click.option(
    '--clock',
    type=float,
    is_flag=False,
    flag_value=40.0,
    default=0.0,
    help='Publish /clock as many times per second; without a number 40 times.',
)
@click.option('-p', '--start-paused', is_flag=True, help='Wait for the service ~/resume.')
@click.option(
    '--wait-for-subscribers',
    default=0,
    show_default=True,
    help='Subscriptions over all topics before the start.',
)
@click.option(
    *('-s', '--storage'), type=click.Choice(['mcap', 'sqlite3']), hidden=True, expose_value=False
)
def play(**options: Any) -> int:
    """Publish the messages of a recording.

    \b
    Example: occ play bags/drive_7 --rate 2 --clock
             occ play bags/drive_7 --topics /odom /scan --remap /scan:=/front_scan
    """
    from occ_constraints_pkg.nodes import run

    for rule in options['remap']:
        if ':=' not in rule.strip(':='):
            raise click.UsageError(f'--remap got {rule!r}; allowed is FROM:=TO')
    return run('player', _ros_arguments(**options))


def _ros_arguments(
    *, node_name: str | None, log_level: str | None, remap: Sequence[str] = (), **parameters: Any
) -> list[str]:
    """Return options as ROS arguments; empty parameters are left to their defaults."""
    arguments = ['--ros-args']
    for name, value in parameters.items():
        if value not in ('', ()):
            arguments += ['-p', f'{name}:={json.dumps(value)}']
    for rule in (*remap, *([f'__node:={node_name}'] if node_name else [])):
        arguments += ['-r', rule]
    return arguments + (['--log-level', log_level] if log_level else [])


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
    """Convert recorded road traffic to a bag.

    There is one episode for each vehicle. The features are those of the built-in map highway, or,
    of a recording that does not have all of them, of highway_road or highway_following.

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
        values = asdict(result)
        # The key is older than the word.
        values['drives'] = values.pop('trajectories')
        print_json({'output': output, 'format': format_name, **values})
        return
    say(
        f'{output}: {count_of(result.trajectories, "drive")}, {result.rows} rows, '
        f'{result.seconds:.1f} s; features {", ".join(result.features)}'
    )
    say(f'Learn from it with: occ learn {output} -m {result.feature_map}')
