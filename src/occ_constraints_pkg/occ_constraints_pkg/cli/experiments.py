# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ experiment``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from occ_constraints_pkg.cli.common import (
    DATA,
    FEATURE_MAP_HELP,
    JSON,
    checked_cost_limit,
    help_without_command,
    needed_cost,
    print_json,
    progress_bar,
    say,
    say_lines,
    tell,
)
from occ_constraints_pkg.cli.recorded_experiments import (
    debouncing,
    ngsim,
    robots,
    warnings,
    worlds,
)
from occ_constraints_pkg.cli.tree_options import seed_option, tree_options, tree_settings
from occ_constraints_pkg.errors import import_needed
from occ_constraints_pkg.files import RESULTS, TABLE, make_directory, write_text
from occ_constraints_pkg.stopping import stop_request


@click.group(invoke_without_command=True)
@click.pass_context
def experiment(context: click.Context) -> None:
    """Repeat published experiments, or compare settings on data of your own.

    \b
    Example: occ experiment article --set Iris
    """
    help_without_command(context)


for _command in (robots, ngsim, worlds, warnings, debouncing):
    experiment.add_command(_command)


@experiment.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option('--splits', default=20, show_default=True, help='Random splits per line.')
@click.option('--seed', default=0, show_default=True)
@click.option(
    '--data',
    type=click.Path(exists=True, file_okay=False),
    help='Folder of the CSV files; default: oneclass in OCC_TEST_DATA or in ../shared/data.',
)
@click.option('--set', 'sets', multiple=True, help='Run only this data set; may be repeated.')
@JSON
def article(
    output: str, splits: int, seed: int, data: str | None, sets: tuple[str, ...], as_json: bool
) -> None:
    """Repeat the tree article's benchmark; writes article.json and article.md.

    A stopped run goes on where it was. Needs scikit-learn.

    \b
    Example: occ experiment article --set Iris -o results
    """
    module = import_needed('occ experiment', 'experiments.article')
    with progress_bar('lines') as progress:
        result = module.run_article(
            Path(output),
            splits=splits,
            seed=seed,
            folder=Path(data) if data else None,
            names=sets,
            progress=progress,
        )
    for reason in result['skipped'].values():
        tell(f'skipped: {reason}')
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'article.md').read_text(encoding='utf-8'))


@experiment.command()
@click.option('-o', '--output', default='highway', show_default=True, type=click.Path())
@click.option(
    '--set',
    'sets',
    multiple=True,
    type=click.Choice(['restricted', 'full']),
    help='Only this set of scenarios; may be repeated.',
)
@click.option('--rules', type=click.Path(), help='Constraints file; default: learn from traffic.')
@click.option(
    '--cost-limit', default='demonstrations', show_default=True, callback=checked_cost_limit
)
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
@click.option(
    '--steps',
    default=600_000,
    type=click.IntRange(min=1),
    show_default=True,
    help='Robot steps per training.',
)
@click.option('--seeds', default=3, type=click.IntRange(min=1), show_default=True)
@JSON
def highway(
    output: str, sets: tuple[str, ...], agents: tuple[str, ...], as_json: bool, **given: Any
) -> None:
    """Train on a highway with and without rules of its traffic, and compare.

    Writes highway.json, highway.md, highway.png, and drives as highway_drives.png and .gif. A
    stopped run goes on where it was.

    \b
    Example: occ experiment highway --set restricted -o results/highway
    """
    module = import_needed('occ experiment', 'experiments.highway')
    given |= {name: value for name, value in (('sets', sets), ('agents', agents)) if value}
    with stop_request.listening(), progress_bar('training') as progress:
        result = module.run_highway(
            Path(output),
            module.HighwaySettings(**given),
            progress=progress,
            is_stopped=lambda: stop_request.made,
        )
    if as_json:
        print_json(result)
    elif result['lines']:
        say_lines((Path(output) / 'highway.md').read_text(encoding='utf-8'))
    if stop_request.made:
        # All is saved; told and ended as any other stopped command.
        raise KeyboardInterrupt


@experiment.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option(
    '--samples', default=100_000, show_default=True, help='Most samples to learn from, per line.'
)
@click.option('--draws', default=5, show_default=True, help='Random draws per line.')
@click.option('--seed', default=0, type=click.IntRange(min=0), show_default=True)
@click.option('--world', 'worlds', multiple=True, help='Run only this world; may be repeated.')
@JSON
def truth(
    output: str, samples: int, draws: int, seed: int, worlds: tuple[str, ...], as_json: bool
) -> None:
    """Learn from experts whose true cost is known, and compare; writes truth.json, .md and .png.

    A stopped run goes on where it was.

    \b
    Example: occ experiment truth --world PointGoal1 -o results
    """
    module = import_needed('occ experiment', 'experiments.truth')
    with progress_bar('lines') as progress:
        result = module.run_truth(
            Path(output),
            samples=samples,
            draws=draws,
            seed=seed,
            names=worlds,
            progress=progress,
        )
    if as_json:
        print_json(result)
        return
    say_lines((Path(output) / 'truth.md').read_text(encoding='utf-8'))


