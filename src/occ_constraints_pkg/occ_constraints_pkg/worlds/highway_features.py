# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The features of the paper: a vehicle's velocity, its gaps to neighbours and road edges."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.worlds.highway_scenarios import LANE_WIDTH
from occ_constraints_pkg.worlds.highway_traffic import (
    LANE,
    LENGTH,
    MOST_LANES,
    SPEED,
    Traffic,
    X,
    Y,
)

FAR = 500.0
"""Distance of an absent neighbour, and the maximum of a present one, in m."""

_SIDES = np.array([-1, 0, 1])

NAMES = ('v_x', 'v_y', *(f'p_rel{i}' for i in range(6)), 'd_left', 'd_right')
"""Velocity ahead and to the left in m/s; gaps to the vehicles behind in the left, same and right
lane and ahead in these, in m; distances of the centre to the left and the right edge, in m."""


def features(traffic: Traffic, rows: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """Return the ten features of some vehicles; see :func:`surroundings`."""
    return surroundings(traffic, rows, scenes)[0]


def surroundings(
    traffic: Traffic, rows: np.ndarray, scenes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ten features of some vehicles, and the relative speeds of their neighbours.

    Args:
        traffic: the scenes.
        rows: (n,) of the vehicles.
        scenes: (n,) their scenes.

    Returns:
        (n, 10) float64 in the order of :data:`NAMES`, and (n, 6) speeds of the neighbours along
        the road relative to the vehicle's own, in m/s, 0 where there is no neighbour. A neighbour
        counts in every lane whose middle is within 3 m; a gap is 0 where the two are side by side.
    """
    vehicles = len(traffic.cos)
    x, along = traffic.real[X], traffic.real[SPEED] * traffic.cos
    y, lanes = traffic.real[Y][rows, scenes], traffic.lanes[scenes]
    # In the order of the gaps: three lanes behind, three lanes ahead.
    sides = traffic.whole[LANE][rows, scenes][:, None] + _SIDES
    place = rows[:, None], np.clip(sides, 0, MOST_LANES - 1), scenes[:, None]
    other = np.concatenate([traffic.behind[place], traffic.ahead[place]], axis=1)
    is_lane = (sides >= 0) & (sides < lanes[:, None])
    there = np.concatenate([is_lane, is_lane], axis=1) & (other >= 0) & (other < vehicles)
    found = np.where(there, other, rows[:, None]), scenes[:, None]
    gaps = np.clip(np.abs(x[found] - x[rows, scenes][:, None]) - LENGTH, 0.0, FAR)
    own = along[rows, scenes]
    values = np.empty((len(rows), len(NAMES)))
    values[:, 0] = own
    # y grows to the right.
    values[:, 1] = -traffic.real[SPEED][rows, scenes] * traffic.sin[rows, scenes]
    values[:, 2:8] = np.where(there, gaps, FAR)
    values[:, 8] = y + LANE_WIDTH / 2
    values[:, 9] = LANE_WIDTH * (lanes - 0.5) - y
    return values, along[found] - own[:, None]
