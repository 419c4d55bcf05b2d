# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ learn``."""

from __future__ import annotations

from typing import Any

import click

from occ_constraints_pkg.cli.common import (
    DATA,
    FEATURE_MAP_HELP,
    JSON,
    OVERWRITE,
    print_json,
    progress_bar,
    say,
    say_lines,
    warn,
)
from occ_constraints_pkg.cli.tree_options import seed_option, tree_options, tree_settings
from occ_constraints_pkg.files import CONSTRAINTS, check_outputs
from occ_constraints_pkg.learning.rules_text import describe_promise, describe_rules
from occ_constraints_pkg.wording import count_of


@click.command()
@DATA
@click.option('-m', '--map', 'map_name', help=f'{FEATURE_MAP_HELP} Recordings need one.')
@click.option('-o', '--output', default='constraints.yaml', show_default=True, type=click.Path())
@tree_options
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
@seed_option
@OVERWRITE
@JSON
def learn(
    paths: tuple[str, ...],
    map_name: str | None,
    output: str,
    false_alarm: float | None,
    calibrate_on: tuple[str, ...],
    seed: int,
    overwrite: bool,
    as_json: bool,
    **tree: Any,
) -> None:
    """Learn constraints from safe driving: recordings, or tables (.npz, .csv, .parquet).

    \b
    Example: occ learn bags/safe_drive_1 bags/safe_drive_2 -m my_robot.yaml -o constraints.yaml
    """
    import numpy as np

    from occ_constraints_pkg.demonstrations.learning import learn_from_files
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.learning.guarantee import loss_words
    from occ_constraints_pkg.learning.simplification import size
    from occ_constraints_pkg.rules.constraints_file import save_learned

    settings = tree_settings(**tree)
    check_outputs({output: CONSTRAINTS}, [*paths, *calibrate_on, *([map_name] if map_name else [])])
    warnings: list[str] = []
    with progress_bar('reading') as progress:
        constraints = learn_from_files(
            paths,
            None if map_name is None else load_feature_map(map_name),
            settings,
            rng=np.random.default_rng(seed),
            false_alarm=false_alarm,
            calibrate_on=calibrate_on,
            progress=progress,
            warn=warnings.append,
        )
    save_learned(constraints, output, overwrite=overwrite)
    coverage = constraints.coverage
    calibration = constraints.learner.get('calibration')
    rules, literals = size(constraints.rule_set)
    extracted_rules = constraints.learner['extracted_rules']
    extracted_literals = constraints.learner['extracted_literals']
    if calibration and calibration['vanished']:
        warnings.append(loss_words(calibration))
    for sentence in warnings:
        warn(sentence)
    if as_json:
        print_json(
            {
                'output': output,
                'rules': rules,
                'literals': literals,
                'extracted_rules': extracted_rules,
                'extracted_literals': extracted_literals,
                **coverage,
                **({'calibration': calibration} if calibration else {}),
                'warnings': warnings,
            }
        )
        return
    say_lines(describe_rules(constraints))
    before = f'{count_of(extracted_rules, "rule")} with {count_of(extracted_literals, "literal")}'
    say('')
    if settings.full_conditions:
        say(f'{before}, not simplified')
    elif (rules, literals) == (extracted_rules, extracted_literals):
        say(f'{before}; there was nothing to simplify')
    else:
        say(f'Simplified from {before} to {rules} with {literals}')
    say(
        f'Inside the safe set: {coverage["training"]:.2%} of '
        f'{count_of(coverage["training_samples"], "training sample")}'
        + (
            ''
            if coverage['held_out'] is None
            else f', {coverage["held_out"]:.2%} of {coverage["held_out_samples"]} samples of '
            f'{count_of(coverage["held_out_episodes"], "held-out episode")}'
        )
    )
    if calibration:
        say(describe_promise(constraints))
    say(f'Written to {output}')
