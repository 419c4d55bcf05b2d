# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ drive``: an episode seen from above."""

from __future__ import annotations

from pathlib import Path

import click

from occ_constraints_pkg.cli.common import JSON, print_json, progress_bar, say
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.files import check_outputs


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
    '--steps',
    type=click.IntRange(min=1),
    help='At most so many, but on the highway. Default: a whole episode.',
)
@click.option(
    '--seed',
    default=0,
    type=click.IntRange(min=0),
    show_default=True,
    help='On the highway: number of the scenario.',
)
@click.option(
    '-c',
    '--constraints',
    type=click.Path(),
    help='On the highway: rules whose violations are drawn beside the drive.',
)
@JSON
def drive(
    world: str,
    driver: str,
    output: str,
    steps: int | None,
    seed: int,
    constraints: str | None,
    as_json: bool,
) -> None:
    """Drive one episode and draw it from above.

    \b
    Example: occ drive CarPush1 --driver expert -o drive.gif
    Example: occ drive highway -c rules.yaml -o drive.png
    """
    import numpy as np

    from occ_constraints_pkg.agents.drivers import check_driver, find_driver
    from occ_constraints_pkg.worlds.registry import make_world

    check_driver(world, driver)
    on_highway = world.startswith('highway')
    if on_highway and steps is not None:
        raise ConfigurationError(f'--steps is not for world {world}; allowed is a whole episode')
    if constraints is not None and not on_highway:
        raise ConfigurationError(
            f'--constraints is not for world {world}; allowed are the highways'
        )
    if on_highway:
        numbers = _drive_highway(world, driver, Path(output), seed, constraints)
        _tell(output, numbers, as_json)
        return
    film = import_needed('occ drive', 'occ_constraints_pkg.worlds.film')
    check_outputs({output: film.kind_of(Path(output))}, [driver])
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
    _tell(output, numbers, as_json)


def _drive_highway(
    world: str, driver: str, output: Path, number: int, constraints: str | None
) -> dict[str, float]:
    """Draw a drive through a scenario of the highway; return what it brought."""
    import numpy as np

    from occ_constraints_pkg.agents.drivers import find_driver
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.worlds.registry import world_class

    film = import_needed('occ drive', 'occ_constraints_pkg.agents.highway_film')
    check_outputs({output: film.kind_of(output)}, [driver, *([constraints] if constraints else [])])
    kind = world_class(world)
    if number >= kind.scenarios:
        raise ConfigurationError(
            f'world {world} has no scenario {number}; allowed are 0 to {kind.scenarios - 1}'
        )
    rules = None if constraints is None else load_constraints(constraints)
    act = find_driver(kind, driver, np.random.default_rng(number))
    drive = film.drive_through(act, number)
    film.draw_drives(output, {Path(driver).stem: drive}, rules)
    steps = len(drive.vehicles) - 1
    return {'steps': steps, 'return': drive.returned, 'cost': float(bool(drive.end))}


def _tell(output: str, numbers: dict[str, float], as_json: bool) -> None:
    if as_json:
        print_json({'output': output, **numbers})
        return
    say(
        f'{output}: {numbers["steps"]} steps, return {numbers["return"]:.2f}, '
        f'cost {numbers["cost"]:.0f}'
    )
