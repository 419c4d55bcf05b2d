# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Random, non-overlapping initial positions of a Safety-Gym task."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

# Objects lie within +-1.5 m, each at least its keepout from the edge, and two of them at least
# the sum of their keepouts apart.
EXTENT = 1.5
_TRIES_PER_OBJECT = 100
_GOAL_TRIES = 10_000
_GOAL = 1
_DRAWN_AT_ONCE = 64
_Place = tuple[float, float]


@dataclass(frozen=True)
class Layout:
    """Positions of M robots and of the objects around each of them.

    Attributes:
        robot: (M, 3) x, y in m and yaw in rad.
        goal: (M, 2) x, y in m.
        hazards: (M, H, 2) x, y in m.
        pillars: (M, P, 2) x, y in m.
        movable: (M, 3) x, y in m and yaw in rad of the vase or box.
    """

    robot: np.ndarray
    goal: np.ndarray
    hazards: np.ndarray
    pillars: np.ndarray
    movable: np.ndarray


class PlacementRules:
    """The keepouts of the objects of a task, and the sampling of positions.

    Objects are placed one after another, uniformly, and redrawn if too close to an earlier one; if
    an object finds no place in 100 tries, the whole layout is drawn again.

    Attributes:
        keepouts: in m, of the robot, the goal, the hazards, the pillars and the movable thing.
    """

    def __init__(
        self,
        *,
        robot: float,
        goal: float,
        hazards: tuple[float, ...],
        pillars: tuple[float, ...],
        movable: float,
    ) -> None:
        """Take the keepouts in m, in the order in which objects are placed."""
        self.keepouts = np.array([robot, goal, *hazards, *pillars, movable])
        self._obstacles = np.delete(self.keepouts, _GOAL)
        self._hazards = slice(2, 2 + len(hazards))
        self._pillars = slice(2 + len(hazards), -1)

    def sample_layout(self, rngs: list[np.random.Generator]) -> Layout:
        """Draw one layout from each generator."""
        places = np.array([self._sample_places(rng) for rng in rngs])
        yaws = np.stack([rng.uniform(0.0, 2 * np.pi, 2) for rng in rngs])
        return Layout(
            robot=np.column_stack([places[:, 0], yaws[:, 0]]),
            goal=places[:, _GOAL],
            hazards=places[:, self._hazards],
            pillars=places[:, self._pillars],
            movable=np.column_stack([places[:, -1], yaws[:, 1]]),
        )

    def sample_goal(self, rng: np.random.Generator, obstacles: np.ndarray) -> np.ndarray | None:
        """Draw a new position of the goal among everything else as it is.

        Args:
            rng: the robot's generator.
            obstacles: (2 + H + P, 2) where the robot, the hazards, the pillars and the movable
                thing are now, in this order, in m.

        Returns:
            (2,) x, y in m, or ``None`` when 10 000 tries found no free place.
        """
        place = self._free_goal(_drawn(rng), obstacles.tolist())
        return None if place is None else np.array(place)

    def _sample_places(self, rng: np.random.Generator) -> list[_Place]:
        draws = _drawn(rng)
        keepouts = self.keepouts.tolist()
        while True:
            places: list[_Place] = []
            while len(places) < len(keepouts):
                keepout = keepouts[len(places)]
                place = _free_place(draws, keepout, places, keepouts, _TRIES_PER_OBJECT)
                if place is None:
                    places.clear()
                else:
                    places.append(place)
            # Safety-Gym draws the goal once more before an episode begins.
            goal = self._free_goal(draws, [places[0], *places[2:]])
            if goal is not None:
                places[_GOAL] = goal
                return places

    def _free_goal(self, draws: Iterator[float], obstacles: list[_Place]) -> _Place | None:
        keepout = float(self.keepouts[_GOAL])
        return _free_place(draws, keepout, obstacles, self._obstacles.tolist(), _GOAL_TRIES)


def _drawn(rng: np.random.Generator) -> Iterator[float]:
    """Yield uniform numbers from [-1, 1), drawn in blocks: one by one they cost 50 times more."""
    while True:
        yield from rng.uniform(-1.0, 1.0, _DRAWN_AT_ONCE).tolist()


# In plain Python: for so few numbers it is several times faster than NumPy.
def _free_place(
    draws: Iterator[float],
    keepout: float,
    others: list[_Place],
    other_keepouts: list[float],
    tries: int,
) -> _Place | None:
    """Return the first random place that is clear of ``others``, or ``None`` after ``tries``."""
    reach = EXTENT - keepout
    for _ in range(tries):
        x, y = reach * next(draws), reach * next(draws)
        # There may be more keepouts than positions: the rest is not placed yet.
        for (other_x, other_y), other_keepout in zip(others, other_keepouts, strict=False):
            apart = other_keepout + keepout
            if (x - other_x) ** 2 + (y - other_y) ** 2 < apart * apart:
                break
        else:
            return x, y
    return None
