# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Commands on simulated worlds: ``occ train``, ``evaluate`` and ``drive``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from occ_constraints_pkg.cli.common import (
    AT_LEAST_0,
    AT_LEAST_1,
    JSON,
    cost_limit_option,
    number,
    print_json,
    progress_bar,
    report,
    say,
    seed_option,
)
from occ_constraints_pkg.cli.completion import world_names
from occ_constraints_pkg.cli.report import HTML, named_title
from occ_constraints_pkg.errors import ConfigurationError, import_needed
from occ_constraints_pkg.files import PAGE, check_outputs
from occ_constraints_pkg.stopping import parent_is_gone, stop_request
from occ_constraints_pkg.worlds.registry import check_world

# Beside the policy.
_PAGE = 'report.html'


def _seeds(_context: Any, _parameter: Any, text: str | None) -> range | None:
    if text is None:
        return None
    first, colon, end = text.partition(':')
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise click.BadParameter(f'got {text!r}; allowed is FIRST:END, as in 0:5 for 0 to 4')
    return range(int(first), int(end))


def _learner(_context: Any, _parameter: Any, texts: tuple[str, ...]) -> dict[str, Any]:
    chosen = {}
    for text in texts:
        name, _, value = text.partition('=')
        try:
            chosen[name] = json.loads(value)
        except (ValueError, RecursionError):
            raise click.BadParameter(
                f'got {text!r}; allowed is NAME=VALUE, as in actor_lr=5e-4'
            ) from None
    return chosen


@click.command()
@click.argument('world', shell_complete=world_names)
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
@cost_limit_option('25')
@click.option(
    '--steps',
    default=1_000_000,
    type=AT_LEAST_1,
    show_default=True,
    help='Robot steps; at least as many as one update needs, rollout_steps for each robot.',
)
@click.option(
    '--robots',
    default=64,
    type=AT_LEAST_1,
    show_default=True,
    help='Robots simulated at once.',
)
@click.option(
    '--demonstrations',
    multiple=True,
    metavar='BAG',
    type=click.Path(),
    help='Begin with a policy cloned from the actions in this recording; may be repeated.',
)
@seed_option()
@click.option(
    '--seeds',
    callback=_seeds,
    metavar='FIRST:END',
    help='Several trainings over the cores, each in OUTPUT/seed_N; 0:5 means 0 to 4.',
)
@click.option('--resume', is_flag=True, help='Continue from the checkpoint in OUTPUT, if any.')
@click.option('--device', default='cpu', show_default=True, help='Where updates are computed.')
@click.option(
    '--processes',
    default=0,
    type=AT_LEAST_0,
    show_default=True,
    help='Processes that step the world, this one included; 0: one per core. With --seeds: 1.',
)
@click.option(
    '--set',
    'learner',
    multiple=True,
    metavar='NAME=VALUE',
    callback=_learner,
    help='A setting of the learner, as in actor_lr=5e-4; may be repeated.',
)
@JSON
def train(
    world: str,
    output: str,
    cost: str,
    cost_limit: float | str,
    steps: int,
    robots: int,
    demonstrations: tuple[str, ...],
    seed: int,
    seeds: range | None,
    resume: bool,
    device: str,
    processes: int,
    learner: dict[str, Any],
    as_json: bool,
) -> None:
    """Train a policy that obeys rules, without ROS.

    With --seeds several are trained, in processes of their own. A stopped training (Ctrl-C) is
    saved; the same command with --resume continues it exactly.

    \b
    Example: occ train PointGoal1 --cost constraints.yaml --steps 1000000 -o runs/mine
             occ train PointGoal1 --cost rules.yaml --demonstrations bags/drives -o runs/mine
    """
    check_world(world)
    run = import_needed('occ train', 'occ_constraints_pkg.agents.run')
    import_needed('occ train', 'occ_constraints_pkg.agents.ppo_lagrangian')
    settings = run.RunSettings(
        *(world, cost, cost_limit, steps, robots, seed, device, processes, learner),
        cloned=bool(demonstrations),
    )
    # Refused before anything is written, and not by each of the seeds.
    limit = run.check(settings)
    if seeds is None:
        _train_one(run, settings, Path(output), resume, demonstrations, as_json)
    else:
        _train_several(settings, seeds, Path(output), resume, demonstrations, limit, as_json)
    if stop_request.made:
        # All is saved; reported and ended as any other stopped command.
        raise KeyboardInterrupt


