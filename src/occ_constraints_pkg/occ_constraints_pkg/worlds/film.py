# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""An episode of one robot seen from above, as a picture of its path or as a film."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import animation
from matplotlib import pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrow, Patch, Polygon
from scipy.spatial import ConvexHull

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import GIF, MP4, PICTURE, Kind, replacing
from occ_constraints_pkg.picture_style import DOTS_PER_INCH, SAFE, VIOLATED, legend_below
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.geometry import matrix_of
from occ_constraints_pkg.worlds.stream import EpisodeStream
from occ_constraints_pkg.worlds.view import Thing

COLOURS = {
    'goal': '#6aa84f',
    'hazard': '#9d86c2',
    'pillar': '#4c4c8c',
    'vase': '#3fa7b5',
    'box': '#e0b03a',
    'robot': '#222222',
}
_SEE_THROUGH = {'goal': 0.35, 'hazard': 0.6}
# Not by colour alone.
_HATCHES = {'hazard': '////'}
# Of a film, which would else be large.
_FILM_DOTS_PER_INCH = 80
_FRAMES_PER_SECOND = 12
_WRITERS = {'.gif': 'pillow', '.mp4': 'ffmpeg'}
_KINDS = {'.png': PICTURE, '.gif': GIF, '.mp4': MP4}
# Half the side of the square in which things are placed, in m.
_ARENA = 1.5


@dataclass(frozen=True)
class _Moment:
    """Everything at one step, and the return and cost so far."""

    things: tuple[Thing, ...]
    total: float
    cost: float


def draw_episode(
    path: Path,
    world: World,
    driver: Callable[[np.ndarray], np.ndarray],
    *,
    steps: int,
    seed: int,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, float]:
    """Drive robot 0 through an episode and draw it.

    Args:
        path: ``.png`` for a picture of the whole path; ``.gif``, or ``.mp4`` where ffmpeg is
            installed, for a film in simulated time.
        world: has a view of its robots.
        driver: acts.
        steps: at most so many; the film ends with the episode.
        seed: of the world.
        progress: called with the frames done and to do.

    Returns:
        ``steps``, ``return`` and ``cost`` of what is shown.

    Raises:
        ConfigurationError: the world has no view, or there is no way to write such a file.
    """
    kind = kind_of(path)
    suffix = path.suffix.lower()
    moments = _drive(world, driver, steps, seed)
    stage = _Stage(world.name, moments)
    try:
        with replacing(path, kind) as draft:
            if suffix == '.png':
                stage.show(len(moments) - 1)
                stage.figure.savefig(draft, format='png', dpi=DOTS_PER_INCH)
            else:
                # In simulated time, rounded to whole steps per frame.
                stride = max(1, round(1 / (_FRAMES_PER_SECOND * world.step_seconds)))
                frames = range(0, len(moments), stride)
                writer = animation.writers[_WRITERS[suffix]](fps=1 / (stride * world.step_seconds))  # type: ignore[arg-type]
                with writer.saving(stage.figure, str(draft), _FILM_DOTS_PER_INCH):
                    for number, index in enumerate(frames, start=1):
                        stage.show(index)
                        writer.grab_frame()
                        progress(number, len(frames))
    finally:
        plt.close(stage.figure)
    last = moments[-1]
    return {'steps': len(moments) - 1, 'return': last.total, 'cost': last.cost}


def kind_of(path: Path) -> Kind:
    """Return what :func:`draw_episode` writes to a file of this name.

    Raises:
        ConfigurationError: there is no way to write such a file.
    """
    suffix = path.suffix.lower()
    if suffix != '.png' and not animation.writers.is_available(_WRITERS.get(suffix, '')):
        raise ConfigurationError(
            f'cannot write {path}: allowed are .png, .gif and, where ffmpeg is installed, .mp4'
        )
    return _KINDS[suffix]


def draw_things(axis: Axes, things: Sequence[Thing]) -> list[Artist]:
    """Draw the objects on the floor, seen from above, and return the artists.

    An arrow shows the heading of the robot.
    """
    drawn: list[Artist] = []
    for thing in things:
        axes, (x, y) = matrix_of(thing.quaternion[None])[0], thing.position[:2]
        if thing.shape == 'cylinder':
            drawn.append(axis.add_patch(Circle((x, y), thing.size[0] / 2, **_look(thing.kind))))
            continue
        # The outline of a box in any orientation.
        corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
        corners = ((corners * thing.size / 2) @ axes.T + thing.position)[:, :2]
        outline = corners[ConvexHull(corners).vertices]
        drawn.append(axis.add_patch(Polygon(outline, closed=True, **_look(thing.kind))))
        if thing.kind == 'robot':
            ahead = 0.12 * axes[:2, 0]
            arrow = FancyArrow(
                x - ahead[0], y - ahead[1], *(1.4 * ahead), width=0.01, color='white'
            )
            drawn.append(axis.add_patch(arrow))
    return drawn


