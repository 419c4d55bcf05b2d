# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where things stand when an episode of a Safety-Gym task begins: random places, kept clear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Objects lie within +-1.5 m, each at least its keepout from the edge, and two of them at least
# the sum of their keepouts apart.
EXTENT = 1.5
_TRIES_PER_OBJECT = 100
_GOAL_TRIES = 10_000
_GOAL = 1


@dataclass(frozen=True)
class Layout:
    """The places of M robots and of what is around each of them.

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
    """How much room each object of a task keeps around itself, and how places are drawn.

    Objects are placed one after another, uniformly, and redrawn where they would be too close to
    one that already stands; a layout with an object that finds no place in 100 tries is drawn
    anew from the start.

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
        places = np.stack([self._sample_places(rng) for rng in rngs])
        yaws = np.stack([rng.uniform(0.0, 2 * np.pi, 2) for rng in rngs])
        return Layout(
            robot=np.column_stack([places[:, 0], yaws[:, 0]]),
            goal=places[:, _GOAL],
            hazards=places[:, self._hazards],
            pillars=places[:, self._pillars],
            movable=np.column_stack([places[:, -1], yaws[:, 1]]),
        )

    def sample_goal(self, rng: np.random.Generator, obstacles: np.ndarray) -> np.ndarray | None:
        """Draw a new place for the goal while everything else stays where it is.

        Args:
            rng: the robot's generator.
            obstacles: (2 + H + P, 2) where the robot, the hazards, the pillars and the movable
                thing are now, in this order, in m.

        Returns:
            (2,) x, y in m, or ``None`` when 10 000 tries found no free place.
        """
        for _ in range(_GOAL_TRIES // _TRIES_PER_OBJECT):
            place = _free_place(rng, self.keepouts[_GOAL], obstacles, self._obstacles)
            if place is not None:
                return place
        return None

    def _sample_places(self, rng: np.random.Generator) -> np.ndarray:
        places = np.empty((len(self.keepouts), 2))
        while True:
            placed = 0
            while placed < len(places):
                keepouts = self.keepouts[:placed]
                place = _free_place(rng, self.keepouts[placed], places[:placed], keepouts)
                if place is None:
                    placed = 0
                else:
                    places[placed] = place
                    placed += 1
            # Safety-Gym moves the goal once more before an episode begins.
            goal = self.sample_goal(rng, np.delete(places, _GOAL, axis=0))
            if goal is not None:
                places[_GOAL] = goal
                return places


def _free_place(
    rng: np.random.Generator, keepout: float, others: np.ndarray, other_keepouts: np.ndarray
) -> np.ndarray | None:
    """Return the first of 100 random places that is clear of ``others``, or ``None``."""
    reach = EXTENT - keepout
    # Drawn all at once: the first clear one of a block is what drawing one by one would find.
    tries = rng.uniform(-reach, reach, (_TRIES_PER_OBJECT, 2))
    offset = tries[:, None] - others
    squared = np.einsum('tok,tok->to', offset, offset)
    clear = (squared >= (other_keepouts + keepout) ** 2).all(axis=1)
    first = int(clear.argmax())
    return tries[first] if clear[first] else None
