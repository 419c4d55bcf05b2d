# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Checks that tell a wrong unit, which no format marks, from the numbers themselves."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.errors import DataError

# A kilometre per hour is 0.28 m/s, a foot per second 0.30, a mile per hour 0.45.
_LEAST_RATIO, _MOST_RATIO = 0.7, 1.4
# Below this speed, noise of the positions outweighs the movement.
_MOVING_M_S = 2.0
_FASTEST_M_S = 150.0
# Vehicles head where they go, by 45 degrees or less even when they drift or crawl.
_LEAST_COSINE = 0.7
LARGEST = 1e9
"""No number of a recording is larger, in whichever unit; squares of these can be added up."""

_LANE_M = (2.0, 8.0)
_LENGTH_M = (0.5, 40.0)


def implausible_motion(
    vehicle: np.ndarray, time: np.ndarray, place: np.ndarray, speed: np.ndarray
) -> tuple[int, str] | None:
    """Look for jumps, and compare stated speeds with how fast the positions change.

    Args:
        vehicle: (n,) who; the rows of one together and in order of time.
        time: (n,) seconds.
        place: (n, axes) metres.
        speed: (n,) m/s, stated.

    Returns:
        None where nothing is wrong; else the first row where something is, and what it is.
    """
    steps = np.diff(time)
    rows = np.flatnonzero((np.diff(vehicle) == 0) & (steps > 0))
    moved = np.linalg.norm(place[rows + 1] - place[rows], axis=1) / steps[rows]
    jumps = moved > _FASTEST_M_S
    if jumps.any() and jumps.mean() < 0.5:
        row = int(np.argmax(jumps))
        return int(rows[row]), (
            f'jumps, at {moved[row]:.4g} m/s to the next position; allowed are {_FASTEST_M_S:g}'
        )
    rows, moved = rows[moved > _MOVING_M_S], moved[moved > _MOVING_M_S]
    if not len(rows):
        return None
    ratio = np.abs(speed[rows]) / moved
    median = float(np.median(ratio))
    if _LEAST_RATIO <= median <= _MOST_RATIO:
        return None
    wrong = (ratio < _LEAST_RATIO) | (ratio > _MOST_RATIO)
    return int(rows[np.argmax(wrong)]), (
        f'has speeds that are {median:.3g} times what positions and times say; '
        'allowed are metres, seconds and m/s'
    )


def check_motion(
    where: str, vehicle: np.ndarray, time: np.ndarray, place: np.ndarray, speed: np.ndarray
) -> None:
    """Refuse jumps, and speeds that are in another unit than positions and times.

    Args:
        where: what errors call the speeds: file and column.
        vehicle: (n,) who; the rows of one together and in order of time.
        time: (n,) seconds.
        place: (n, axes) metres.
        speed: (n,) m/s, stated.

    Raises:
        OccError: there are such.
    """
    found = implausible_motion(vehicle, time, place, speed)
    if found is not None:
        row, sentence = found
        raise DataError(f'{where}: vehicle {vehicle[row]}, at {time[row]:.8g} s, {sentence}')


def implausible_heading(
    vehicle: np.ndarray, time: np.ndarray, place: np.ndarray, heading: np.ndarray
) -> int | None:
    """Compare where vehicles are said to head with where they go; angles may be in degrees.

    Args:
        vehicle: (n,) who; the rows of one together and in order of time.
        time: (n,) seconds.
        place: (n, 2) metres.
        heading: (n,) rad from the first axis to the second.

    Returns:
        None where the two agree in most rows; else the first row in which they do not.
    """
    steps = np.diff(time)
    rows = np.flatnonzero((np.diff(vehicle) == 0) & (steps > 0))
    moved = (place[rows + 1] - place[rows]) / steps[rows, None]
    speed = np.linalg.norm(moved, axis=1)
    rows, moved = rows[speed > _MOVING_M_S], moved[speed > _MOVING_M_S]
    if not len(rows):
        return None
    ahead = np.stack([np.cos(heading[rows]), np.sin(heading[rows])], axis=1)
    cosine = (ahead * moved).sum(axis=1) / speed[speed > _MOVING_M_S]
    if float(np.median(cosine)) >= _LEAST_COSINE:
        return None
    return int(rows[np.argmax(cosine < _LEAST_COSINE)])


OTHER_WAY = 'heads elsewhere than its positions go, as do most; allowed are radians'


def check_lane_width(where: str, width: float) -> None:
    """Refuse lanes that no road has, which shows that positions are not in metres.

    Raises:
        OccError: the width is out of the ordinary, or not finite.
    """
    low, high = _LANE_M
    if not low <= width <= high:
        raise DataError(
            f'{where}: the lane is {width:.4g} m wide; allowed are {low:g} to {high:g} m'
        )


def is_length(length: np.ndarray | float) -> np.ndarray:
    """Tell for each number whether a vehicle may be so many metres long."""
    low, high = _LENGTH_M
    return (np.asarray(length) >= low) & (np.asarray(length) <= high)


ALLOWED_LENGTH = f'allowed are {_LENGTH_M[0]:g} to {_LENGTH_M[1]:g} m'