def _look(kind: str) -> dict[str, Any]:
    look = {'fc': COLOURS[kind], 'alpha': _SEE_THROUGH.get(kind, 1.0), 'lw': 0}
    # The edge has the colour of the hatching.
    return {**look, 'hatch': _HATCHES[kind], 'ec': 'white'} if kind in _HATCHES else look


def draw_past_goals(axis: Axes, goals: Sequence[Thing]) -> list[Artist]:
    """Draw goals that were reached as dashed circles, and return the artists."""
    look = {'fc': 'none', 'ec': COLOURS['goal'], 'ls': '--', 'lw': 1}
    return [
        axis.add_patch(Circle(tuple(goal.position[:2]), goal.size[0] / 2, **look)) for goal in goals
    ]


def path_handles(bad: str) -> list[Artist]:
    """Return legend entries of a path: its start, and where it is bad.

    Args:
        bad: what the marked stretches are.
    """
    return [
        Line2D([], [], color='black', marker='o', ls='', ms=6, label='start'),
        Line2D([], [], color=SAFE, lw=1.4, label='path'),
        Line2D([], [], color=VIOLATED, marker='.', ls='', ms=8, label=bad),
        Patch(fc='none', ec=COLOURS['goal'], ls='--', label='goal reached'),
    ]


def thing_handles(kinds: Iterable[str]) -> list[Artist]:
    """Return legend entries of kinds of things."""
    return [Patch(label=kind, **_look(kind)) for kind in kinds]


def _drive(
    world: World, driver: Callable[[np.ndarray], np.ndarray], steps: int, seed: int
) -> list[_Moment]:
    stream = EpisodeStream(world, seed=seed)
    batch = stream.reset()
    total = cost = 0.0
    moments = [_Moment(world.view(0).things, total, cost)]
    while len(moments) <= steps and not batch.done[0]:
        batch = stream.step(driver(batch.observation))
        total += float(batch.reward[0])
        cost += float(batch.true_cost[0])
        moments.append(_Moment(world.view(0).things, total, cost))
    return moments


class _Stage:
    """A figure that shows one moment after another; constant parts are drawn once."""

    def __init__(self, name: str, moments: list[_Moment]) -> None:
        self._name, self._moments = name, moments
        self._places = np.array([_robot(moment).position[:2] for moment in moments])
        self._costly = np.diff([moment.cost for moment in moments], prepend=0.0) > 0
        self._past = _goals_before(moments)
        self.figure, self._axis = plt.subplots(figsize=(7.0, 7.6), layout='constrained')
        reach = max(_ARENA, float(np.abs(self._places).max())) + 0.2
        self._axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect='equal')
        self._axis.set(xlabel='x [m]', ylabel='y [m]')
        self._axis.plot(*self._places[0], 'o', color='black', ms=6, zorder=3)
        self._path = self._axis.plot([], [], color=SAFE, lw=1.4, zorder=3)[0]
        self._costs = self._axis.plot([], [], '.', color=VIOLATED, ms=6, zorder=4)[0]
        handles = thing_handles(dict.fromkeys(thing.kind for thing in moments[0].things))
        legend_below(self.figure, [*handles, *path_handles('cost')])
        self._drawn: list[Artist] = []

    def show(self, index: int) -> None:
        """Show a step and the path so far."""
        moment = self._moments[index]
        for artist in self._drawn:
            artist.remove()
        self._drawn = draw_things(self._axis, moment.things)
        self._drawn += draw_past_goals(self._axis, self._past[index])
        places, costly = self._places[: index + 1], self._costly[: index + 1]
        self._path.set_data(*places.T)
        self._costs.set_data(*places[costly].T)
        self._axis.set_title(
            f'{self._name}, step {index}: return {moment.total:.1f}, cost {moment.cost:.0f}',
            fontsize=11,
        )


def _robot(moment: _Moment) -> Thing:
    return next(thing for thing in moment.things if thing.kind == 'robot')


def _goals_before(moments: Sequence[_Moment]) -> list[list[Thing]]:
    """Return for each moment the goals that were reached before."""
    reached: list[Thing] = []
    result = []
    goal = None
    for moment in moments:
        now = next((thing for thing in moment.things if thing.kind == 'goal'), None)
        if goal is not None and now is not None and not np.array_equal(goal.position, now.position):
            reached.append(goal)
        goal = now
        result.append(list(reached))
    return result
