# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The demo's picture of trajectories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.picture_style import FIGURE_WIDTH, SAFE, VIOLATED, save_figure
from occ_constraints_pkg.wording import count_of
from occ_constraints_pkg.worlds.film import (
    draw_past_goals,
    draw_things,
    path_handles,
    thing_handles,
)
from occ_constraints_pkg.worlds.safety_gym import PointGoal1
from occ_constraints_pkg.worlds.stream import EpisodeStream

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
    # Two panels over the width, the legend in the place of one: all can be read where it is shown.
    rows = len(drivers) // 2 + 1
    figure, axes = plt.subplots(
        rows, 2, figsize=(FIGURE_WIDTH, 4.2 * rows), squeeze=False, layout='constrained'
    )
    panels = axes.ravel()
    furthest = _ARENA
    for axis, (title, driver, cost) in zip(panels, drivers, strict=False):
        world = PointGoal1(1, processes=1)
        stream = EpisodeStream(world, seed=seed)
        batch = stream.reset()
        hazards = [thing for thing in world.view(0).things if thing.kind == 'hazard']
        path_xy, goals, flagged = [], {}, []
        for _ in range(steps):
            now = world.view(0)
            path_xy.append(now.position[:2])
            goal = next(thing for thing in now.things if thing.kind == 'goal')
            goals[tuple(goal.position)] = goal
            flagged.append(cost(batch)[0] > 0)
            batch = stream.step(driver(batch.observation))
        world.close()
        *reached, last = goals.values()
        places, bad = np.array(path_xy), np.array(flagged)
        draw_things(axis, [*hazards, last])
        draw_past_goals(axis, reached)
        axis.plot(*places.T, color=SAFE, lw=1.2)
        axis.plot(*places[bad].T, '.', color=VIOLATED, ms=5)
        axis.plot(*places[0], 'o', color='black', ms=6)
        axis.set_title(
            f'{title}: {count_of(len(reached), "goal")} reached,\n'
            f'{bad.mean():.0%} of the time outside the rules',
            fontsize=10,
        )
        axis.set(aspect='equal', xlabel='x [m]', ylabel='y [m]')
        furthest = max(furthest, float(np.abs(places).max()))
    for axis in panels[: len(drivers)]:
        axis.set_xlim(-furthest - 0.1, furthest + 0.1)
        axis.set_ylim(-furthest - 0.1, furthest + 0.1)
    for axis in panels[len(drivers) :]:
        axis.axis('off')
    handles = [*thing_handles(['hazard', 'goal']), *path_handles('violates a learned rule')]
    panels[len(drivers)].legend(
        handles=handles, loc='center', fontsize=10, frameon=False,
        title='The same surroundings, from above',
    )  # fmt: skip
    save_figure(figure, path)
