# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ learn``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from occ_constraints_pkg.cli.common import (
    DATA,
    DEFINITIONS,
    FEATURE_MAP_HELP,
    JSON,
    NAMESPACE,
    OVERWRITE,
    needed_cost,
    print_json,
    progress_bar,
    refuse_options,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.completion import feature_maps
from occ_constraints_pkg.cli.tree_options import held_out_seed, tree_options, tree_settings
from occ_constraints_pkg.errors import import_needed
from occ_constraints_pkg.files import (
    CONSTRAINTS,
    RESULTS,
    check_outputs,
    make_directory,
    write_text,
)
from occ_constraints_pkg.learning.rules_text import describe_learned, learned_document
from occ_constraints_pkg.learning.settings import OCTreeSettings

if TYPE_CHECKING:
    from occ_constraints_pkg.learning.conditional import ConditionalSettings


@click.command()
@DATA
@DEFINITIONS
@click.option(
    '-m',
    '--map',
    'map_name',
    shell_complete=feature_maps,
    help=f'{FEATURE_MAP_HELP} Recordings need one.',
)
@NAMESPACE
@click.option(
    '-o',
    '--output',
    type=click.Path(),
    help='File to write; default: constraints.yaml. With --compare-depths a directory; default: '
    'results.',
)
@tree_options
@click.option(
    '--conditions',
    type=click.Choice(['none', 'pairs', 'triples']),
    help='Look for rules about two (pairs), or up to three (triples), features as well; default: '
    'triples, or none with --faithful, --alpha, --clip density or --full-conditions.',
)
@click.option(
    '--apart',
    multiple=True,
    metavar='A,B',
    help='Features or families that no rule may combine; may be repeated.',
)
@click.option(
    '--no-families',
    is_flag=True,
    help='Take no columns of tables for one family, with the same bounds, that are named and '
    'behave like one measurement in several directions.',
)
@click.option(
    '--false-alarm',
    type=float,
    help='Move the bounds outward until a fresh safe episode raises an alarm with at most this '
    'probability; whole episodes are held out for that.',
)
@click.option(
    '--calibrate-on',
    multiple=True,
    metavar='DATA',
    type=click.Path(),
    help='With --false-alarm: episodes known to be safe, instead of held-out ones; may be '
    'repeated.',
)
@click.option(
    '--compare-depths',
    is_flag=True,
    help='Show the rules of every depth instead of writing a constraints file; writes depth.json '
    'and depth.png.',
)
@click.option(
    '--score',
    'scored',
    multiple=True,
    metavar='DATA',
    type=click.Path(),
    help='With --compare-depths: recording or table with the true cost, to score each depth on; '
    'may be repeated.',
)
@held_out_seed
@OVERWRITE
@JSON
def learn(
    paths: tuple[str, ...],
    map_name: str | None,
    namespace: str,
    output: str | None,
    conditions: str | None,
    apart: tuple[str, ...],
    no_families: bool,
    false_alarm: float | None,
    calibrate_on: tuple[str, ...],
    compare_depths: bool,
    scored: tuple[str, ...],
    seed: int,
    overwrite: bool,
    as_json: bool,
    **tree: Any,
) -> None:
    """Learn constraints from safe demonstrations.

    DATA are recordings, or tables (.npz, .csv, .parquet).

    \b
    Example: occ learn bags/safe_drive_1 bags/safe_drive_2 -m my_robot.yaml -o constraints.yaml
             occ learn bags/safe_drive_* -m my_robot.yaml --alpha 0.5 --compare-depths -o results
    """
    from occ_constraints_pkg.learning.conditional.settings import chosen_conditions

    settings = tree_settings(**tree)
    conditional = chosen_conditions(conditions, [tuple(pair.split(',')) for pair in apart])
    if compare_depths:
        refuse_options(
            ('false_alarm', 'calibrate_on', 'overwrite'),
            'has no effect with --compare-depths',
        )
        _compare_depths(
            paths,
            map_name,
            namespace,
            not no_families,
            scored,
            output or 'results',
            settings,
            conditional,
            seed,
            as_json,
        )
        return
    refuse_options(('scored',), 'needs --compare-depths')
    import numpy as np

    from occ_constraints_pkg.demonstrations.learning import learn_from_files
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.learning.guarantee import loss_words
    from occ_constraints_pkg.rules.constraints_file import save_learned

    output = output or 'constraints.yaml'
    check_outputs({output: CONSTRAINTS}, [*paths, *calibrate_on, *([map_name] if map_name else [])])
    warnings: list[str] = []
    with progress_bar('reading') as progress:
        constraints = learn_from_files(
            paths,
            None if map_name is None else load_feature_map(map_name),
            settings,
            rng=np.random.default_rng(seed),
            conditional=conditional,
            false_alarm=false_alarm,
            calibrate_on=calibrate_on,
            families=not no_families,
            namespace=namespace,
            progress=progress,
            warn=warnings.append,
        )
    save_learned(constraints, output, overwrite=overwrite)
    if loss := loss_words(constraints.learner.get('calibration')):
        warnings.append(loss)
    for sentence in warnings:
        warn(sentence)
    if as_json:
        print_json({'output': output, **learned_document(constraints), 'warnings': warnings})
        return
    say_lines(describe_learned(constraints))
    say(f'Written to {output}')


def _compare_depths(
    paths: tuple[str, ...],
    map_name: str | None,
    namespace: str,
    families: bool,
    scored: tuple[str, ...],
    output: str,
    settings: OCTreeSettings,
    conditional: ConditionalSettings | None,
    seed: int,
    as_json: bool,
) -> None:
    """Learn once and show the rules of every depth, each as --depth would give them."""
    import numpy as np

    from occ_constraints_pkg.datasets.reading import read_demonstrations
    from occ_constraints_pkg.demonstrations.families import take_families
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.learning.conditional.settings import resolved_conditions
    from occ_constraints_pkg.learning.depths import ablate_depth, depths_document, describe_depths

    # Needed at the end only, but a missing module must show now.
    picture = import_needed(
        'occ learn --compare-depths', 'occ_constraints_pkg.learning.depths_picture'
    )
    feature_map = None if map_name is None else load_feature_map(map_name)
    conditional = resolved_conditions(conditional, settings)
    if feature_map is not None:
        conditional = conditional.keeping_apart(feature_map.apart)
    truth = None
    with progress_bar('reading') as progress:
        data, space = read_demonstrations(
            paths, feature_map, namespace=namespace, progress=progress
        )
    if families and feature_map is None:
        space, sentences = take_families(data, space, settings)
        for sentence in sentences:
            warn(sentence)
    if scored:
        with progress_bar('reading') as progress:
            judged, _ = read_demonstrations(
                scored, feature_map, space, namespace=namespace, progress=progress
            )
        truth = judged.values, needed_cost(judged, scored)
    with progress_bar('depths') as progress:
        results = ablate_depth(
            data.values,
            data.episodes,
            space,
            settings,
            rng=np.random.default_rng(seed),
            conditional=conditional,
            independent=data.independent,
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
