# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command line of the experiments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from occ_constraints_pkg.cli.common import (
    AT_LEAST_0,
    AT_LEAST_1,
    JSON,
    cost_limit_option,
    help_without_command,
    print_json,
    progress_bar,
    report,
    say_lines,
    seed_option,
)
from occ_constraints_pkg.errors import import_needed
from occ_constraints_pkg.stopping import stop_request

_REPEATED = 'May be repeated.'


@click.group(invoke_without_command=True, context_settings={'help_option_names': ['-h', '--help']})
@click.pass_context
def cli(context: click.Context) -> None:
    """Repeat the paper's and the article's experiments, from the root of a clone.

    Each writes NAME.json and NAME.md to its directory.

    \b
    Example: python -m experiments article --set Iris
    """
    help_without_command(context)


def _writes(default: str = 'results') -> Callable[..., Any]:
    """Add the options about output to a command."""
    output = click.option(
        *('-o', '--output'), default=default, show_default=True, type=click.Path(path_type=Path)
    )
    return lambda command: output(JSON(command))


def _reads(name: str) -> Callable[..., Any]:
    """Add the option that names the folder of an experiment's data."""
    return click.option(
        '--data',
        'folder',
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help=f'Folder of the data; default: {name} in OCC_TEST_DATA or in ../shared/data.',
    )


def _trains(steps: int) -> Callable[..., Any]:
    """Add the options of trainings with learned rules, by default of so many steps each."""
    options = (
        cost_limit_option('demonstrations'),
        click.option(
            '--steps',
            default=steps,
            type=AT_LEAST_1,
            show_default=True,
            help='Robot steps per training.',
        ),
        click.option('--seeds', default=3, type=AT_LEAST_1, show_default=True, help='Trainings.'),
    )

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _run(name: str, label: str, output: Path, as_json: bool, **given: Any) -> None:
    """Run an experiment and print what it found.

    Args:
        name: of its module, whose function ``run_NAME`` is called.
        label: of the progress bar.
        output: directory of the results.
        as_json: print the document instead of the page.
        **given: other arguments of the function.
    """
    run = getattr(_module(name), f'run_{name}')
    with progress_bar(label) as progress:
        result = run(output, progress=progress, **given)
    for reason in result.get('skipped', {}).values():
        report(f'skipped: {reason}')
    if as_json:
        print_json(result)
    elif result.get('lines', True):
        say_lines((output / f'{name}.md').read_text(encoding='utf-8'))


def _module(name: str) -> Any:
    return import_needed(f'the experiment {name}', f'experiments.{name}')


@cli.command()
@_reads('oneclass')
@click.option('--splits', default=20, show_default=True, help='Random splits per line.')
@seed_option()
@click.option('--set', 'names', multiple=True, help='Run only this data set; may be repeated.')
@_writes()
def article(**given: Any) -> None:
    """Repeat the benchmark of the OC-tree article.

    A stopped run continues where it was. Needs scikit-learn.

    \b
    Example: python -m experiments article --set Iris -o results
    """
    _run('article', 'lines', **given)


@cli.command()
@click.option(
    '--samples', default=100_000, show_default=True, help='Most samples to learn from, per line.'
)
@click.option('--draws', default=5, show_default=True, help='Random draws per line.')
@seed_option()
@click.option('--world', 'names', multiple=True, help='Run only this world; may be repeated.')
@_writes()
def truth(**given: Any) -> None:
    """Compare learned rules with the true cost of a world.

    The demonstrations are an expert's. Writes truth.png as well; a stopped run continues where it
    was.

    \b
    Example: python -m experiments truth --world PointGoal1 -o results
    """
    _run('truth', 'lines', **given)


@cli.command()
@click.option('--world', 'names', multiple=True, help='Run only this world; may be repeated.')
@click.option(
    '--demonstrations', default=20, type=click.IntRange(min=10), show_default=True, help='Episodes.'
)
@_writes()
def contamination(**given: Any) -> None:
    """Compare learned rules with the true cost where some demonstrations are costly.

    Single samples, passes through hazards or whole episodes are. A stopped run continues where it
    was.

    \b
    Example: python -m experiments contamination --world PointGoal1 -o results
    """
    _run('contamination', 'lines', **given)


@cli.command()
@click.option('--world', default='PointGoal1', show_default=True)
@click.option(
    '--demonstrations', default=50, type=click.IntRange(min=10), show_default=True, help='Episodes.'
)
@click.option(
    '--episodes', default=400, type=click.IntRange(min=100), show_default=True, help='In all.'
)
@click.option('--draws', default=100, type=click.IntRange(min=2), show_default=True)
@seed_option()
@_writes()
def alarms(output: Path, as_json: bool, **given: Any) -> None:
    """Measure the false-alarm guarantee on fresh episodes.

    An expert's episodes are divided at random, draw by draw, into demonstrations, calibration
    episodes and fresh ones.

    \b
    Example: python -m experiments alarms -o results
    """
    settings = _module('alarms').AlarmSettings(**given)
    _run('alarms', 'draws', output, as_json, settings=settings)


