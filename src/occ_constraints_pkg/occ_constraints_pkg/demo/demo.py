# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The demo: record, learn, monitor and train on PointGoal1, with the nodes as processes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.agents.evaluation import evaluate
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.demo.processes import nodes_running, private_domain
from occ_constraints_pkg.demo.recordings import record_episodes
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import make_directory, set_aside
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.worlds.registry import make_world

WORLD = 'PointGoal1'
_DEMONSTRATORS, _DEMONSTRATIONS_EACH = 10, 5
_WATCHED_ROBOTS = 10
_TRAINED_ROBOTS = 256
_TEST_EPISODES = 64
_MARKER = '.occ_demo'
# Cost per episode that the published results on this task allow.
_COST_LIMIT = 25.0
_STAGE_SECONDS = 120.0
# Starting, cloning and the last update, on a machine that is busy with other things.
_START_SECONDS = 240.0


def run_demo(output: Path, *, train_seconds: float = 120.0) -> int:
    """Run the whole loop and write a page about it.

    Args:
        output: directory for the bag, the constraints file, logs, pictures and the page; what an
            earlier demo left there is moved aside.
        train_seconds: wall time of the training.

    Returns:
        The exit code 0.

    Raises:
        OccError: ``output`` holds something else than a demo, or a node failed.
    """
    from occ_constraints_pkg.demo.page import write_demo_page

    began = time.monotonic()
    _prepare(output)
    bag, rules, training = (
        output / name for name in ('demonstrations', 'constraints.yaml', 'training')
    )
    with private_domain() as domain:
        _record(bag, output / 'logs' / '1_record', domain)
        _say(2, 'the tree_learner node reads the bag and learns where demonstrations end')
        watched = _learn_and_watch(bag, rules, output / 'logs' / '2_watch', domain)
        constraints = load_constraints(rules)
        _print_watch(watched)
        _say(
            4,
            f'the constrained_learner node trains for {train_seconds:g} s on the costs of the '
            'monitor',
        )
        _train(bag, rules, training, train_seconds, output / 'logs' / '3_train', domain)
    scores = _compare(training / 'policy.npz', constraints)
    _print_scores(scores)

    page = write_demo_page(output, constraints, watched, scores, _COST_LIMIT)
    click.echo(f'\nDone in {time.monotonic() - began:.0f} s. Look at {page}')
    for name, what in (
        (bag, 'the bag'),
        (rules, 'the rules, to read and edit'),
        (training / 'policy.npz', 'the trained policy'),
        (output / 'logs', 'what the nodes said'),
    ):
        click.echo(f'  {name}: {what}')
    return 0


def _record(bag: Path, logs: Path, domain: int) -> None:
    _say(1, 'an expert drives; a recorder node writes its observations to an MCAP bag')
    record_episodes(
        bag,
        logs,
        domain,
        world=WORLD,
        driver='expert',
        robots=_DEMONSTRATORS,
        episodes=_DEMONSTRATIONS_EACH,
    )
    click.echo(f'      {_DEMONSTRATORS * _DEMONSTRATIONS_EACH} episodes are in {bag}')


def _learn_and_watch(bag: Path, rules: Path, logs: Path, domain: int) -> dict[str, Any]:
    """Run tree_learner and monitor; listen while an unconstrained driver drives."""
    from occ_constraints_pkg.demo.observer import Observer
    from occ_constraints_pkg.learning.rules_text import describe_rules

    nodes = {
        'monitor': {},
        'tree_learner': {'bags': [bag], 'feature_map': WORLD, 'output': rules},
        'policy': {'policy': 'straightv', 'wait_for_costs': True},
    }
    with nodes_running(nodes, logs, domain) as running, Observer(domain) as observer:

        def learned() -> bool:
            _check(running)
            return rules.exists()

        observer.spin_until(learned, _STAGE_SECONDS)
        click.echo(_indented(describe_rules(load_constraints(rules))))
        _say(3, 'an unconstrained driver drives; the monitor node judges every state')
        observer.wait_for_monitor(1)
        episode = {
            'sim': {
                'world': WORLD,
                'num_robots': _WATCHED_ROBOTS,
                'episodes': 1,
                'seed': 1,
                'wait_for_subscribers': 3,
            }
        }
        with nodes_running(episode, logs, domain) as simulation:

            def over() -> bool:
                _check(running)
                return not simulation['sim'].is_running

            observer.spin_until(over, _STAGE_SECONDS)
            simulation['sim'].wait(0.0)
    heard = observer.heard
    first = next((item for item in heard.violations.values() if len(item.status) > 1), None)
    return {
        **heard.agreement(),
        'observations': len(heard.true_cost),
        'costs': len(heard.costs),
        'violations': len(heard.violations.keys() & heard.costs.keys()),
        'example': {} if first is None else {v.key: v.value for v in first.status[1].values},
    }


