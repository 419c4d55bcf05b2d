# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How faithful the Safety-Gym tasks are: step by step against records, and means of episodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks.conditions import versions
from experiments.reference_traces import (
    TASKS,
    draw_goals_as_reference,
    free_run,
    joined,
    load_traces,
    reference_start,
    reference_step,
    single_steps,
)
from experiments.results import data_folder, markdown_table, write_results

# The recorded actions of the episode with seed s are those of NumPy's generator with seed 1000 + s.
_FIRST_ACTION_SEED = 1000


@dataclass(frozen=True)
class Printed:
    """Means and standard deviations over 50 episodes of safety-gymnasium 1.0.0.

    Attributes:
        world: name of the task.
        driver: who drove.
        total: mean and standard deviation of the return.
        cost: the same of the cost per episode.
        speed: mean in m/s; its standard deviation is not known.
    """

    world: str
    driver: str
    total: tuple[float, float]
    cost: tuple[float, float]
    speed: float


REFERENCE_EPISODES = 50
REFERENCE = (
    Printed('PointGoal1', 'random', (0.03, 0.77), (11.5, 45.7), 0.160),
    Printed('PointGoal1', 'straightv', (18.36, 1.40), (44.1, 33.0), 0.732),
    Printed('PointPush1', 'random', (-0.18, 0.52), (11.7, 52.7), 0.160),
    Printed('CarGoal1', 'random', (-1.59, 1.38), (50.8, 87.0), 0.160),
    Printed('CarGoal1', 'straight', (19.26, 1.19), (59.5, 30.7), 0.367),
    Printed('CarPush1', 'random', (-1.81, 1.17), (22.7, 43.6), 0.161),
)


def run_worlds(
    output: Path,
    *,
    episodes: int,
    folder: Path | None = None,
    progress: Callable[..., None] = lambda *_: None,
) -> dict[str, Any]:
    """Compare our worlds with safety-gymnasium.

    For the means, episodes begin where those of its seeds 0, 1, 2 ... begin, new goals are drawn
    as it draws them, and random actions are those of the records. What is left to differ is the
    simulation.

    Args:
        output: directory for ``worlds.json`` and ``worlds.md``.
        episodes: of ours, for the means.
        folder: where the records are; default: ``safety_gym_traces``, see :func:`.data_folder`.
            Without them only the means are compared.
        progress: called with what is done and what there is to do.

    Returns:
        ``steps``, ``means``, ``skipped`` (why records are missing) and ``versions``.
    """
    steps, skipped = [], {}
    todo = len(TASKS) + len(REFERENCE)
    for done, task in enumerate(TASKS):
        progress(done, todo)
        try:
            steps += _compared(task, folder or data_folder('safety_gym_traces'))
        except OccError as error:
            skipped[task] = str(error)
    means = []
    for done, printed in enumerate(REFERENCE, start=len(TASKS)):
        progress(done, todo)
        means.append(_means(printed, episodes))
    progress(todo, todo)
    result = {
        'steps': steps,
        'means': means,
        'skipped': skipped,
        'episodes': episodes,
        'versions': versions(('numpy', 'mujoco')),
    }
    write_results(output, 'worlds', result, markdown(result))
    return result


def _compared(task: str, folder: Path) -> list[dict[str, Any]]:
    """Compare a task with its records in every way that they allow."""
    traces = load_traces(task, folder)
    rows = []
    if task.startswith('Point'):
        found = single_steps(traces)
        compared = np.isfinite(found.position).sum()
        rows.append(
            {'world': task, 'form': 'single steps', 'steps': int(compared), 'of': int(compared)}
            | found.over(traces.untouched)
        )
        # Rounding grows on a Point's path, so only the path itself is worth reporting.
        found = free_run(traces)
        most = np.minimum(traces.untouched, found.position.shape[1])
        path = {'position': found.over(most)['position']}
        rows.append(
            {'world': task, 'form': 'path', 'steps': int(most.sum()), 'of': int(most.sum())} | path
        )
        return rows
    found = free_run(traces)
    most = np.minimum(traces.untouched, found.position.shape[1])
    followed = found.followed(most)
    row = {'world': task, 'form': 'path', 'steps': int(followed.sum()), 'of': int(most.sum())}
    return [row | found.over(followed)]