@cli.command()
@click.option('--source', default='PointGoal1', show_default=True, help='World of the expert.')
@click.option('--target', help='World of the trainings; default: the same.')
@click.option(
    '--expert', default='expert', show_default=True, help='Policy file, or the name of a driver.'
)
@click.option('--demonstrations', default=50, show_default=True, help='Episodes of the expert.')
@_trains(4_000_000)
@click.option('--first-seed', default=0, type=AT_LEAST_0, show_default=True)
@_writes('transfer')
def transfer(output: Path, as_json: bool, **given: Any) -> None:
    """Train with rules learned from an expert, and compare.

    A stopped run continues where it was.

    \b
    Example: python -m experiments transfer --expert runs/expert/policy.npz -o results/transfer
    """
    from occ_constraints_pkg.agents.drivers import check_driver
    from occ_constraints_pkg.worlds.registry import check_world

    given['target'] = given['target'] or given['source']
    check_world(given['target'])
    check_driver(given['source'], given['expert'])
    settings = _module('transfer').TransferSettings(**given)
    _run('transfer', 'training', output, as_json, settings=settings)


@cli.command()
@click.option(
    '--world', 'worlds', multiple=True, default=('PointGoal1',), show_default=True, help=_REPEATED
)
@click.option(
    '--cost',
    'costs',
    multiple=True,
    type=click.Choice(['true', 'rules']),
    default=('true',),
    show_default=True,
    help=f"That of the world, or rules of the world's expert. {_REPEATED}",
)
@click.option(
    '--limit',
    'limits',
    multiple=True,
    type=click.FloatRange(min=0),
    default=(25.0,),
    show_default=True,
    help=_REPEATED,
)
@click.option('--steps', default=4_000_000, type=AT_LEAST_1, show_default=True)
@click.option('--first-seed', default=0, type=AT_LEAST_0, show_default=True)
@click.option('--seeds', default=5, type=AT_LEAST_1, show_default=True, help='Trainings.')
@click.option('--processes', default=1, type=AT_LEAST_1, show_default=True)
@_writes()
def learner(output: Path, as_json: bool, first_seed: int, seeds: int, **given: Any) -> None:
    """Measure how soon policies are within their cost limit.

    Judges them with mean and with sampled actions, along the way and at the end, and writes
    learner.png as well. A stopped run continues where it was.

    \b
    Example: python -m experiments learner --steps 2000000 --processes 2 -o results
    """
    from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
    from occ_constraints_pkg.worlds.registry import check_world

    for world in given['worlds']:
        check_world(world)
    module = _module('learner')
    PPOLagrangianConfig().check_steps('steps', given['steps'], module.ROBOTS)
    _run(
        *('learner', 'trainings', output, as_json),
        seeds=range(first_seed, first_seed + seeds),
        **given,
    )


@cli.command()
@click.option(
    '--set',
    'sets',
    multiple=True,
    type=click.Choice(['restricted', 'full']),
    help='Only this set of scenarios; may be repeated.',
)
@click.option('--rules', type=click.Path(), help='Constraints file; default: learn from traffic.')
@click.option(
    '--lasting/--plain',
    default=True,
    show_default=True,
    help='Count a violation that ends an episode to the end of its 40 s, or once.',
)
@click.option(
    '--agent',
    'agents',
    multiple=True,
    type=click.Choice(['RL', 'RL with engineered reward', 'ours']),
    help='Only this agent; may be repeated.',
)
@_trains(600_000)
@_writes('highway')
def highway(output: Path, as_json: bool, **given: Any) -> None:
    """Train on a highway with and without rules of its traffic.

    Writes highway.png, and trajectories as highway_drives.png and .gif, as well. A stopped run
    continues where it was.

    \b
    Example: python -m experiments highway --set restricted -o results/highway
    """
    chosen = {name: value for name, value in given.items() if value != ()}
    settings = _module('highway').HighwaySettings(**chosen)
    with stop_request.listening():
        _run(
            *('highway', 'training', output, as_json),
            settings=settings,
            is_stopped=lambda: stop_request.made,
        )
    if stop_request.made:
        # All is saved; reported and ended as any other stopped command.
        raise KeyboardInterrupt


@cli.command()
@click.argument('names', metavar='[NAME]...', nargs=-1)
@click.option('--quick', is_flag=True, help='Everything in two minutes; numbers mean nothing.')
@click.option('--status', is_flag=True, help='Tell how far each experiment is, and run nothing.')
@click.option('--tables', is_flag=True, help='Make tables and pictures anew, and run nothing.')
@click.option(
    '--workers', default=0, type=AT_LEAST_0, help='Runs at a time; default: one per core.'
)
@click.option('--seeds', type=AT_LEAST_1, help='Only so many of the first seeds; default: all.')
@click.option(
    '--trainings/--no-trainings', default=True, help='Leave out trainings and what needs them.'
)
@click.option(
    *('-o', '--output'),
    type=click.Path(file_okay=False, path_type=Path),
    help='Folder of the store and of pictures.  [default: docs/results/paper]',
)
@click.option(
    '--workspace',
    type=click.Path(file_okay=False, path_type=Path),
    help='Folder for policies, rules and checkpoints.  [default: runs/paper]',
)
@JSON
def paper(names: tuple[str, ...], as_json: bool, **given: Any) -> None:
    """Reproduce the paper: simple_nav, safety_gym, transfer, depth, highway, pruning.

    Runs what the store of results lacks, several at a time; whatever stops it, the same command
    goes on. Then writes tables into docs/results.md, and pictures.

    \b
    Example: python -m experiments paper simple_nav
             python -m experiments paper --status
    """
    with stop_request.listening():
        result = _module('paper.command').run_paper(names, report=report, **given)
    if as_json:
        print_json(result)
    else:
        say_lines(result['text'])
    if stop_request.made:
        # All is saved; reported and ended as any other stopped command.
        raise KeyboardInterrupt
    if result['failed']:
        raise SystemExit(1)


