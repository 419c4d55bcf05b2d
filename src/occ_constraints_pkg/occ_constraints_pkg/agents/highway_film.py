# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Highway episodes as a film or a strip of pictures, with the violated rules beside them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import animation
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import GIF, PICTURE, Kind, replacing
from occ_constraints_pkg.picture_style import (
    DOTS_PER_INCH,
    FIGURE_WIDTH,
    SAFE,
    VIOLATED,
    legend_below,
)
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.highway import Highway
from occ_constraints_pkg.worlds.highway_scenarios import LANE_WIDTH
from occ_constraints_pkg.worlds.highway_traffic import HEADING, IDENTITY, LENGTH, WIDTH, X, Y

_ROAD, _LINE, _OTHER = '#d9d9d9', '#ffffff', '#777777'
# Of a film, which would else be large.
_FILM_DOTS_PER_INCH = 80
# Visible part of the road, in m behind and ahead of the ego.
_BEHIND, _AHEAD = 35.0, 105.0
_SHOTS = 3
# Seconds between frames; the film runs at twice the real speed.
_FRAME_SECONDS, _HASTE = 0.8, 2.0


@dataclass(frozen=True, eq=False)
class Drive:
    """One episode.

    Attributes:
        lanes: number of lanes.
        vehicles: (T, V, 3) x and y in m and heading in rad of all vehicles, the ego first; y grows
            to the right.
        observation: (T, k) of the ego.
        end: ``collision``, ``off the road`` or empty.
        returned: sum of rewards.
    """

    lanes: int
    vehicles: np.ndarray
    observation: np.ndarray
    end: str
    returned: float


def drive_through(driver: Callable[[np.ndarray], np.ndarray], number: int) -> Drive:
    """Drive through a scenario of the world ``highway``.

    Args:
        driver: takes an observation (1, k) and returns an action (1, 2).
        number: of the scenario.
    """
    world = Highway(1)
    observation, info = world.start(np.array([0]), [number])
    seen, vehicles, returned, ended = [], [], 0.0, False
    while True:
        traffic = world.traffic
        order = np.argsort(traffic.whole[IDENTITY, :, 0])
        vehicles.append(traffic.real[[X, Y, HEADING], :, 0].T[order])
        seen.append(observation[0])
        if ended:
            break
        observation, reward, terminated, truncated, info = world.step(driver(observation))
        returned += float(reward[0])
        ended = bool(terminated[0] | truncated[0])
    end = 'collision' if info['collision'][0] else 'off the road' if info['off_road'][0] else ''
    lanes = int(world.traffic.lanes[0])
    return Drive(lanes, np.array(vehicles), np.array(seen), end, returned)


def draw_drives(path: Path, drives: Mapping[str, Drive], constraints: Constraints | None) -> None:
    """Draw drives under one another.

    Args:
        path: ``.png`` for a strip of moments of each; ``.gif`` for a film.
        drives: by name of the driver, in the same scenario.
        constraints: the rules that judge each state, if any.

    Raises:
        ConfigurationError: the suffix is another one, or a rule uses a feature that the highway
            does not have.
    """
    kind = kind_of(path)
    broken = {name: _violations(drive, constraints) for name, drive in drives.items()}
    with replacing(path, kind) as draft:
        if kind is PICTURE:
            _draw_strip(draft, drives, broken)
        else:
            _draw_film(draft, drives, broken)


def kind_of(path: Path) -> Kind:
    """Return what :func:`draw_drives` writes to a file of this name.

    Raises:
        ConfigurationError: there is no way to write such a file.
    """
    kinds = {'.png': PICTURE, '.gif': GIF}
    if path.suffix.lower() not in kinds:
        raise ConfigurationError(f'cannot write {path}: allowed are .png and .gif')
    return kinds[path.suffix.lower()]