def _train_one(
    run: Any,
    settings: Any,
    output: Path,
    resume: bool,
    demonstrations: tuple[str, ...],
    as_json: bool,
) -> None:
    def demonstrated() -> tuple[Any, Any]:
        from occ_constraints_pkg.datasets.driven import read_driven
        from occ_constraints_pkg.worlds.registry import world_class

        kind = world_class(settings.world)
        names = [[column.name for column in each] for each in (kind.columns, kind.action_columns)]
        driven = read_driven(demonstrations, *names, kind.name)
        return driven.observations, driven.actions

    with stop_request.listening(), progress_bar('training', detail=True) as progress:
        result = run.run(
            settings,
            output,
            resume=resume,
            demonstrated=demonstrated if demonstrations else None,
            progress=lambda metrics: progress(
                metrics.steps,
                settings.steps,
                f'return {metrics.mean_return:.1f} cost {metrics.mean_cost:.1f} '
                f'multiplier {metrics.multiplier:.2f} {metrics.steps_per_s:.0f} steps/s',
            ),
            is_stopped=lambda: stop_request.made or parent_is_gone(),
            say=report,
        )
    if not result.history:
        report('stopped before the first update; nothing was learned')
        return
    _draw_curves(output, [result.history], result.cost_limit, settings.cost)
    if as_json:
        print_json({'output': str(output), 'cost_limit': result.cost_limit, **result.history[-1]})
    else:
        say(f'policy, checkpoint and metrics are in {output}, with a page, {_PAGE}')


def _train_several(
    settings: Any,
    seeds: range,
    output: Path,
    resume: bool,
    demonstrations: tuple[str, ...],
    limit: float,
    as_json: bool,
) -> None:
    from occ_constraints_pkg.agents.seeds import seeds_summary, train_seeds

    arguments = [settings.world, '--cost', settings.cost, '--cost-limit', str(settings.cost_limit)]
    arguments += ['--steps', str(settings.steps), '--robots', str(settings.robots)]
    arguments += ['--device', settings.device, *(['--resume'] if resume else [])]
    for path in demonstrations:
        arguments += ['--demonstrations', path]
    for name, value in settings.learner.items():
        arguments += ['--set', f'{name}={json.dumps(value)}']
    with progress_bar(f'{len(seeds)} seeds', detail=True) as progress:

        def show(latest: dict[int, dict[str, Any]]) -> None:
            steps = sum(line['steps'] for line in latest.values())
            rate = sum(line['steps_per_s'] for line in latest.values())
            progress(steps, settings.steps * len(seeds), f'{len(latest)} begun {rate:.0f} steps/s')

        directories = train_seeds(arguments, seeds, output, progress=show)
    summary, histories = seeds_summary(directories)
    if not histories:
        report('stopped before the first update of any seed; nothing was learned')
        return
    _draw_curves(output, histories, limit, settings.cost)
    if as_json:
        print_json({'output': str(output), 'cost_limit': limit, **summary})
        return
    for line in summary['seeds']:
        say(
            f'{line["directory"]}: {line["steps"]} steps, return {line["return"]:.2f}, '
            f'cost {line["cost"]:.2f}'
        )
    say(
        f'mean of {len(histories)}: return {_interval(summary, "return")}, '
        f'cost {_interval(summary, "cost")} (95 % intervals over seeds; during training)'
    )


def _draw_curves(output: Path, histories: list, limit: float, cost: str) -> None:
    """Draw the curves, and write the page that shows them."""
    try:
        from occ_constraints_pkg.agents.curves import draw_training
        from occ_constraints_pkg.report.page import write_page
        from occ_constraints_pkg.report.training import training_page
    except ModuleNotFoundError:
        report("no curves.png and no report.html: they need the extra 'report'")
        return
    draw_training(
        output / 'curves.png',
        histories,
        None if cost == 'none' else limit,
        cost_name='true cost' if cost in ('true', 'none') else 'learned cost',
    )
    write_page(training_page(f'Training in {output.resolve().name}', output), output / _PAGE)


def _interval(numbers: dict[str, Any], name: str) -> str:
    half = numbers[f'{name}_ci95']
    return f'{numbers[name]:.2f}' + ('' if half is None else f' ± {half:.2f}')