def _means(printed: Printed, episodes: int) -> dict[str, Any]:
    """Run episodes of ours and say how many standard errors their means are away."""
    world = make_world(printed.world, episodes)
    starts = [reference_start(type(world), seed) for seed in range(episodes)]
    observation = world.start(np.arange(episodes), joined([layout for layout, _ in starts]))
    draw_goals_as_reference(world, [rng for _, rng in starts])
    if printed.driver == 'random':
        driver = _recorded_random(episodes)
    else:
        driver = find_driver(world, printed.driver, np.random.default_rng(0))
    totals = {name: np.zeros(episodes) for name in ('return', 'cost', 'speed')}
    for _ in range(world.max_episode_steps):
        observation, reward, terminated, _, info = reference_step(world, driver(observation))
        totals['return'] += reward
        totals['cost'] += info['true_cost']
        totals['speed'] += np.hypot(observation[:, 3], observation[:, 4])
        if terminated.any():
            # Means over episodes of different lengths would say nothing.
            raise OccError(f'an episode of {printed.world} ended before its time')
    world.close()
    totals['speed'] /= world.max_episode_steps
    ours = {name: (float(v.mean()), float(v.std(ddof=1))) for name, v in totals.items()}
    # The spread of the reference's speed is not known; ours stands in for it.
    theirs = {
        'return': printed.total,
        'cost': printed.cost,
        'speed': (printed.speed, ours['speed'][1]),
    }
    row: dict[str, Any] = {'world': printed.world, 'driver': printed.driver}
    for name, (mean, deviation) in ours.items():
        error = np.hypot(deviation / episodes**0.5, theirs[name][1] / REFERENCE_EPISODES**0.5)
        row[name], row[f'{name}_std'] = mean, deviation
        row[f'{name}_reference'] = theirs[name][0]
        row[f'{name}_standard_errors'] = float((mean - theirs[name][0]) / error)
    return row


def _recorded_random(episodes: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return the random driver of the records: one generator for each seed."""
    rngs = [np.random.default_rng(_FIRST_ACTION_SEED + seed) for seed in range(episodes)]
    return lambda _: np.stack([rng.uniform(-1.0, 1.0, 2) for rng in rngs])


def markdown(result: dict[str, Any]) -> str:
    """Return the tables of docs/worlds.md."""
    compared = []
    for row in result['steps']:
        numbers = [
            f'{row[name]:.1e}' if name in row else '-'
            for name in ('position', 'sensors', 'lidars', 'reward')
        ]
        costs = '-' if 'cost' not in row else 'differ' if row['cost'] else 'equal'
        steps = f'{row["steps"]}' if row['steps'] == row['of'] else f'{row["steps"]} of {row["of"]}'
        compared.append([row['world'], row['form'], steps, *numbers, costs])
    means = []
    for row in result['means']:
        cells = [row['world'], f'`{row["driver"]}`']
        for name, places in (('return', 2), ('cost', 1), ('speed', 3)):
            mean = f'{row[name]:.{places}f}'
            if name != 'speed':
                mean += f' ± {row[f"{name}_std"]:.{places}f}'
            cells += [mean, f'{row[f"{name}_reference"]:.{places}f}']
            cells.append(f'{row[f"{name}_standard_errors"]:+.1f}')
        means.append(cells)
    heads = ['world', 'compared', 'steps', 'position, m', 'sensors', 'lidars', 'reward', 'costs']
    beside = ['reference', 's.e.']
    driven = ['world', 'driver', 'return', *beside, 'cost', *beside, 'speed, m/s', *beside]
    return f'{markdown_table(heads, compared)}\n\n{markdown_table(driven, means)}\n'
