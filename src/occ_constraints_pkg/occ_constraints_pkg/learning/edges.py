# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where a family with a physical bound ends: the distance from contact that is kept.

A robot that ignores obstacles is within a distance of them for a share of its time that grows with
the square of the distance, as areas in the plane do. Half of the movement is taken to be that
free, and the edge lies where such a robot would be nearer for a given share of its time.

Who keeps a distance is hardly ever far beyond the edge. Where samples beyond it reach evenly down
to contact, nobody kept it: they are bad. Then they are no part of the movement that the edge is
estimated from, however many they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_ESTIMATED = 0.05
"""Share of its time that a demonstrator who ignores obstacles would be beyond an edge, and largest
share of the samples outside in all, if the user states none and no edge has an even tail."""

MOST_EVEN = 0.2
"""Largest share of the samples that an edge leaves outside where they reach evenly to contact."""

# Share of the samples that count as free movement.
_FREE = 0.5
# Beyond an edge, the nearer half of the way to contact has a quarter of the area. It has to have at
# least this share of the samples that it would have if they were even; and so many lie there.
_EVEN, _FEWEST, _MOST_IDLE = 0.6, 8, 0.1
_ROUNDS = 5


@dataclass(frozen=True)
class Edge:
    """The end of one side of a family.

    Attributes:
        distance: from the physical bound.
        beyond: number of samples that are nearer.
        is_even: whether these reach evenly down to contact, as bad ones do.
    """

    distance: float
    beyond: int
    is_even: bool


def estimate_edge(distances: np.ndarray) -> Edge:
    """Estimate where a demonstrator would be too near to the physical bound of a family.

    Args:
        distances: (n,) each sample's nearest member's distance to the bound, 0 or more; at least
            one.
    """
    count = len(distances)
    distance = _scaled(np.partition(distances, count // 2)[count // 2])
    beyond = int(np.count_nonzero(distances < distance))
    half = int(np.count_nonzero(distances < distance / 2))
    # Many at the bound itself are idle sensors at the end of their range.
    idle = int(np.count_nonzero(distances <= 0.0))
    is_even = half >= max(_FEWEST, _EVEN * beyond / 4) and idle <= _MOST_IDLE * half
    if is_even:
        ordered = np.sort(distances)
        for _ in range(_ROUNDS):
            beyond = min(beyond, int(MOST_EVEN * count))
            distance = _scaled(ordered[beyond + (count - beyond) // 2])
            beyond = int(np.searchsorted(ordered, distance))
    return Edge(distance, beyond, is_even)


def _scaled(middle: float) -> float:
    """Return the edge's distance for the median of free movement."""
    return float(middle * np.sqrt(MOST_ESTIMATED / _FREE))
