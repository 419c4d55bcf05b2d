# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Seeded highway scenarios: positions, speeds and desired speeds of all vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

FULL = 3000
RESTRICTED = 52
"""Numbers of scenarios in the paper; the restricted set is the first part of the full one."""

TRAFFIC = 20
# Range of how many vehicles the ego starts behind.
_EGO_RANKS = (10, 16)
_LANES = (2, 3)
LANE_WIDTH = 4.0
SPEED_LIMIT = 40.0
# In m/s, lorries and cars, roughly as on German highways.
_DESIRED_SPEEDS = (21.0, 35.0)
_FIRST_SPEEDS = (23.0, 27.0)
_EGO_SPEED = 25.0
_DELTAS = (3.5, 4.5)
# Largest initial lateral offset in m; IDM vehicles drive to the middle and stay there.
_BESIDE = 0.8
_SEED = 20260


@dataclass(frozen=True, eq=False)
class Scenario:
    """The start of a scene; vehicle 0 is the ego.

    Attributes:
        name: for example ``highway-0017``.
        lanes: number of lanes, 2 or 3; lane 0 is the leftmost.
        x: (V,) m along the road.
        y: (V,) m from the middle of lane 0, positive to the right.
        lane: (V,) int, lane of each vehicle, whose middle is within 0.8 m.
        speed: (V,) m/s.
        desired_speed: (V,) m/s; for the ego, that of the car whose place it takes.
        delta: (V,) exponent of the IDM.
    """

    name: str
    lanes: int
    x: np.ndarray
    y: np.ndarray
    lane: np.ndarray
    speed: np.ndarray
    desired_speed: np.ndarray
    delta: np.ndarray


@cache
def scenario(number: int) -> Scenario:
    """Return scenario ``number``, from 0 to :data:`FULL` - 1; always the same.

    Vehicles follow one another at the distances of ``highway-v0`` (12 m plus the distance of one
    second, divided among the lanes, plus or minus a tenth), each in a random lane, up to 0.8 m from
    its middle. One of them is the ego, as the converter of CommonRoad picks a recorded car.
    """
    rng = np.random.default_rng([_SEED, number])
    vehicles = TRAFFIC + 1
    lanes = int(rng.choice(_LANES))
    speed = rng.uniform(*_FIRST_SPEEDS, vehicles)
    spacing = (12.0 + speed) * np.exp(-lanes / 8.0) * rng.uniform(0.9, 1.1, vehicles)
    x = 100.0 + np.cumsum(spacing)
    lane = rng.integers(lanes, size=vehicles)
    y = LANE_WIDTH * lane + rng.uniform(-_BESIDE, _BESIDE, vehicles)
    desired = rng.uniform(*_DESIRED_SPEEDS, vehicles)
    delta = rng.uniform(*_DELTAS, vehicles)
    ego = vehicles - 1 - int(rng.integers(_EGO_RANKS[0], _EGO_RANKS[1] + 1))
    speed[ego] = _EGO_SPEED
    # The ego first, the others in the order of the road.
    order = np.concatenate([[ego], np.delete(np.arange(vehicles), ego)])
    return Scenario(
        f'highway-{number:04d}',
        lanes,
        x[order],
        y[order],
        lane[order],
        speed[order],
        desired[order],
        delta[order],
    )
