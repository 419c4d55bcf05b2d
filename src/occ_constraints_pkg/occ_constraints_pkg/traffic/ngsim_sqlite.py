# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""NGSIM recordings as SQLite, the form in which SMARTS keeps traffic histories (``.shf``).

Positions are the centres of the vehicles, in metres, speeds in m/s. A heading of 0 points along +y
and grows counter-clockwise; the road's is ``default_heading`` in the table Spec. Lanes are numbered
from 1 on the left. How the lanes run is not in the file: it is estimated from who drives on them.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.traffic.neighbours import (
    gaps_by_lane,
    lanes_in_a_row,
    standing_inside,
)
from occ_constraints_pkg.traffic.plausible import (
    ALLOWED_LENGTH,
    LARGEST,
    OTHER_WAY,
    check_lane_width,
    check_motion,
    implausible_heading,
    is_length,
)
from occ_constraints_pkg.traffic.recorded import Traffic

_TABLES = {
    'Spec': ('key', 'value'),
    'Vehicle': ('id', 'length', 'width'),
    'Trajectory': (
        'vehicle_id', 'sim_time', 'position_x', 'position_y', 'heading_rad', 'speed', 'lane_id',
    ),
}  # fmt: skip
_SOURCE = 'NGSIM'
# The middle of a lane is where half of its vehicles within so many metres drive.
_BIN_M = 20.0
# So many lane widths from the middle of its lane a vehicle is well on another one; a share may be.
_FAR_FROM_MIDDLE, _MOST_FAR = 0.75, 0.05
_READ_AT_ONCE = 5000


def read_ngsim_sqlite(path: Path, progress: Callable[[int, int], None] | None = None) -> Traffic:
    """Read the vehicles of a recording.

    Args:
        path: the SQLite file.
        progress: called with (rows read, rows in all).

    Raises:
        OccError: the file is no such database, or is damaged; the sentence names the table, the
            row and the column.
    """
    try:
        with path.open('rb') as stream:
            is_database = stream.read(16) == b'SQLite format 3\0'
    except OSError as error:
        raise DataError(f'cannot read {path}: {error.strerror}') from error
    if not is_database:
        raise DataError(f'{path} is no SQLite database; allowed is one with {_needed()}')
    uri = f'{path.absolute().as_uri()}?mode=ro&immutable=1'
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.text_factory = lambda data: data.decode('utf-8', 'replace')
            _check_tables(database, path)
            spec = dict(database.execute('SELECT key, value FROM Spec'))
            sizes = _numbers(database, path, 'Vehicle', None)
            rows = _numbers(database, path, 'Trajectory', progress)
    except DataError:
        raise
    except (sqlite3.Error, OverflowError, ValueError) as error:
        # The last when a damaged schema cannot even be quoted.
        reason = ' '.join(str(error).split())
        raise DataError(f'{path} cannot be read: {reason}') from error
    if not len(rows):
        raise DataError(f'{path}: the table Trajectory has no rows; allowed are one or more')
    return _traffic(path, spec, sizes, rows)


def _needed() -> str:
    return ' and '.join(f'{name} ({", ".join(columns)})' for name, columns in _TABLES.items())


def _check_tables(database: sqlite3.Connection, path: Path) -> None:
    names = {
        name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    }
    for table, columns in _TABLES.items():
        if table not in names:
            there = ', '.join(sorted(names)) or 'none'
            raise DataError(f'{path} has no table {table!r}; its tables are {there}')
        there = [row[1] for row in database.execute(f'PRAGMA table_info({table})')]
        for column in columns:
            if column not in there:
                raise DataError(
                    f'{path}: the table {table} has no column {column!r}; '
                    f'its columns are {", ".join(there)}'
                )


