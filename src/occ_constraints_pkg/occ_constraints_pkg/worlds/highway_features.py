# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a vehicle on a highway knows of its neighbours and the edges, as in the paper's experiment."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.worlds.highway_scenarios import LANE_WIDTH
from occ_constraints_pkg.worlds.highway_traffic import (
    HEADING,
    LANE,
    LENGTH,
    MOST_LANES,
    SPEED,
    Traffic,
    X,
    Y,
)

FAR = 500.0
"""The distance of a neighbour that is not there, and the largest of one that is, in m."""

NAMES = ('v_x', 'v_y', *(f'p_rel{i}' for i in range(6)), 'd_left', 'd_right')
"""Velocity ahead and to the left in m/s; gaps to the vehicles behind in the left, same and right
lane and ahead in these, in m; distances of the centre to the left and the right edge, in m."""


def features(traffic: Traffic, rows: np.ndarray, scenes: np.ndarray) -> np.ndarray:
    """Return the ten features of some vehicles.

    Args:
        traffic: the scenes.
        rows: (n,) of the vehicles.
        scenes: (n,) their scenes.

    Returns:
        (n, 10) float64, in the order of :data:`NAMES`. A neighbour counts in every lane whose middle
        is within 3 m; a gap is 0 where the two are side by side.
    """
    gaps, _ = neighbours(traffic, rows, scenes)
    y, speed = traffic.real[Y][rows, scenes], traffic.real[SPEED][rows, scenes]
    heading = traffic.real[HEADING][rows, scenes]
    return np.column_stack(
        [
            speed * np.cos(heading),
            # y grows to the right.
            -speed * np.sin(heading),
            gaps,
            y + LANE_WIDTH / 2,
            LANE_WIDTH * (traffic.lanes[scenes] - 0.5) - y,
        ]
    )


def neighbours(
    traffic: Traffic, rows: np.ndarray, scenes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return gaps to the six neighbours of some vehicles, and how fast these go.

    Args:
        traffic: the scenes.
        rows: (n,) of the vehicles.
        scenes: (n,) their scenes.

    Returns:
        (n, 6) gaps in m and (n, 6) speeds along the road relative to the vehicle's own in m/s, 0
        where there is no neighbour.
    """
    vehicles = len(traffic.cos)
    x, along = traffic.real[X], traffic.real[SPEED] * traffic.cos
    own_x, own_along = x[rows, scenes], along[rows, scenes]
    gaps, relative = np.full((len(rows), 6), FAR), np.zeros((len(rows), 6))
    for place in range(6):
        table, side = (traffic.behind, traffic.ahead)[place // 3], place % 3 - 1
        lane = traffic.whole[LANE][rows, scenes] + side
        is_lane = (lane >= 0) & (lane < traffic.lanes[scenes])
        other = table[rows, np.clip(lane, 0, MOST_LANES - 1), scenes]
        there = np.flatnonzero(is_lane & (other >= 0) & (other < vehicles))
        found = other[there], scenes[there]
        gap = np.abs(x[found] - own_x[there]) - LENGTH
        gaps[there, place] = np.clip(gap, 0.0, FAR)
        relative[there, place] = along[found] - own_along[there]
    return gaps, relative
