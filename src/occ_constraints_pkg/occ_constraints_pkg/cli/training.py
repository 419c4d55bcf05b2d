# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ train``, ``evaluate`` and ``drive``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from occ_constraints_pkg.cli.common import JSON, end_tidily, print_json, progress_bar
from occ_constraints_pkg.errors import OccError, import_needed


@click.command()
@click.argument('world')
@click.option(
    '-o',
    '--output',
    required=True,
    type=click.Path(),
    help='Directory for policy, metrics and checkpoint.',
)
@click.option(
    '--cost',
    default='true',
    show_default=True,
    help="'true': the world's own cost; 'none': unconstrained; or a constraints file.",
)
@click.option('--cost-limit', default=25.0, show_default=True, help='Mean cost per episode.')
@click.option(
    '--steps', default=1_000_000, type=click.IntRange(min=1), show_default=True, help='Robot steps.'
)
@click.option(
    '--robots',
    default=64,
    type=click.IntRange(min=1),
    show_default=True,
    help='Robots simulated at once.',
)
@click.option('--seed', default=0, type=click.IntRange(min=0), show_default=True)
def train(
    world: str, output: str, cost: str, cost_limit: float, steps: int, robots: int, seed: int
) -> None:
    """Train a policy in one process, without ROS.

    \b
    Example: occ train PointGoal1 --cost constraints.yaml --steps 1000000 -o runs/mine
    """
    from occ_constraints_pkg.agents.rule_cost import RuleCost
    from occ_constraints_pkg.agents.training import TrainingDirectory, TrueCost
    from occ_constraints_pkg.agents.training import train as run_training
    from occ_constraints_pkg.rules.constraints_file import load_constraints
    from occ_constraints_pkg.worlds.registry import make_world

    ppo = import_needed('occ train', 'occ_constraints_pkg.agents.ppo_lagrangian')
    config = ppo.PPOLagrangianConfig(cost_limit=cost_limit, lagrangian=cost != 'none')
    simulated = make_world(world, robots)
    constraints = None
    source: Any = TrueCost()
    if cost not in ('true', 'none'):
        constraints = load_constraints(cost)
        source = RuleCost(constraints, simulated)
    learner = ppo.PPOLagrangian(
        config, simulated.columns, simulated.action_columns, simulated.name, seed
    )
    directory = TrainingDirectory(output)
    earlier = directory.begin()
    if earlier:
        click.echo(f'an earlier training is now in {earlier}', err=True)
    end_tidily()
    try:
        with progress_bar('training', detail=True) as progress:
            run_training(
                simulated,
                learner,
                source,
                seed=seed,
                total_steps=steps,
                directory=directory,
                progress=lambda metrics: progress(
                    metrics.steps,
                    steps,
                    f'return {metrics.mean_return:.1f} cost {metrics.mean_cost:.1f} '
                    f'multiplier {metrics.multiplier:.2f} {metrics.steps_per_s:.0f} steps/s',
                ),
            )
    finally:
        # A stopped training is not lost.
        directory.save(learner)
        if learner.updates and constraints is not None:
            counted = constraints.rule_set.with_counts(source.counts)
            constraints.with_rule_set(counted).save(directory.path / 'constraints.yaml')
        simulated.close()
        if learner.updates:
            click.echo(f'policy, checkpoint and metrics are in {output}')
        else:
            click.echo('stopped before the first update; nothing was learned', err=True)


@click.command()
@click.argument('policy', metavar='POLICY|DRIVER', type=click.Path())
@click.option('--world', help='Default: the one the policy was trained on; a driver needs one.')
@click.option('--episodes', default=50, type=click.IntRange(min=1), show_default=True)
@click.option('--seed', default=1, type=click.IntRange(min=0), show_default=True)
@click.option('--explore', is_flag=True, help='Sample actions instead of taking the mean.')
@JSON
def evaluate(
    policy: str, world: str | None, episodes: int, seed: int, explore: bool, as_json: bool
) -> None:
    """Drive fresh episodes with a trained policy or a driver; print return and true cost.

    \b
    Example: occ evaluate runs/mine/policy.npz --episodes 50
    Example: occ evaluate expert --world CarGoal1
    """
    import numpy as np

    from occ_constraints_pkg.agents.drivers import find_driver
    from occ_constraints_pkg.agents.evaluation import evaluate as run_evaluation
    from occ_constraints_pkg.agents.policy import GaussianPolicy
    from occ_constraints_pkg.worlds.registry import make_world

    if world is None:
        if not policy.endswith('.npz'):
            raise OccError(f'{policy!r} is no policy file (.npz), and a driver needs --world')
        world = GaussianPolicy.load(policy).world
    simulated = make_world(world, min(episodes, 64))
    driver = find_driver(simulated, policy, np.random.default_rng(seed), explore=explore)
    result = run_evaluation(simulated, driver, episodes=episodes, seed=seed)
    simulated.close()
    numbers = result.as_dict()
    if as_json:
        print_json(numbers)
        return
    for name, value in numbers.items():
        click.echo(f'{name}: {value:.3f}')


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