def _numbers(
    database: sqlite3.Connection,
    path: Path,
    table: str,
    progress: Callable[[int, int], None] | None,
) -> np.ndarray:
    """Return the columns of a table as (n, columns), in the order of its first two."""
    columns = _TABLES[table]
    (total,) = database.execute(f'SELECT count(*) FROM {table}').fetchone()
    cursor = database.execute(f'SELECT {", ".join(columns)} FROM {table} ORDER BY 1, 2')
    parts = [np.empty((0, len(columns)))]
    done = 0
    while rows := cursor.fetchmany(_READ_AT_ONCE):
        for row in rows:
            for name, value in zip(columns, row, strict=True):
                if not isinstance(value, int | float) or not abs(value) <= LARGEST:
                    raise DataError(
                        f'{path}: table {table}, row of {_row_name(columns, row)}, column '
                        f'{name!r}: got {_shown(value)}; allowed is a number of at most '
                        f'{LARGEST:g}'
                    )
        parts.append(np.array(rows, dtype=np.float64))
        done += len(rows)
        if progress is not None:
            progress(done, total)
    return np.concatenate(parts)


def _row_name(columns: tuple[str, ...], row: tuple[Any, ...]) -> str:
    count = 2 if columns[1] == 'sim_time' else 1
    key = zip(columns[:count], row[:count], strict=True)
    return ', '.join(f'{name} {_shown(value)}' for name, value in key)


def _shown(value: Any) -> str:
    return 'nothing' if value is None else repr(value)[:40]


def _traffic(path: Path, spec: dict[Any, Any], sizes: np.ndarray, rows: np.ndarray) -> Traffic:
    if spec.get('source_type') != _SOURCE:
        raise DataError(
            f"{path}: table Spec, key 'source_type': got {_shown(spec.get('source_type'))}; "
            f'allowed is {_SOURCE!r}'
        )
    heading, width = (_specified(path, spec, key) for key in ('default_heading', 'map_lane_width'))
    check_lane_width(f"{path}: table Spec, key 'map_lane_width'", width)
    vehicle, time, speed, lane = rows[:, 0].astype(np.int64), rows[:, 1], rows[:, 5], rows[:, 6]
    size = _sizes_of(path, sizes, vehicle, time)
    again = np.flatnonzero((np.diff(vehicle) == 0) & (np.diff(time) <= 0.0))
    if len(again):
        raise DataError(
            f'{path}: table Trajectory has vehicle_id {vehicle[again[0]]} twice at sim_time '
            f'{time[again[0]]:g}; allowed is one row for each moment'
        )
    unknown = (lane < 1) | (lane != np.floor(lane))
    if unknown.any():
        row = int(np.argmax(unknown))
        raise DataError(
            f'{path}: table Trajectory, row of vehicle_id {vehicle[row]}, sim_time {time[row]:g}, '
            f"column 'lane_id': got {lane[row]:g}; allowed are whole numbers from 1 on the left"
        )
    check_motion(f'{path}: table Trajectory, column speed', vehicle, time, rows[:, 2:4], speed)
    strayed = implausible_heading(vehicle, time, rows[:, 2:4], rows[:, 4] + math.pi / 2.0)
    if strayed is not None:
        raise DataError(
            f'{path}: table Trajectory, column heading_rad: vehicle {vehicle[strayed]}, at '
            f'{time[strayed]:.8g} s, {OTHER_WAY}'
        )
    forward = np.array([-math.sin(heading), math.cos(heading)])
    along = rows[:, 2:4] @ forward
    left = rows[:, 2:4] @ np.array([-forward[1], forward[0]])
    lanes, number = np.unique(lane, return_inverse=True)
    middles = [_Middle(along[lane == name], left[lane == name]) for name in lanes]
    for name, middle in zip(lanes, middles, strict=True):
        _check_within(path, name, left[lane == name] - middle.left(along[lane == name]), width)
    _check_order(path, lanes, [float(np.median(left[lane == name])) for name in lanes], width)
    outer_left, outer_right = _edges(middles, along, width)
    _, instant = np.unique(np.round(time, 3), return_inverse=True)
    warnings = ()
    if len(lanes) == 1:
        warnings = (
            f'{path}: all vehicles are on lane {lanes[0]:g}, so d_left and d_right are taken to '
            'the edges of this lane, and nothing shows what is on a lane beside it',
        )
    turn = rows[:, 4] - heading
    return Traffic(
        vehicle=vehicle,
        time=time,
        v_x=speed * np.cos(turn),
        v_y=speed * np.sin(turn),
        gaps=gaps_by_lane(instant, along, left, size, number, lanes_in_a_row(lanes.astype(int))),
        inside=standing_inside(instant, along, left, size),
        d_left=outer_left - left,
        d_right=left - outer_right,
        source={f'ngsim.{key}': str(spec[key]) for key in ('name', 'source_type') if spec.get(key)},
        warnings=warnings,
    )