@experiment.command()
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@click.option('--world', default='PointGoal1', show_default=True)
@click.option(
    '--demonstrations', default=50, type=click.IntRange(min=10), show_default=True, help='Episodes.'
)
@click.option(
    '--episodes', default=400, type=click.IntRange(min=100), show_default=True, help='In all.'
)
@click.option('--draws', default=100, type=click.IntRange(min=2), show_default=True)
@click.option('--seed', default=0, type=click.IntRange(min=0), show_default=True)
@JSON
def alarms(output: str, as_json: bool, **given: Any) -> None:
    """Measure the false-alarm promise on fresh episodes; writes alarms.json and alarms.md.

    An expert's episodes are dealt out at random, draw by draw: some are demonstrations, some are
    calibrated on, and the rest are fresh.

    \b
    Example: occ experiment alarms -o results
    """
    module = import_needed('occ experiment', 'experiments.alarms')
    with progress_bar('draws') as progress:
        result = module.run_alarms(module.AlarmSettings(**given), progress=progress)
    table = module.markdown(result)
    document = json.dumps(result, indent=1) + '\n'
    for name, kind, text in (('alarms.json', RESULTS, document), ('alarms.md', TABLE, table)):
        write_text(Path(output) / name, kind, text)
    if as_json:
        print_json(result)
        return
    say_lines(table)


@experiment.command()
@DATA
@click.option('-m', '--map', 'map_name', help=f'{FEATURE_MAP_HELP} Recordings need one.')
@click.option(
    '--score',
    'scored',
    multiple=True,
    type=click.Path(),
    help='Recording or table with the true cost, to score each depth on; may be repeated.',
)
@click.option('-o', '--output', default='results', show_default=True, type=click.Path())
@tree_options
@seed_option
@JSON
def depth(
    paths: tuple[str, ...],
    map_name: str | None,
    scored: tuple[str, ...],
    output: str,
    seed: int,
    as_json: bool,
    **tree: Any,
) -> None:
    """Learn once and show the rules of every depth; writes depth.json and depth.png.

    Each line is what `occ learn --depth` gives for that depth, from one tree: coverage of training
    samples and of held-out episodes, size of the formula and, with --score, precision, recall and
    F1 on samples whose true cost is known. The picture needs matplotlib.

    \b
    Example: occ experiment depth bags/safe_drive_1 -m my_robot.yaml --alpha 0.5 -o results
    """
    import numpy as np

    from occ_constraints_pkg.datasets.reading import read_demonstrations
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.learning.depths import ablate_depth
    from occ_constraints_pkg.learning.depths_text import depths_document, describe_depths

    # Needed at the end only, but a missing module must show now.
    picture = import_needed('occ experiment', 'occ_constraints_pkg.learning.depths_picture')
    settings = tree_settings(**tree)
    feature_map = None if map_name is None else load_feature_map(map_name)
    truth = None
    with progress_bar('reading') as progress:
        data, space = read_demonstrations(paths, feature_map, progress=progress)
    if scored:
        with progress_bar('reading') as progress:
            judged, _ = read_demonstrations(scored, feature_map, space, progress=progress)
        truth = judged.values, needed_cost(judged, scored)
    with progress_bar('depths') as progress:
        results = ablate_depth(
            data.values,
            data.episodes,
            space,
            settings,
            rng=np.random.default_rng(seed),
            truth=truth,
            progress=progress,
        )
    folder = make_directory(output)
    document = depths_document(results)
    write_text(folder / 'depth.json', RESULTS, json.dumps(document, indent=2) + '\n')
    picture.draw_depths(folder / 'depth.png', results)
    if as_json:
        print_json(document)
        return
    say_lines(describe_depths(results))
    say(f'Written to {folder / "depth.json"} and {folder / "depth.png"}')


@experiment.command()
@click.option('-o', '--output', default='transfer', show_default=True, type=click.Path())
@click.option('--source', default='PointGoal1', show_default=True, help='World of the expert.')
@click.option('--target', help='World of the trainings; default: the same.')
@click.option(
    '--expert', default='expert', show_default=True, help='Policy file, or the name of a driver.'
)
@click.option('--demonstrations', default=50, show_default=True, help='Episodes of the expert.')
@click.option('--cost-limit', default='demonstrations', show_default=True)
@click.option(
    '--steps',
    default=4_000_000,
    type=click.IntRange(min=1),
    show_default=True,
    help='Robot steps per training.',
)
@click.option('--first-seed', default=0, type=click.IntRange(min=0), show_default=True)
@click.option(
    '--seeds', default=3, type=click.IntRange(min=1), show_default=True, help='Trainings.'
)
@JSON
def transfer(output: str, as_json: bool, **given: Any) -> None:
    """Learn rules from an expert, train with them, compare; writes transfer.json.

    A stopped run goes on where it was.

    \b
    Example: occ experiment transfer --expert runs/expert/policy.npz -o results/transfer
    """
    given['target'] = given['target'] or given['source']
    from occ_constraints_pkg.agents.drivers import check_driver
    from occ_constraints_pkg.worlds.registry import check_world

    check_world(given['target'])
    check_driver(given['source'], given['expert'])
    module = import_needed('occ experiment', 'experiments.transfer')
    settings = module.TransferSettings(**given)
    total = settings.steps * settings.seeds
    with progress_bar('training', detail=True) as progress:
        result = module.run_transfer(
            Path(output),
            settings,
            progress=lambda latest: progress(sum(line['steps'] for line in latest.values()), total),
        )
    if as_json:
        print_json(result)
        return
    for name in ('expert', 'trained_mean'):
        line = result[name]
        say(
            f'{name.replace("_", " ")}: return {line["return"]:.2f}, true cost {line["cost"]:.2f}, '
            f'learned cost {line["learned_cost"]:.2f}'
        )
