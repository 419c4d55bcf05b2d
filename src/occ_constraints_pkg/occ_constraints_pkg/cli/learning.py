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
    print_json,
    progress_bar,
    warn,
)
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.report.rules import describe_rules


@click.command()
@DATA
@click.option('-m', '--map', 'map_name', help=f'{FEATURE_MAP_HELP} Recordings need one.')
@click.option('-o', '--output', default='constraints.yaml', show_default=True, type=click.Path())
@click.option(
    '--depth', default=OCTreeSettings.max_depth, show_default=True, help='Most levels of splits.'
)
@click.option(
    '--clip',
    default=OCTreeSettings.clip,
    show_default=True,
    type=click.Choice(['mass', 'density']),
    help='How outliers are cut off per split.',
)
@click.option(
    '--contamination',
    default=OCTreeSettings.contamination,
    show_default=True,
    help='With mass: share of the demonstrated samples that may lie outside.',
)
@click.option(
    '--gamma',
    default=OCTreeSettings.gamma,
    show_default=True,
    help='With density: share of the largest density below which values are outliers.',
)
@click.option(
    '--alpha',
    default=OCTreeSettings.alpha,
    show_default=True,
    help='How deep a minimum of the density must be to split there.',
)
@click.option(
    '--full-conditions',
    is_flag=True,
    help='Write rules with all bounds above them, as the paper does, not only those they need.',
)
@click.option(
    '--faithful',
    is_flag=True,
    help="The tree article's settings (density, gamma 0.05, alpha 0.5, beta 0.02, nu 0.1, full "
    'conditions); --gamma and --alpha, if given, change them, and --depth replaces nu.',
)
@click.option(
    '--seed',
    default=0,
    type=click.IntRange(min=0),
    show_default=True,
    help='Chooses the held-out episodes.',
)
@click.option('--overwrite', is_flag=True, help='Replace a file with edited rules (keeps .bak).')
@JSON
def learn(
    paths: tuple[str, ...],
    map_name: str | None,
    output: str,
    depth: int,
    clip: str,
    contamination: float,
    gamma: float,
    alpha: float,
    full_conditions: bool,
    faithful: bool,
    seed: int,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Learn constraints from safe driving: recordings, or tables (.npz, .csv, .parquet).

    \b
    Example: occ learn bags/safe_drive_1 bags/safe_drive_2 -m my_robot.yaml -o constraints.yaml
    """
    import numpy as np

    from occ_constraints_pkg.bags.demonstrations import learn_from_recordings, learn_from_tables
    from occ_constraints_pkg.bags.feature_map import load_feature_map
    from occ_constraints_pkg.bags.table_files import are_table_files
    from occ_constraints_pkg.learning.simplification import size
    from occ_constraints_pkg.rules.constraints_file import save_learned

    settings = OCTreeSettings(
        max_depth=depth,
        clip=clip,
        contamination=contamination,
        gamma=gamma,
        alpha=alpha,
        full_conditions=full_conditions,
    )
    if faithful:
        settings = _article_settings(settings)
    rng = np.random.default_rng(seed)
    feature_map = None if map_name is None else load_feature_map(map_name)
    if are_table_files(paths):
        constraints = learn_from_tables(
            paths, settings, rng=rng, feature_map=feature_map, warn=warn
        )
    elif feature_map is None:
        raise OccError(f'recordings such as {paths[0]} need a feature map: -m FILE or a name')
    else:
        with progress_bar('reading') as progress:
            constraints = learn_from_recordings(
                paths, feature_map, settings, rng=rng, progress=progress, warn=warn
            )
    save_learned(constraints, output, overwrite=overwrite)
    coverage = constraints.coverage
    rules, literals = size(constraints.rule_set)
    extracted_rules = constraints.learner['extracted_rules']
    extracted_literals = constraints.learner['extracted_literals']
    if as_json:
        print_json(
            {
                'output': output,
                'rules': rules,
                'literals': literals,
                'extracted_rules': extracted_rules,
                'extracted_literals': extracted_literals,
                **coverage,
            }
        )
        return
    click.echo(describe_rules(constraints))
    click.echo(
        f'\nSimplified from {extracted_rules} rules with {extracted_literals} literals '
        f'to {rules} with {literals}'
    )
    click.echo(
        f'Inside the safe set: {coverage["training"]:.2%} of '
        f'{coverage["training_samples"]} training samples'
        + (
            ''
            if coverage['held_out'] is None
            else f', {coverage["held_out"]:.2%} of {coverage["held_out_samples"]} samples of '
            f'{coverage["held_out_episodes"]} held-out episodes'
        )
    )
    click.echo(f'Written to {output}')


def _article_settings(given: OCTreeSettings) -> OCTreeSettings:
    """Return the article's settings, but for those named on the command line."""
    context = click.get_current_context()
    named = {
        name
        for name in context.params
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    }
    if 'contamination' in named or ('clip' in named and given.clip != 'density'):
        raise OccError(
            '--faithful clips by density and knows no contamination; allowed beside it are '
            '--depth, --gamma and --alpha'
        )
    overrides: dict[str, Any] = {
        name: getattr(given, name) for name in ('gamma', 'alpha') if name in named
    }
    if 'depth' in named:
        overrides.update(max_depth=given.max_depth, nu=None)
    return OCTreeSettings.article(**overrides)
