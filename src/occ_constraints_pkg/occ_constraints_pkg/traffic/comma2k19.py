# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Segments of comma2k19: a minute of one car as NumPy arrays.

Source: the data set's description, github.com/commaai/comma2k19. Times are seconds since the
device started; radar rows are distance ahead of the bumper and to the left in metres, relative
speed, two unused numbers, address of the track, and whether it is new.

The car has no lanes and sees nothing behind or beside it, so of the ten features two are there:
its speed, and the gap to the vehicle ahead that is on its path. The path is the circle on which it
drives at the moment.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.ndimage import gaussian_filter1d

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import open_regular
from occ_constraints_pkg.traffic.plausible import LARGEST, check_motion
from occ_constraints_pkg.traffic.recorded import FARTHEST
from occ_constraints_pkg.traffic.trajectories import Trajectories

_RADAR, _SPEED = 'processed_log/CAN/radar', 'processed_log/CAN/speed'
_POSE = 'global_pose/frame_'
# Half of a lane: what is farther beside the path is on another one.
_HALF_LANE_M = 1.85
# A radar track is renewed 20 times a second; an older one is gone.
_TRACK_SECONDS = 0.1
_SMOOTH_SECONDS = 0.5
_SLOWEST_M_S = 2.0
_GPS_EPOCH, _WEEK = 315_964_800, 604_800
# GPS time has no leap seconds; UTC was so far behind it from 2017 on.
_LEAP_SECONDS = 18


def read_comma2k19(path: Path, progress: Callable[[int, int], None] | None = None) -> Trajectories:
    """Read a segment: one row for each picture of the camera, 20 per second.

    Args:
        path: the segment's directory, with ``processed_log`` and ``global_pose``.
        progress: called with (rows done, rows in all).

    Raises:
        OccError: an array is missing, damaged or of the wrong shape, or speeds are not in m/s.
    """
    if not path.is_dir():
        raise DataError(f'{path} is no directory; allowed is the directory of a segment')
    times = _array(path, f'{_POSE}times', (None,))
    gps = _array(path, f'{_POSE}gps_times', (len(times), 2))
    positions = _array(path, f'{_POSE}positions', (len(times), 3))
    velocities = _array(path, f'{_POSE}velocities', (len(times), 3))
    speed_times = _array(path, f'{_SPEED}/t', (None,))
    speeds = _array(path, f'{_SPEED}/value', (len(speed_times), 1))[:, 0]
    radar_times = _array(path, f'{_RADAR}/t', (None,), empty=True)
    radar = _array(path, f'{_RADAR}/value', (len(radar_times), 7), empty=True, nan=(3, 4))
    for name, column in ((f'{_POSE}times', times), (f'{_SPEED}/t', speed_times)):
        if (np.diff(column) <= 0.0).any():
            row = int(np.argmax(np.diff(column) <= 0.0)) + 1
            raise DataError(f'{path / name}, row {row}: the time does not grow; allowed is growing')
    inside = (times >= speed_times[0]) & (times <= speed_times[-1])
    if not inside.any():
        raise DataError(f'{path}: camera and speed were not recorded at the same time')
    if len(radar_times) and not ((times >= radar_times[0]) & (times <= radar_times[-1])).any():
        raise DataError(f'{path}: camera and radar were not recorded at the same time')
    speed = np.interp(times, speed_times, speeds)
    check_motion(
        f'{path / _SPEED}/value',
        np.zeros(inside.sum(), dtype=np.int64),
        times[inside],
        positions[inside],
        speed[inside],
    )
    curvature = _curvature(times, positions, velocities, speed)
    gaps = np.empty(len(times))
    for row, time in enumerate(times):
        gaps[row] = _gap(radar, radar_times, time, curvature[row])
        if progress is not None and row % 100 == 0:
            progress(row, len(times))
    utc = _GPS_EPOCH - _LEAP_SECONDS + gps[:, 0] * _WEEK + gps[:, 1]
    first = int(np.argmax(inside))
    return Trajectories(
        names=('v_x', 'p_rel4'),
        values=np.stack([speed, gaps], axis=1)[inside],
        vehicle=np.zeros(inside.sum(), dtype=np.int64),
        time=times[inside],
        source={'comma2k19.segment': path.absolute().name},
        start_ns=round(utc[first] * 1e9),
    )


def _array(
    path: Path,
    name: str,
    shape: tuple[int | None, ...],
    *,
    empty: bool = False,
    nan: tuple[int, ...] = (),
) -> np.ndarray:
    """Return an array of finite numbers; None in its shape is any number of rows."""
    file = path / name
    try:
        with open_regular(file) as stream:
            array = np.load(stream, allow_pickle=False)
    except OSError as error:
        raise DataError(f'cannot read {file}: {error.strerror or "it is no array"}') from error
    except DataError:
        raise
    except (ValueError, TypeError, ArithmeticError, MemoryError, EOFError, BadZipFile) as error:
        raise DataError(
            f'{file} is damaged or no array of numbers; allowed is what numpy.save writes'
        ) from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'iuf':
        raise DataError(f'{file} is no array of numbers; allowed is what numpy.save writes')
    fits = len(array.shape) == len(shape) and all(
        want in (None, got) for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits or not (array.size or empty):
        wanted = ', '.join('rows' if size is None else str(size) for size in shape)
        raise DataError(f'{file} has the shape {array.shape}; allowed is ({wanted})')
    array = array.astype(np.float64)
    table = array.reshape(len(array), array.shape[1] if array.ndim > 1 else 1)
    finite = np.abs(table) <= LARGEST
    finite[:, list(nan)] = True
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        raise DataError(
            f'{file}, row {row}, column {column}: got {table[row, column]:g}; '
            f'allowed is a number of at most {LARGEST:g}'
        )
    return array


def _curvature(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, speed: np.ndarray
) -> np.ndarray:
    """Return 1/m how the path bends to the left, from how the velocity turns over ground."""
    up = positions[0] / np.linalg.norm(positions[0])
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    heading = np.unwrap(np.arctan2(velocities @ np.cross(up, east), velocities @ east))
    sigma = _SMOOTH_SECONDS / float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    turn = np.gradient(gaussian_filter1d(heading, sigma), times) if len(times) > 1 else heading * 0
    return np.where(speed > _SLOWEST_M_S, turn / np.maximum(speed, _SLOWEST_M_S), 0.0)


def _gap(radar: np.ndarray, radar_times: np.ndarray, time: float, curvature: float) -> float:
    """Return the distance to the nearest fresh track on the path."""
    begin, end = np.searchsorted(radar_times, [time - _TRACK_SECONDS, time], side='right')
    fresh = radar[begin:end]
    # Of each track the latest row counts.
    _, last = np.unique(fresh[::-1, 5], return_index=True)
    ahead, left = fresh[::-1][last, 0], fresh[::-1][last, 1]
    on_path = np.abs(left - curvature * ahead**2 / 2.0) <= _HALF_LANE_M
    return float(np.clip(ahead[on_path].min(initial=FARTHEST), 0.0, FARTHEST))