@cli.command('any_robot')
@click.option('--kind', 'kinds', multiple=True, help='Only this kind of robot; may be repeated.')
@click.option(
    '--seconds',
    multiple=True,
    default=(40.0, 120.0),
    show_default=True,
    type=click.FloatRange(20.0, 600.0),
    help=f'Length of the drives. {_REPEATED}',
)
@_writes()
def any_robot(**given: Any) -> None:
    """Learn from one drive of each of many kinds of robots; judge the next, and faults.

    The drives are synthetic. Maps are used as suggested, and the learner is the default one.

    \b
    Example: python -m experiments any_robot --kind arm --kind boat -o results
    """
    _run('any_robot', 'kinds', **given)


@cli.command()
@click.argument('folder', type=click.Path(exists=True, file_okay=False, path_type=Path))
def redraw(folder: Path) -> None:
    """Draw the pictures of results in FOLDER anew, and run nothing.

    Of the experiments highway, learner and truth; those of the paper have paper --tables.

    \b
    Example: python -m experiments redraw docs/results
    """
    for path in _module('redraw').redraw(folder):
        say_lines(f'Written to {path}')


@cli.command()
@_reads('robots')
@click.option('--kind', 'kinds', multiple=True, help='Only this kind of robot; may be repeated.')
@_writes()
def robots(**given: Any) -> None:
    """Judge recordings of robots, held back or with contact.

    The rules are learned from safe recordings. Recordings are named safe_KIND_NAME,
    contact_KIND_NAME or bump_KIND_NAME. Writes the feature maps as well.

    \b
    Example: python -m experiments robots --data recordings --kind tb3 -o results
    """
    _run('robots', 'kinds', **given)


@cli.command()
@_reads('robots')
@click.option(
    '--bags',
    default='bags',
    show_default=True,
    type=click.Path(path_type=Path),
    help="This repository's bags.",
)
@click.option(
    '--set', 'names', multiple=True, help='Only this kind of robot, or world; may be repeated.'
)
@_writes()
def warnings(**given: Any) -> None:
    """Measure how early, and how often falsely, warnings come.

    On recordings as of the experiment robots, and on those of this repository.

    \b
    Example: python -m experiments warnings -o results
    """
    _run('warnings', 'sets', **given)


@cli.command()
@_reads('robots')
@_writes()
def debouncing(**given: Any) -> None:
    """Compare ways to debounce verdicts before the gate stops.

    On recordings as of the experiment robots.

    \b
    Example: python -m experiments debouncing -o results
    """
    _run('debouncing', 'candidates', **given)


@cli.command()
@_reads('driving')
@click.option('--seeds', default=10, type=AT_LEAST_1, show_default=True)
@_writes()
def ngsim(**given: Any) -> None:
    """Learn from real drivers on highways and judge others.

    The data are folders ngsim_us101 and ngsim_i80.

    \b
    Example: python -m experiments ngsim -o results
    """
    _run('ngsim', 'learning', **given)


@cli.command()
@click.option('--problem', 'problems', multiple=True, help='Only this problem; may be repeated.')
@click.option(
    '--size',
    'sizes',
    multiple=True,
    type=click.Choice(['1e3', '1e4', '1e5']),
    help='Only so many samples; may be repeated.',
)
@click.option(
    '--seed',
    'seeds',
    multiple=True,
    type=AT_LEAST_0,
    default=(1, 2, 3, 4, 5),
    show_default=True,
    help=_REPEATED,
)
@click.option('--method', 'methods', multiple=True, help='Only this learner; may be repeated.')
@click.option('--processes', default=1, type=AT_LEAST_1, show_default=True)
@_writes()
def planted(**given: Any) -> None:
    """Measure how well known conditional rules are found.

    Beside other learners, and where there is nothing to find. A stopped run continues where it
    was. The rivals need scikit-learn.

    \b
    Example: python -m experiments planted --problem A3 --size 1e4 -o results
    """
    _run('planted', 'lines', **given)


@cli.command()
@_reads('safety_gym_traces')
@click.option(
    '--episodes', default=50, type=click.IntRange(min=2), show_default=True, help='For the means.'
)
@_writes()
def worlds(**given: Any) -> None:
    """Compare the Safety-Gym tasks with safety-gymnasium.

    \b
    Example: python -m experiments worlds -o results
    """
    _run('worlds', 'comparing', **given)
