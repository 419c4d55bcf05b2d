# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where things stand when an episode of PointGoal1 begins: random places that keep clear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Safety-Gym, Goal level 1: objects lie within +-1.5 m, each at least its keepout from the edge,
# and two of them at least the sum of their keepouts apart.
EXTENT = 1.5
NUM_HAZARDS = 8
ROBOT_KEEPOUT, GOAL_KEEPOUT, HAZARD_KEEPOUT, VASE_KEEPOUT = 0.4, 0.305, 0.18, 0.15
_ORDER = np.array([ROBOT_KEEPOUT, GOAL_KEEPOUT] + [HAZARD_KEEPOUT] * NUM_HAZARDS + [VASE_KEEPOUT])
_TRIES_PER_OBJECT = 100
_GOAL_TRIES = 10_000
# Everything but the goal, in the order of ``sample_goal``'s obstacles: robot, hazards, vase.
_OBSTACLE_KEEPOUTS = np.delete(_ORDER, 1)


@dataclass(frozen=True)
class Layout:
    """The places of M robots and of what is around each of them.

    Attributes:
        robot: (M, 3) x, y in m and yaw in rad.
        goal: (M, 2) x, y in m.
        hazards: (M, 8, 2) x, y in m.
        vase: (M, 3) x, y in m and yaw in rad.
    """

    robot: np.ndarray
    goal: np.ndarray
    hazards: np.ndarray
    vase: np.ndarray


def sample_layout(rngs: list[np.random.Generator]) -> Layout:
    """Draw one layout from each generator.

    Objects are placed one after another, uniformly, and redrawn where they would be too close to
    one that already stands; a layout with an object that finds no place in 100 tries is drawn
    anew from the start.
    """
    places = np.stack([_sample_places(rng) for rng in rngs])
    yaws = np.stack([rng.uniform(0.0, 2 * np.pi, 2) for rng in rngs])
    return Layout(
        robot=np.column_stack([places[:, 0], yaws[:, 0]]),
        goal=places[:, 1],
        hazards=places[:, 2:-1],
        vase=np.column_stack([places[:, -1], yaws[:, 1]]),
    )


def sample_goal(rng: np.random.Generator, obstacles: np.ndarray) -> np.ndarray | None:
    """Draw a new place for the goal while everything else stays where it is.

    Args:
        rng: the robot's generator.
        obstacles: (10, 2) where the robot, the hazards and the vase are now, in this order, in m.

    Returns:
        (2,) x, y in m, or ``None`` when 10 000 tries found no free place.
    """
    for _ in range(_GOAL_TRIES // _TRIES_PER_OBJECT):
        place = _free_place(rng, GOAL_KEEPOUT, obstacles, _OBSTACLE_KEEPOUTS)
        if place is not None:
            return place
    return None


def _sample_places(rng: np.random.Generator) -> np.ndarray:
    places = np.empty((len(_ORDER), 2))
    placed = 0
    while placed < len(_ORDER):
        place = _free_place(rng, _ORDER[placed], places[:placed], _ORDER[:placed])
        if place is None:
            placed = 0
        else:
            places[placed] = place
            placed += 1
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
