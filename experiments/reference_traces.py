# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recorded episodes of safety-gymnasium 1.0.0, and the same starts and actions in our worlds."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.bodies import PILLAR_RADIUS
from occ_constraints_pkg.worlds.layout import EXTENT, Layout
from occ_constraints_pkg.worlds.physics import SUBSTEPS
from occ_constraints_pkg.worlds.registry import world_class
from occ_constraints_pkg.worlds.safety_gym import SafetyGymWorld

TASKS = ('PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1')
_EPISODES = 5
# A free run is lost where the path is further than this from the recorded one, in m.
LOST = 1e-5
# Starts that are tried where rounding decides whether a wheel touches the floor.
_STARTS = 128


@dataclass(frozen=True, eq=False)
class Traces:
    """Five episodes of T steps under random actions; values are those before each action.

    Attributes:
        task: name of the world.
        layout: where things stood at the start, M = 5.
        obs: (5, T, k) observations.
        pos: (5, T, 3) positions of the robot, in m.
        yaw: (5, T) in rad.
        vel: (5, T, 3) velocities of the robot in m/s, world frame.
        goal: (5, T, 3) positions of the goal, in m.
        box: (5, T, 3) positions of the box, in m; 0 in Goal.
        act: (5, T, 2) actions.
        rew: (5, T) rewards that the actions brought.
        cost: (5, T) costs that the actions brought.
        untouched: (5,) steps from the start in which nothing can have touched vase, box or pillar.
    """

    task: str
    layout: Layout
    obs: np.ndarray
    pos: np.ndarray
    yaw: np.ndarray
    vel: np.ndarray
    goal: np.ndarray
    box: np.ndarray
    act: np.ndarray
    rew: np.ndarray
    cost: np.ndarray
    untouched: np.ndarray


def load_traces(task: str, folder: Path) -> Traces:
    """Read ``<task>_random.npz``.

    Raises:
        OccError: there is no such file, or its starts are not those of seeds 0 to 4.
    """
    path = folder / f'{task}_random.npz'
    if not path.is_file():
        raise OccError(f'there are no reference traces at {path}')
    names = ('obs', 'pos', 'yaw', 'vel', 'goal', 'box', 'act', 'rew', 'cost')
    with np.load(path) as file:
        arrays = {
            name: np.stack([file[f'{number}_{name}'] for number in range(_EPISODES)])
            for name in names
        }
    kind = world_class(task)
    layout = joined([reference_start(kind, seed)[0] for seed in range(_EPISODES)])
    if not (layout.robot[:, :2] == arrays['pos'][:, 0, :2]).all():
        raise OccError(f'{path} does not begin where seeds 0 to {_EPISODES - 1} begin')
    return Traces(task, layout, **arrays, untouched=_untouched(kind, layout, arrays['pos']))


def reference_start(kind: type[SafetyGymWorld], seed: int) -> tuple[Layout, np.random.RandomState]:  # noqa: NPY002
    """Return the start that safety-gymnasium 1.0.0 draws from ``seed``, with M = 1.

    It places things by the rules that ours follow, with NumPy's legacy generator, which is
    returned too, as it is then. So the yaw of vase and box, which the traces lack, is known.
    """
    rng = np.random.RandomState(seed)  # noqa: NPY002 - the reference's own generator
    keepouts = kind.rules.keepouts
    places: list[np.ndarray] = []
    while len(places) < len(keepouts):
        place = _first_free(rng, keepouts[len(places)], places, keepouts[: len(places)], 100)
        places = [] if place is None else [*places, place]
    yaws = rng.uniform(0.0, 2 * np.pi, len(keepouts))
    others = np.delete(keepouts, 1)
    goal = _first_free(rng, keepouts[1], [places[0], *places[2:]], others, 10_000)
    hazards = kind.lidars['hazards']
    layout = Layout(
        robot=np.array([[*places[0], yaws[0]]]),
        goal=goal[None],
        hazards=np.array(places[2 : 2 + hazards])[None],
        pillars=np.array(places[2 + hazards : -1]).reshape(1, -1, 2),
        movable=np.array([[*places[-1], yaws[-1]]]),
    )
    return layout, rng