def _violations(drive: Drive, constraints: Constraints | None) -> dict[str, np.ndarray] | None:
    """Return (T,) bool by text of each rule that is ever violated: where it is."""
    if constraints is None:
        return None
    rule_set = constraints.rule_set
    values = RuleCost(constraints, Highway).features(drive.observation).astype(np.float64)
    truths = {}
    for index in rule_set.order:
        rule = rule_set.rules[index]
        truth = rule.holds(values)
        if truth.any():
            truths[rule.words(rule_set.space)] = truth
    return truths


def _draw_strip(
    path: Path, drives: Mapping[str, Drive], broken: Mapping[str, Mapping[str, np.ndarray] | None]
) -> None:
    figure, blocks = _figure(drives, broken, _SHOTS)
    for block, (name, drive) in zip(blocks, drives.items(), strict=True):
        road, timeline = _axes(block, name, drive, broken[name], _SHOTS)
        last = len(drive.vehicles) - 1
        for axis, step in zip(road, np.linspace(0, last, _SHOTS).astype(int), strict=True):
            _draw_road(axis, drive, step, broken[name])
            timeline.axvline(step * Highway.step_seconds, color='black', lw=0.8, ls=':')
    figure.savefig(path, dpi=DOTS_PER_INCH, format='png')
    plt.close(figure)


def _draw_film(
    path: Path, drives: Mapping[str, Drive], broken: Mapping[str, Mapping[str, np.ndarray] | None]
) -> None:
    figure, blocks = _figure(drives, broken, 1)
    parts = []
    for block, (name, drive) in zip(blocks, drives.items(), strict=True):
        (road,), timeline = _axes(block, name, drive, broken[name], 1)
        _draw_road(road, drive, 0, broken[name])
        parts.append((road, timeline.axvline(0.0, color='black', lw=1.0), drive, broken[name]))
    # All frames have the layout of the first.
    figure.draw_without_rendering()
    figure.set_layout_engine('none')
    longest = max(len(drive.vehicles) for drive in drives.values())
    stride = round(_FRAME_SECONDS / Highway.step_seconds)
    writer = animation.PillowWriter(fps=_HASTE / _FRAME_SECONDS)  # type: ignore[arg-type]
    with writer.saving(figure, str(path), _FILM_DOTS_PER_INCH):
        for step in range(0, longest, stride):
            for road, line, drive, truths in parts:
                now = min(step, len(drive.vehicles) - 1)
                road.clear()
                _draw_road(road, drive, now, truths)
                line.set_xdata([now * Highway.step_seconds] * 2)
            writer.grab_frame()
    plt.close(figure)


def _figure(
    drives: Mapping[str, Drive],
    broken: Mapping[str, Mapping[str, np.ndarray] | None],
    shots: int,
) -> tuple[Figure, Sequence[SubFigure]]:
    """Return a figure with its legend, and a part of it for each drive."""
    heights = [
        1.2 + sum(_block_heights(drive, broken[name], shots)) for name, drive in drives.items()
    ]
    figure = plt.figure(figsize=(FIGURE_WIDTH, sum(heights) + 0.5), layout='constrained')
    handles = [
        Patch(color=SAFE, label='own car'),
        Patch(color=VIOLATED, label='own car, rule violated or crashed'),
        Patch(color=_OTHER, label='other cars'),
        Line2D([], [], color='black', ls=':' if shots > 1 else '-', label='moment shown'),
    ]
    legend_below(figure, handles)
    blocks = figure.subfigures(len(drives), 1, height_ratios=heights, squeeze=False)
    return figure, list(blocks[:, 0])


def _block_heights(
    drive: Drive, truths: Mapping[str, np.ndarray] | None, shots: int
) -> list[float]:
    """Return the heights in inches of the pictures of the road, true to scale, and the timeline."""
    road = (LANE_WIDTH * drive.lanes + 3.0) / (_BEHIND + _AHEAD) * (FIGURE_WIDTH - 0.9)
    return [road] * shots + [0.36 * max(1, len(truths or {}))]