def _train(bag: Path, rules: Path, output: Path, seconds: float, logs: Path, domain: int) -> None:
    nodes = {
        'monitor': {'constraints_file': rules},
        'constrained_learner': {
            'output': output,
            'seconds': seconds,
            'cost_limit': _COST_LIMIT,
            'total_steps': 1_000_000_000,
            'demonstrations': [bag],
        },
        'sim': {'world': WORLD, 'num_robots': _TRAINED_ROBOTS, 'wait_for_subscribers': 2},
    }
    log = output / 'metrics.jsonl'
    with nodes_running(nodes, logs, domain) as running:
        learner = running['constrained_learner']
        end = time.monotonic() + seconds + _START_SECONDS
        shown = 0
        while learner.is_running and time.monotonic() < end:
            _check(running)
            time.sleep(0.5)
            lines = log.read_text(encoding='utf-8').splitlines() if log.exists() else []
            if len(lines) >= shown + 10:
                shown = len(lines)
                numbers = json.loads(lines[-1])
                click.echo(f'      {_progress_line(numbers)}')
        learner.wait(1.0)


def _compare(trained: Path, constraints: Constraints) -> dict[str, dict[str, float]]:
    """Evaluate the policy before and after training, and the expert, on fresh episodes."""
    world = make_world(WORLD, _TEST_EPISODES)
    rng = np.random.default_rng(0)
    after = GaussianPolicy.load(trained)
    drivers: dict[str, Callable] = {
        'before training (random actions)': find_driver(world, 'random', rng),
        'the unconstrained driver': find_driver(world, 'straightv', rng),
        'after training': after.act,
        'the expert who demonstrated': find_driver(world, 'expert', rng, explore=True),
    }
    scores = {}
    for name, driver in drivers.items():
        result = evaluate(world, driver, episodes=_TEST_EPISODES, seed=12345)
        learned = evaluate(
            world,
            driver,
            episodes=_TEST_EPISODES,
            seed=12345,
            cost_source=RuleCost(constraints, world),
        )
        scores[name] = {
            'return': float(result.returns.mean()),
            'true_cost': float(result.costs.mean()),
            'learned_cost': float(learned.costs.mean()),
        }
    world.close()
    return scores


def _prepare(output: Path) -> None:
    """Make room for a new demo; what an earlier one left may have been edited and is kept."""
    if output.is_dir() and any(output.iterdir()):
        if not (output / _MARKER).exists():
            raise ConfigurationError(
                f'{output} exists and is not the output of a demo; name another directory with -o'
            )
        click.echo(f'      the earlier demo is now in {set_aside(output)}')
    make_directory(output)
    (output / _MARKER).touch()


def _check(running: dict) -> None:
    """Raise the error of a node that has ended with one."""
    for process in running.values():
        if process.exit_code:
            process.wait(0.0)


def _say(number: int, text: str) -> None:
    click.echo(f'[{number}/4] {text}')


def _indented(text: str) -> str:
    return '\n'.join(f'      {line}' for line in text.splitlines())


def _progress_line(numbers: dict[str, Any]) -> str:
    def shown(name: str) -> str:
        return 'not yet' if numbers[name] is None else f'{numbers[name]:.1f}'

    return (
        f'{numbers["steps"]:>8} steps  return {shown("mean_return")}  '
        f'learned cost {shown("mean_cost")}  multiplier {numbers["multiplier"]:.2f}'
    )


def _print_watch(watched: dict[str, Any]) -> None:
    click.echo(
        f'      {watched["observations"]} observations of {_WATCHED_ROBOTS} robots, '
        f'{watched["costs"]} answers on costs, {watched["violations"]} on violation'
    )
    if watched['example']:
        example = ', '.join(f'{key} = {value}' for key, value in watched['example'].items())
        click.echo(f'      a violation reads: {example}')
    click.echo(
        f'      against the true cost: precision {watched["precision"]:.2f}, '
        f'recall {watched["recall"]:.2f} ({watched["costly"]} of {watched["samples"]} '
        f'states truly costly, {watched["flagged"]} flagged)'
    )


def _print_scores(scores: dict[str, dict[str, float]]) -> None:
    click.echo(f'\n      per episode, over {_TEST_EPISODES} fresh episodes:')
    click.echo(f'      {"":<34}{"return":>8}{"learned cost":>14}{"true cost":>11}')
    for name, score in scores.items():
        click.echo(
            f'      {name:<34}{score["return"]:>8.1f}{score["learned_cost"]:>14.1f}'
            f'{score["true_cost"]:>11.1f}'
        )
