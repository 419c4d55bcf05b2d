# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Checks that tell a wrong unit, which no format marks, from the numbers themselves."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.errors import OccError

# A kilometre per hour is 0.28 m/s, a foot per second 0.30, a mile per hour 0.45.
_LEAST_RATIO, _MOST_RATIO = 0.7, 1.4
# Below this speed, noise of the positions outweighs the movement.
_MOVING_M_S = 2.0
_LANE_M = (2.0, 8.0)
_LENGTH_M = (0.5, 40.0)


def disagreeing_speed(
    vehicle: np.ndarray, time: np.ndarray, place: np.ndarray, speed: np.ndarray
) -> tuple[int, float] | None:
    """Compare stated speeds with how fast the positions change.

    Args:
        vehicle: (n,) who; the rows of one together and in order of time.
        time: (n,) seconds.
        place: (n, axes) metres.
        speed: (n,) m/s, stated.

    Returns:
        None where they agree; else the first row where they do not, and the median of stated by
        real speed.
    """
    steps = np.diff(time)
    rows = np.flatnonzero((np.diff(vehicle) == 0) & (steps > 0))
    moved = np.linalg.norm(place[rows + 1] - place[rows], axis=1) / steps[rows]
    rows, moved = rows[moved > _MOVING_M_S], moved[moved > _MOVING_M_S]
    if not len(rows):
        return None
    ratio = np.abs(speed[rows]) / moved
    median = float(np.median(ratio))
    if _LEAST_RATIO <= median <= _MOST_RATIO:
        return None
    wrong = (ratio < _LEAST_RATIO) | (ratio > _MOST_RATIO)
    return int(rows[np.argmax(wrong)]), median


def check_speed(
    where: str, vehicle: np.ndarray, time: np.ndarray, place: np.ndarray, speed: np.ndarray
) -> None:
    """Refuse speeds that are in another unit than positions and times.

    Args:
        where: what errors call the speeds: file and column.
        vehicle: (n,) who; the rows of one together and in order of time.
        time: (n,) seconds.
        place: (n, axes) metres.
        speed: (n,) m/s, stated.

    Raises:
        OccError: they are.
    """
    found = disagreeing_speed(vehicle, time, place, speed)
    if found is not None:
        row, median = found
        raise OccError(
            f'{where}: speeds are {median:.3g} times what the positions say, first of vehicle '
            f'{vehicle[row]} at {time[row]:.6g} s; allowed are metres, seconds and m/s'
        )


def check_lane_width(where: str, width: float) -> None:
    """Refuse lanes that no road has, which shows that positions are not in metres.

    Raises:
        OccError: the width is out of the ordinary, or not finite.
    """
    low, high = _LANE_M
    if not low <= width <= high:
        raise OccError(
            f'{where}: the lane is {width:.4g} m wide; allowed are {low:g} to {high:g} m'
        )


def is_length(length: np.ndarray | float) -> np.ndarray:
    """Tell for each number whether a vehicle may be so many metres long."""
    low, high = _LENGTH_M
    return (np.asarray(length) >= low) & (np.asarray(length) <= high)


ALLOWED_LENGTH = f'allowed are {_LENGTH_M[0]:g} to {_LENGTH_M[1]:g} m'
