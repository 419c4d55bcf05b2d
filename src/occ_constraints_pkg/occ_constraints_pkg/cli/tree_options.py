# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The options of ``occ learn`` that set the learner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from occ_constraints_pkg.cli.common import named_options, seed_option
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.settings import OCTreeSettings

_OPTIONS = (
    click.option(
        '--depth',
        default=OCTreeSettings.max_depth,
        show_default=True,
        help='Largest depth of the tree.',
    ),
    click.option(
        '--clip',
        default=OCTreeSettings.clip,
        show_default=True,
        type=click.Choice(['mass', 'density']),
        help='How outliers are clipped at each split.',
    ),
    click.option(
        '--contamination',
        type=float,
        default=OCTreeSettings.contamination,
        help='With mass: share of the demonstrated samples that may lie outside; estimated if '
        'absent.',
    ),
    click.option(
        '--gamma',
        default=OCTreeSettings.gamma,
        show_default=True,
        help='With density: share of the largest density below which values are outliers.',
    ),
    click.option(
        '--alpha',
        default=OCTreeSettings.alpha,
        show_default=True,
        help='How deep a minimum of the density must be to split there.',
    ),
    click.option(
        '--beta',
        default=OCTreeSettings.beta,
        show_default=True,
        help='Share of the samples below which an interval is dropped.',
    ),
    click.option(
        '--min-split',
        default=OCTreeSettings.min_split,
        show_default=True,
        help='Share of the samples below which a node is not divided further.',
    ),
    click.option(
        '--nu',
        type=float,
        default=OCTreeSettings.nu,
        help='Stop before a larger share of the samples lies outside; no such stop if absent.',
    ),
    click.option(
        '--full-conditions',
        is_flag=True,
        help='Write rules with all bounds above them, as the paper does, not only those they need.',
    ),
    click.option(
        '--faithful',
        is_flag=True,
        help="The tree article's settings (density, gamma 0.05, alpha 0.5, beta 0.02, nu 0.1, full "
        'conditions); --gamma, --alpha, --beta, --min-split and --nu, if given, change them, and '
        '--depth replaces nu.',
    ),
)
held_out_seed = seed_option('Chooses the held-out episodes.')


def tree_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options; the command passes what they give on to :func:`tree_settings`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def tree_settings(*, faithful: bool, depth: int, **settings: Any) -> OCTreeSettings:
    """Return the settings that the options of the present command give.

    Raises:
        OccError: a value is not allowed, or an option does not go with the others.
    """
    given = OCTreeSettings(max_depth=depth, **settings)
    named = named_options()
    if faithful:
        return _article_settings(given, named)
    # What has no effect is refused: whoever gave it expects another result.
    if 'contamination' in named and given.clip != 'mass':
        raise ConfigurationError(
            '--contamination has no effect with --clip density; allowed is --gamma'
        )
    if 'gamma' in named and given.clip != 'density':
        raise ConfigurationError(
            '--gamma has no effect with --clip mass; allowed is --contamination'
        )
    return given


def _article_settings(given: OCTreeSettings, named: set[str]) -> OCTreeSettings:
    """Return the article's settings, but for those named on the command line."""
    if 'contamination' in named or ('clip' in named and given.clip != 'density'):
        raise ConfigurationError(
            '--faithful clips by density and has no contamination; allowed beside it are '
            '--depth, --gamma, --alpha, --beta, --min-split and --nu'
        )
    overrides: dict[str, Any] = {
        name: getattr(given, name)
        for name in ('gamma', 'alpha', 'beta', 'min_split', 'nu')
        if name in named
    }
    if 'depth' in named:
        overrides = {'nu': None, **overrides, 'max_depth': given.max_depth}
    return OCTreeSettings.article(**overrides)
