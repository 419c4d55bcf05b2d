# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The demo's picture of trajectories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Circle

from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.files import PICTURE, replacing
from occ_constraints_pkg.worlds.film import COLOURS, draw_things
from occ_constraints_pkg.worlds.safety_gym import GOAL_RADIUS, PointGoal1
from occ_constraints_pkg.worlds.stream import EpisodeStream

_SAFE, _VIOLATED = '#3b6ea5', '#c8362b'
_HAZARD, _GOAL = COLOURS['hazard'], COLOURS['goal']
_DOTS_PER_INCH = 110
# Half the side of the square in which things are placed, in m.
_ARENA = 1.5


def draw_trajectories(
    path: Path, drivers: Sequence[tuple[str, Callable, RuleCost]], *, steps: int, seed: int
) -> None:
    """Draw one robot's path from above for each driver, in the same surroundings.

    Args:
        path: PNG file to write.
        drivers: title, driver and cost source of each panel.
        steps: number of steps to draw.
        seed: of the surroundings.
    """
    figure, axes = plt.subplots(1, len(drivers), figsize=(4.6 * len(drivers), 5.4), squeeze=False)
    furthest = _ARENA
    for axis, (title, driver, cost) in zip(axes[0], drivers, strict=True):
        world = PointGoal1(1, processes=1)
        stream = EpisodeStream(world, seed=seed)
        batch = stream.reset()
        hazards = [thing for thing in world.view(0).things if thing.kind == 'hazard']
        path_xy, goals, flagged = [], [], []
        for _ in range(steps):
            now = world.view(0)
            path_xy.append(now.position[:2])
            goals.append(next(thing for thing in now.things if thing.kind == 'goal').position[:2])
            flagged.append(cost(batch)[0] > 0)
            batch = stream.step(driver(batch.observation))
        world.close()
        places, bad = np.array(path_xy), np.array(flagged)
        draw_things(axis, hazards)
        for centre in np.unique(np.array(goals), axis=0):
            axis.add_patch(Circle(centre, GOAL_RADIUS, color=_GOAL, alpha=0.35, lw=0))
        axis.plot(*places.T, color=_SAFE, lw=1.2)
        axis.plot(*places[bad].T, '.', color=_VIOLATED, ms=4)
        axis.plot(*places[0], 'o', color='black', ms=6)
        axis.set_title(
            f'{title}\nreached {len(np.unique(goals, axis=0)) - 1} goals, '
            f'{bad.mean():.0%} of the time outside the rules',
            fontsize=10,
        )
        axis.set_aspect('equal')
        axis.set_xlabel('x [m]')
        furthest = max(furthest, float(np.abs(places).max()))
    for axis in axes[0]:
        axis.set_xlim(-furthest - 0.1, furthest + 0.1)
        axis.set_ylim(-furthest - 0.1, furthest + 0.1)
    axes[0][0].set_ylabel('y [m]')
    handles = [
        plt.Line2D([], [], color=_SAFE, label='inside the learned rules'),
        plt.Line2D([], [], color=_VIOLATED, marker='.', ls='', label='violates a learned rule'),
        plt.Line2D([], [], color=_HAZARD, marker='o', ls='', ms=10, label='hazard (true cost)'),
        plt.Line2D([], [], color=_GOAL, marker='o', ls='', ms=10, alpha=0.5, label='goals'),
    ]
    figure.legend(handles=handles, loc='lower center', ncols=4, fontsize=9, frameon=False)
    figure.tight_layout(rect=(0, 0.06, 1, 0.98))
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=_DOTS_PER_INCH, format='png')
    plt.close(figure)