def _axes(
    block: SubFigure,
    name: str,
    drive: Drive,
    truths: Mapping[str, np.ndarray] | None,
    shots: int,
) -> tuple[Sequence[Axes], Axes]:
    end = f', {drive.end} after {(len(drive.vehicles) - 1) * Highway.step_seconds:.1f} s'
    block.suptitle(
        f'{name}: return {drive.returned:.1f}{end if drive.end else ""}',
        fontsize=10, x=0.01, ha='left',
    )  # fmt: skip
    *road, timeline = block.subplots(
        shots + 1, 1, height_ratios=_block_heights(drive, truths, shots)
    )
    _draw_timeline(timeline, drive, truths)
    return road, timeline


def _draw_road(
    axis: Axes, drive: Drive, step: int, truths: Mapping[str, np.ndarray] | None
) -> None:
    """Draw the surroundings of the ego, the right side of the road at the bottom."""
    vehicles = drive.vehicles[step]
    here = vehicles[0, 0]
    top, bottom = -LANE_WIDTH / 2, LANE_WIDTH * (drive.lanes - 0.5)
    axis.axhspan(top, bottom, color=_ROAD, lw=0)
    for lane in range(1, drive.lanes):
        axis.axhline(LANE_WIDTH * (lane - 0.5), color=_LINE, lw=1.0, ls=(0, (6, 6)))
    violated = any(truth[step] for truth in (truths or {}).values())
    ended = drive.end and step == len(drive.vehicles) - 1
    for index, (x, y, heading) in enumerate(vehicles):
        along = np.array([np.cos(heading), np.sin(heading)])
        across = np.array([-along[1], along[0]])
        corners = [
            (x - here, y) + a * LENGTH / 2 * along + b * WIDTH / 2 * across
            for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        ]
        colour = _OTHER if index else VIOLATED if violated or ended else SAFE
        axis.add_patch(Polygon(corners, closed=True, color=colour, lw=0, zorder=3))
    axis.set(xlim=(-_BEHIND, _AHEAD), ylim=(bottom + 1.5, top - 1.5), xticks=[], yticks=[])
    axis.set_aspect('equal')
    axis.set_anchor('W')
    for spine in axis.spines.values():
        spine.set_visible(False)
    speed = drive.observation[step, 0]
    axis.text(
        -_BEHIND - 2.0, (top + bottom) / 2,
        f'{step * Highway.step_seconds:.1f} s\n{speed:.0f} m/s', fontsize=8.5, va='center',
        ha='right',
    )  # fmt: skip


def _draw_timeline(axis: Axes, drive: Drive, truths: Mapping[str, np.ndarray] | None) -> None:
    """Draw when each rule is violated; ``None`` if there are no rules."""
    width, end = Highway.step_seconds, (len(drive.vehicles) - 1) * Highway.step_seconds
    verdict = 'no rules given' if truths is None else 'no rule violated'
    truths = truths or {}
    for row, (words, truth) in enumerate(truths.items()):
        # A state lasts to the next one, and the last one no time, but it is seen.
        starts = np.flatnonzero(truth) * width
        spans = [(start, min(width, end - start)) for start in starts.tolist()]
        axis.broken_barh(spans, (row - 0.02, 0.4), color=VIOLATED, lw=0.7)
        axis.text(0.006, row - 0.1, words, fontsize=8.5, transform=axis.get_yaxis_transform())
    if not truths:
        axis.text(0.006, -0.1, verdict, fontsize=8.5, transform=axis.get_yaxis_transform())
    longest = Highway.max_episode_steps * width
    if end < longest:
        axis.axvspan(end, longest, fc='#eeeeee', ec='#bbbbbb', hatch='///', lw=0)
    axis.set_yticks([])
    axis.set(xlim=(0.0, longest), ylim=(max(1, len(truths)) - 0.5, -0.6))
    axis.tick_params(axis='x', labelsize=8.5)
    axis.set_xlabel('time [s]', fontsize=8.5)
    axis.grid(axis='x', alpha=0.3)
