# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ drive``: an episode seen from above."""

from __future__ import annotations

from pathlib import Path

import click

from occ_constraints_pkg.cli.common import JSON, print_json, progress_bar
from occ_constraints_pkg.errors import import_needed


@click.command()
@click.argument('world')
@click.option('--driver', default='expert', show_default=True, help='A driver or a policy file.')
@click.option(
    '-o',
    '--output',
    default='drive.gif',
    show_default=True,
    type=click.Path(),
    help='.png: picture of the path; .gif, or .mp4 with ffmpeg: film.',
)
@click.option(
    '--steps', type=click.IntRange(min=1), help='At most so many. Default: a whole episode.'
)
@click.option('--seed', default=0, type=click.IntRange(min=0), show_default=True)
@JSON
def drive(
    world: str, driver: str, output: str, steps: int | None, seed: int, as_json: bool
) -> None:
    """Drive one episode of a Safety-Gym task and draw it from above.

    \b
    Example: occ drive CarPush1 --driver expert -o drive.gif
    """
    import numpy as np

    from occ_constraints_pkg.agents.drivers import find_driver
    from occ_constraints_pkg.worlds.registry import make_world

    film = import_needed('occ drive', 'occ_constraints_pkg.report.film')
    simulated = make_world(world, 1)
    act = find_driver(simulated, driver, np.random.default_rng(seed))
    with progress_bar('drawing') as progress:
        numbers = film.draw_episode(
            Path(output),
            simulated,
            act,
            steps=steps or simulated.max_episode_steps,
            seed=seed,
            progress=progress,
        )
    simulated.close()
    if as_json:
        print_json({'output': output, **numbers})
        return
    click.echo(
        f'{output}: {numbers["steps"]} steps, return {numbers["return"]:.2f}, '
        f'cost {numbers["cost"]:.0f}'
    )