def _specified(path: Path, spec: dict[Any, Any], key: str) -> float:
    try:
        number = float(spec.get(key))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise DataError(
            f'{path}: table Spec, key {key!r}: got {_shown(spec.get(key))}; '
            'allowed is a finite number'
        )
    return number


def _sizes_of(path: Path, sizes: np.ndarray, vehicle: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return (n, 2) length and width of the vehicle of each row."""
    wrong = np.flatnonzero(~is_length(sizes[:, 1]))
    if len(wrong):
        number, length = sizes[wrong[0], :2]
        raise DataError(
            f"{path}: table Vehicle, row of id {number:g}, column 'length': got {length:g} m; "
            f'{ALLOWED_LENGTH}'
        )
    known = sizes[:, 0].astype(np.int64)
    place = np.searchsorted(known, vehicle)
    # A number that is in no table stands at the end, for what lies beyond.
    strange = np.append(known, vehicle.min() - 1)[place] != vehicle
    if strange.any():
        row = int(np.argmax(strange))
        raise DataError(
            f"{path}: table Trajectory, row of sim_time {time[row]:g}, column 'vehicle_id': "
            f'got {vehicle[row]}, which the table Vehicle does not have'
        )
    return sizes[place, 1:]


class _Middle:
    """The middle of a lane over the way, where the median of its vehicles is."""

    def __init__(self, along: np.ndarray, left: np.ndarray) -> None:
        self.begin, self.end = float(along.min()), float(along.max())
        numbers = np.floor(along / _BIN_M)
        bins = np.unique(numbers)
        self._at = (bins + 0.5) * _BIN_M
        self._left = np.array([np.median(left[numbers == number]) for number in bins])

    def left(self, along: np.ndarray) -> np.ndarray:
        return np.interp(along, self._at, self._left)


def _edges(
    middles: list[_Middle], along: np.ndarray, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and the right edge of the road at each place.

    The leftmost lane is there all along; on the right, where ramps come and go, a lane is taken to
    be there from the first to the last place at which somebody drives on it.
    """
    outer_right = np.full(len(along), np.inf)
    for middle in middles:
        there = (along >= middle.begin) & (along <= middle.end)
        right = middle.left(along) - width / 2.0
        outer_right = np.where(there, np.minimum(outer_right, right), outer_right)
    return middles[0].left(along) + width / 2.0, outer_right


def _check_within(path: Path, lane: float, beside: np.ndarray, width: float) -> None:
    """Refuse a lane whose vehicles drive on several; ``beside`` is metres from its middle."""
    share = float((np.abs(beside) > _FAR_FROM_MIDDLE * width).mean())
    if share > _MOST_FAR:
        raise DataError(
            f"{path}: table Trajectory, column 'lane_id': {share:.0%} of the rows of lane {lane:g} "
            f'are more than {_FAR_FROM_MIDDLE * width:g} m beside its middle, so it does not tell '
            f'the lanes apart; allowed are {_MOST_FAR:.0%}'
        )


def _check_order(path: Path, lanes: np.ndarray, lefts: list[float], width: float) -> None:
    """Refuse lanes that lie in one another or are not numbered from the left."""
    for place in range(len(lanes) - 1):
        apart = lefts[place] - lefts[place + 1]
        if apart < width / 2.0:
            raise DataError(
                f"{path}: table Trajectory, column 'lane_id': lanes {lanes[place]:g} and "
                f'{lanes[place + 1]:g} overlap or are not numbered from the left: vehicles on the '
                f'second are {apart:.3g} m to the right; allowed is half a lane, {width / 2:g} m, '
                'or more'
            )