@click.command()
@click.argument('policies', metavar='POLICY|DRIVER...', nargs=-1, required=True, type=click.Path())
@click.option(
    '--world',
    shell_complete=world_names,
    help='Default: the one the policy was trained on; a driver needs one.',
)
@click.option('--episodes', default=50, type=AT_LEAST_1, show_default=True)
@seed_option(default=1)
@click.option('--explore', is_flag=True, help='Sample actions instead of taking the mean.')
@click.option(
    '--cost',
    type=click.Path(),
    help='Constraints file to take the cost from; default: true cost.',
)
@HTML
@JSON
def evaluate(
    policies: tuple[str, ...],
    world: str | None,
    episodes: int,
    seed: int,
    explore: bool,
    cost: str | None,
    html: str | None,
    as_json: bool,
) -> None:
    """Measure return and cost of policies and drivers on fresh episodes.

    Of one policy the 95 % intervals are over episodes, of several over policies.

    \b
    Example: occ evaluate runs/mine/policy.npz --episodes 50
    Example: occ evaluate expert --world CarGoal1
    """
    from occ_constraints_pkg.agents.evaluation import evaluate_driver, over_policies
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    if html is not None:
        check_outputs({html: PAGE}, [*policies, *([cost] if cost else [])])
        import_needed('occ evaluate --html', 'occ_constraints_pkg.report.training')
    constraints = None if cost is None else load_constraints(cost)
    worlds = [world or _world_of(policy) for policy in policies]
    lines = []
    with progress_bar('evaluating') as progress:
        for policy, place in zip(policies, worlds, strict=True):
            result = evaluate_driver(
                policy,
                place,
                episodes=episodes,
                seed=seed,
                explore=explore,
                constraints=constraints,
            )
            lines.append({name: number(value) for name, value in result.as_dict().items()})
            progress(len(lines), len(policies))
    named = [{'policy': path, **line} for path, line in zip(policies, lines, strict=True)]
    if html is not None:
        settings = {
            'worlds': list(dict.fromkeys(worlds)),
            'first seed': seed,
            'sampled actions': explore,
            'cost': 'true cost' if cost is None else cost,
        }
        _write_evaluation(html, named, settings)
    if len(lines) == 1:
        numbers = lines[0]
    else:
        numbers = over_policies(lines)
        if as_json:
            numbers = {'policies': named, **numbers}
        for line in named if not as_json else ():
            say(f'{line["policy"]}: return {line["return"]:.3f}, cost {line["cost"]:.3f}')
    if as_json:
        print_json(numbers)
        return
    for name, value in numbers.items():
        say(f'{name}: {_written(value)}')


def _write_evaluation(path: str, lines: list[dict[str, Any]], settings: dict[str, Any]) -> None:
    from occ_constraints_pkg.report.page import write_page
    from occ_constraints_pkg.report.training import evaluation_page

    title = 'Evaluation of ' + named_title([line['policy'] for line in lines])
    write_page(evaluation_page(title, lines, settings), path)


def _written(value: float | None) -> str:
    if value is None:
        return 'not known'
    return str(value) if isinstance(value, int) else f'{value:.3f}'


def _world_of(policy: str) -> str:
    """Return the world that a policy file was trained in."""
    from occ_constraints_pkg.agents.policy import GaussianPolicy

    if Path(policy).is_dir():
        inside = Path(policy, 'policy.npz')
        raise ConfigurationError(
            f'{policy} is a directory; allowed is the policy file in it, {inside}'
            if inside.is_file()
            else f'{policy} is a directory without a policy.npz; allowed is a policy file (.npz)'
        )
    if not policy.endswith('.npz'):
        raise ConfigurationError(f'{policy!r} is no policy file (.npz), and a driver needs --world')
    return GaussianPolicy.load(policy).world


@click.command()
@click.argument('world', shell_complete=world_names)
@click.option('--driver', default='expert', show_default=True, help='A driver or a policy file.')
@click.option(
    '-o',
    '--output',
    default='drive.gif',
    show_default=True,
    type=click.Path(),
    help='.png: picture of the trajectory; .gif, or .mp4 with ffmpeg: film.',
)
@click.option(
    '--steps',
    type=AT_LEAST_1,
    help='Largest number of steps, except on the highway; default: a whole episode.',
)
@seed_option('On the highway: number of the scenario.')
@click.option(
    '-c',
    '--constraints',
    type=click.Path(),
    help='On the highway: rules whose violations are drawn beside the trajectory.',
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
    """Draw one episode from above, as a picture or a film.

    \b
    Example: occ drive PointGoal1 --driver expert -o drive.png
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
        _print_drive(output, numbers, as_json)
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
    _print_drive(output, numbers, as_json)


def _drive_highway(
    world: str, driver: str, output: Path, number: int, constraints: str | None
) -> dict[str, float]:
    """Draw an episode of a scenario of the highway; return its steps, return and cost."""
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


def _print_drive(output: str, numbers: dict[str, float], as_json: bool) -> None:
    if as_json:
        print_json({'output': output, **numbers})
        return
    say(
        f'{output}: {numbers["steps"]} steps, return {numbers["return"]:.2f}, '
        f'cost {numbers["cost"]:.0f}'
    )
