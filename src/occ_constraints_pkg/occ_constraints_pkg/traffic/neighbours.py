# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Gaps to the neighbours of a vehicle, found by the lanes that vehicles are on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

LEFT, SAME, RIGHT, ELSEWHERE = 0, 1, 2, -1
"""Where a lane lies, seen from another one."""

_AHEAD = 3
# Boxes that lie so far in one another show two vehicles at one place; less is what measuring from
# above does to bumpers and mirrors.
_INSIDE_ALONG_M, _INSIDE_ACROSS_M = 1.0, 0.5


def gaps_by_lane(
    instant: np.ndarray,
    along: np.ndarray,
    left: np.ndarray,
    size: np.ndarray,
    lane: np.ndarray,
    beside: np.ndarray,
) -> np.ndarray:
    """Return the gap of each vehicle to the next one behind and ahead, on three lanes.

    Who is ahead is told by the centres; of two at one place each is ahead of the other. Two whose
    centres are on one lane but who drive side by side, as while one of them changes lanes, are
    neighbours on the left and on the right.

    Args:
        instant: (n,) the same number for rows of one moment.
        along: (n,) metres, the vehicle's centre along the road, growing in direction of travel.
        left: (n,) metres, its centre to the left of some line along the road.
        size: (n, 2) metres, its length and width.
        lane: (n,) int, number of its lane.
        beside: (lanes, lanes) int, where the second lane lies, seen from the first: one of
            :data:`LEFT`, :data:`SAME`, :data:`RIGHT` and :data:`ELSEWHERE`.

    Returns:
        (n, 6) metres from bumper to bumper: behind on the left, same and right lane, then ahead.
        Below 0 where the two overlap along the road, infinite where there is nobody.
    """
    gaps = np.full((len(along), 6), np.inf)
    for rows in _moments(instant):
        ahead, gap = _apart(along[rows], size[rows, 0])
        to_the_left, room = _apart(left[rows], size[rows, 1])
        side = beside[lane[rows][:, None], lane[rows][None, :]]
        abreast = (side == SAME) & (gap < 0.0) & (room > 0.0)
        side = np.where(abreast, np.where(to_the_left > 0.0, LEFT, RIGHT), side)
        np.fill_diagonal(side, ELSEWHERE)
        for place in (LEFT, SAME, RIGHT):
            there = side == place
            for offset, mask in ((0, there & (ahead < 0.0)), (_AHEAD, there & (ahead >= 0.0))):
                nearest = np.where(mask, gap, np.inf).min(axis=1)
                gaps[rows, place + offset] = nearest
    return gaps


def standing_inside(
    instant: np.ndarray, along: np.ndarray, left: np.ndarray, size: np.ndarray
) -> np.ndarray:
    """Tell for each row whether the vehicle is at the place of another one.

    Args:
        instant: (n,) the same number for rows of one moment.
        along: (n,) metres, the vehicle's centre along the road.
        left: (n,) metres, its centre to the left of some line along the road.
        size: (n, 2) metres, its length and width.

    Returns:
        (n,) bool, true where the boxes of two lie far in one another.
    """
    inside = np.zeros(len(along), dtype=bool)
    for rows in _moments(instant):
        _, gap = _apart(along[rows], size[rows, 0])
        _, room = _apart(left[rows], size[rows, 1])
        both = (gap < -_INSIDE_ALONG_M) & (room < -_INSIDE_ACROSS_M)
        np.fill_diagonal(both, False)
        inside[rows] = both.any(axis=1)
    return inside


def _apart(centre: np.ndarray, extent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, n) how far the second lies from the first, and the room between the two."""
    offset = centre[None, :] - centre[:, None]
    return offset, np.abs(offset) - (extent[None, :] + extent[:, None]) / 2.0


def _moments(instant: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the rows of each moment."""
    order = np.argsort(instant, kind='stable')
    ends = np.flatnonzero(np.diff(instant[order])) + 1
    yield from np.split(order, ends)


def lanes_in_a_row(numbers: np.ndarray) -> np.ndarray:
    """Return (lanes, lanes) what lies beside what, given the lanes' numbers from left to right."""
    return side_of(numbers[None, :] - numbers[:, None])


def side_of(steps: np.ndarray) -> np.ndarray:
    """Return where lanes lie that are so many lanes to the right; -1 is the one to the left."""
    return np.where(np.abs(steps) <= 1, steps + SAME, ELSEWHERE)