class ReferenceGoals:
    """Replaces a world's placement rules to draw new goals as safety-gymnasium draws them.

    Goals agree only if every step, too, takes from the generator what it takes there: see
    :func:`reference_step`.
    """

    def __init__(self, keepouts: np.ndarray) -> None:
        self._goal, self._others = keepouts[1], np.delete(keepouts, 1)

    def sample_goal(
        self,
        rng: np.random.RandomState,  # noqa: NPY002
        obstacles: np.ndarray,
    ) -> np.ndarray | None:
        """Draw a place as :meth:`PlacementRules.sample_goal` does, from a legacy generator."""
        return _first_free(rng, self._goal, list(obstacles), self._others, 10_000)


def draw_goals_as_reference(
    world: SafetyGymWorld,
    generators: list[np.random.RandomState],  # noqa: NPY002
) -> None:
    """Let a world that was started draw new goals as safety-gymnasium does.

    Args:
        world: to be stepped by :func:`reference_step` from now on.
        generators: one per robot, as :func:`reference_start` returns them.
    """
    world.generators = generators
    world.rules = ReferenceGoals(world.rules.keepouts)


def reference_step(
    world: SafetyGymWorld, action: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
    """Step a world of :func:`draw_goals_as_reference`; see :meth:`World.step`.

    Safety-gymnasium draws the number of physics steps, always 10, from the generator that places
    goals, so a goal depends on how many steps were made before it.
    """
    for rng in world.generators:
        rng.binomial(SUBSTEPS, 1.0)
    return world.step(action)


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far ours is from the record after each step; NaN or False where it is not compared.

    Attributes:
        position: (5, T) distance in m.
        sensors: (5, T) largest difference of a sensor column, each divided by 1 + its size.
        lidars: (5, T) largest difference of a lidar column.
        reward: (5, T) difference.
        cost: (5, T) bool, whether they differ.
    """

    position: np.ndarray
    sensors: np.ndarray
    lidars: np.ndarray
    reward: np.ndarray
    cost: np.ndarray

    def over(self, steps: np.ndarray) -> dict[str, float]:
        """Return the largest of each over the first ``steps`` (5,) steps of the episodes."""
        chosen = np.arange(self.position.shape[1]) < steps[:, None]
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: float(np.nanmax(array[chosen])) for name, array in values.items()}

    def followed(self, most: np.ndarray) -> np.ndarray:
        """(5,) how many of the first ``most`` steps pass before the path is lost."""
        lost = self.position > LOST
        first = np.where(lost.any(axis=1), lost.argmax(axis=1), lost.shape[1])
        return np.minimum(first, most)


def free_run(traces: Traces, steps: int | None = None) -> Comparison:
    """Start where the episodes started and apply the recorded actions, and nothing else.

    New goals are drawn as safety-gymnasium draws them, not taken from the record. A car starts
    with its wheels exactly on the floor, so rounding decides whether they touch it. Of starts that
    differ by rounding, those whose first readings are the recorded ones are taken.

    Args:
        traces: what to follow.
        steps: how many steps; ``None`` for all.
    """
    steps = steps or traces.act.shape[1] - 1
    world = world_class(traces.task)(_EPISODES, processes=1)
    rows = np.arange(_EPISODES)
    world.start(rows, _touching_alike(traces))
    starts = [reference_start(type(world), seed) for seed in range(_EPISODES)]
    draw_goals_as_reference(world, [rng for _, rng in starts])
    outcome = []
    for step in range(steps):
        observation, reward, _, _, info = reference_step(world, traces.act[:, step])
        at = np.full(_EPISODES, step)
        outcome.append(_compare(traces, world, rows, at, observation, reward, info['true_cost']))
    world.close()
    return Comparison(*(np.stack(column, axis=1) for column in zip(*outcome, strict=True)))


def single_steps(traces: Traces) -> Comparison:
    """Put each recorded state of a Point into the world and make one step from it.

    Everything about a Point is in the record: its yaw rate is what its gyro read. (The turning of
    a Car's wheels is not.) Boxes are taken once they have settled, after 40 steps.
    """
    first = 40 if 'box' in world_class(traces.task).movable.name else 0
    length = traces.act.shape[1]
    episodes = [
        np.stack(np.broadcast_arrays(number, np.arange(first, traces.untouched[number] - 1)))
        for number in range(_EPISODES)
    ]
    number, step = np.concatenate(episodes, axis=1)
    world = world_class(traces.task)(len(number))
    start = traces.layout
    robot = np.column_stack([traces.pos[number, step, :2], traces.yaw[number, step]])
    goal = traces.goal[number, step, :2]
    velocity = np.column_stack([traces.vel[number, step, :2], traces.obs[number, step, 8]])
    rows = np.arange(len(number))
    world.start(
        rows,
        Layout(robot, goal, start.hazards[number], start.pillars[number], start.movable[number]),
        velocity,
    )
    if first:
        world.physics.movable[:, 2] = traces.box[number, step, 2]
        # The way to go depends on the box's height.
        world.move_goals(rows, goal)
    observation, reward, _, _, info = world.step(traces.act[number, step])
    goal = traces.goal[number, step + 1, :2]
    moved = np.flatnonzero((goal != traces.goal[number, step, :2]).any(axis=1))
    observation[moved] = world.move_goals(moved, goal[moved])
    found = _compare(traces, world, number, step, observation, reward, info['true_cost'])
    filled = [np.full((_EPISODES, length), np.nan) for _ in found]
    for array, values in zip(filled, found, strict=True):
        array[number, step] = values
    world.close()
    return Comparison(*filled)


def _compare(
    traces: Traces,
    world: SafetyGymWorld,
    number: np.ndarray,
    step: np.ndarray,
    observation: np.ndarray,
    reward: np.ndarray,
    cost: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Compare what a step brought each robot with what that step of its episode brought."""
    expected = traces.obs[number, step + 1]
    width = len(world.robot.sensors)
    sensors = np.abs(observation - expected)[:, :width] / (1 + np.abs(expected[:, :width]))
    position = world.physics.position(np.arange(world.num_envs))[:, :2]
    return (
        np.linalg.norm(position - traces.pos[number, step + 1, :2], axis=1),
        sensors.max(axis=1),
        np.abs(observation - expected)[:, width:].max(axis=1),
        np.abs(reward - traces.rew[number, step]),
        cost != traces.cost[number, step],
    )


def _touching_alike(traces: Traces) -> Layout:
    """Return the starts, each moved by rounding so that its first readings are the recorded."""
    kind, layout = world_class(traces.task), traces.layout
    world = kind(_STARTS, processes=1)
    robot = layout.robot.copy()
    tries = np.arange(_STARTS)
    for number, (x, y, yaw) in enumerate(layout.robot):
        # Turns by whole circles and by the last bit.
        yaws = yaw + 2 * np.pi * (tries % 3 - 1)
        yaws += (tries // 3 - _STARTS // 6) * np.spacing(yaws)
        start = _repeated(layout, number, _STARTS)
        start.robot[:] = np.column_stack([np.full(_STARTS, x), np.full(_STARTS, y), yaws])
        readings = world.start(tries, start)[:, : len(kind.robot.sensors)]
        expected = traces.obs[number, 0, : len(kind.robot.sensors)]
        robot[number, 2] = yaws[np.abs(readings - expected).max(axis=1).argmin()]
    world.close()
    return replace(layout, robot=robot)


def _repeated(layout: Layout, number: int, times: int) -> Layout:
    return Layout(
        **{
            field.name: np.repeat(getattr(layout, field.name)[number : number + 1], times, axis=0)
            for field in fields(Layout)
        }
    )


def joined(layouts: list[Layout]) -> Layout:
    """Return several layouts as one."""
    return Layout(
        **{
            field.name: np.concatenate([getattr(layout, field.name) for layout in layouts])
            for field in fields(Layout)
        }
    )


def _first_free(
    rng: np.random.RandomState,  # noqa: NPY002
    keepout: float,
    others: list[np.ndarray],
    other_keepouts: np.ndarray,
    tries: int,
) -> np.ndarray | None:
    reach = EXTENT - keepout
    for _ in range(tries):
        place = np.array([rng.uniform(-reach, reach), rng.uniform(-reach, reach)])
        gaps = [np.linalg.norm(place - other) for other in others]
        if (np.array(gaps) >= other_keepouts + keepout).all():
            return place
    return None


def _untouched(kind: type[SafetyGymWorld], layout: Layout, position: np.ndarray) -> np.ndarray:
    """(5,) steps until the circles around the robot and something that it can touch meet."""
    widths = [np.hypot(*kind.movable.half_extents[:2])] + [PILLAR_RADIUS] * layout.pillars.shape[1]
    places = np.concatenate([layout.movable[:, None, :2], layout.pillars], axis=1)
    offset = position[:, :, None, :2] - places[:, None]
    gap = np.linalg.norm(offset, axis=3) - np.array(widths) - kind.robot.reach
    met = (gap <= 0).any(axis=2)
    return np.where(met.any(axis=1), met.argmax(axis=1), met.shape[1])
