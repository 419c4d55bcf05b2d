# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings in the format of highD: three CSV files for each.

Source: the public description of the format, levelxdata.com/highd-dataset. Positions are upper left
corners of boxes in the picture, in metres, y downwards; ``width`` of a box is the length of the
vehicle. Vehicles of direction 1 drive on the upper carriageway towards -x, so their left is +y;
those of direction 2 drive on the lower one towards +x, and their left is -y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.traffic.csv_file import CsvFile
from occ_constraints_pkg.traffic.neighbours import standing_inside
from occ_constraints_pkg.traffic.plausible import (
    ALLOWED_LENGTH,
    check_lane_width,
    implausible_motion,
    is_length,
)
from occ_constraints_pkg.traffic.recorded import Traffic

_ENDING = '_tracks.csv'
_NUMBERS = ('x', 'y', 'width', 'height', 'xVelocity', 'yVelocity')
# The neighbours that may be behind and ahead on the left, the same and the right lane. Who is
# alongside counts as behind or as ahead by its centre.
_BEHIND = ('leftFollowingId', 'followingId', 'rightFollowingId')
_AHEAD = ('leftPrecedingId', 'precedingId', 'rightPrecedingId')
_ALONGSIDE = ('leftAlongsideId', None, 'rightAlongsideId')
_NEIGHBOURS = (*_BEHIND, *_AHEAD, 'leftAlongsideId', 'rightAlongsideId')
_UPPER, _LOWER = 1, 2
_MARKINGS = {_UPPER: 'upperLaneMarkings', _LOWER: 'lowerLaneMarkings'}
# Slower than this, the sign of a speed says nothing.
_ROLLING_M_S = 1.0


@dataclass(frozen=True, eq=False)
class _Recording:
    """What stands in XX_recordingMeta.csv."""

    path: Path
    frame_rate: float
    markings: dict[int, list[float]]
    said: dict[str, str]


def read_highd(path: Path, progress: Callable[[int, int], None] | None = None) -> Traffic:
    """Read the vehicles of a recording, of both carriageways.

    Args:
        path: ``XX_tracks.csv``; ``XX_tracksMeta.csv`` and ``XX_recordingMeta.csv`` lie beside it.
        progress: called with (bytes read, bytes in all).

    Raises:
        OccError: a file is missing, not of that format or damaged; the sentence names line and
            column.
    """
    if not path.name.endswith(_ENDING):
        raise DataError(f'{path} is no file of tracks; allowed is a name that ends in {_ENDING}')
    number = path.name.removesuffix(_ENDING)
    recording = _read_recording(path.with_name(f'{number}_recordingMeta.csv'))
    meta = CsvFile(
        path.with_name(f'{number}_tracksMeta.csv'),
        integers=('id', 'numFrames', 'drivingDirection'),
    )
    meta.check(
        (meta['drivingDirection'] != _UPPER) & (meta['drivingDirection'] != _LOWER),
        'drivingDirection',
        'are 1 and 2',
    )
    tracks = CsvFile(
        path, numbers=_NUMBERS, integers=('frame', 'id', *_NEIGHBOURS), progress=progress
    )
    direction = _directions(tracks, meta)
    _check_tracks(tracks, direction, recording)
    # What grows in the direction of travel, and what grows to the left of it.
    forward = np.where(direction == _UPPER, -1.0, 1.0)
    along = (tracks['x'] + tracks['width'] / 2.0) * forward
    across = tracks['y'] + tracks['height'] / 2.0
    size = np.stack([tracks['width'], tracks['height']], axis=1)
    edges = _edges(recording, direction, tracks)
    # Carriageways never meet: told apart, vehicles of one are not inside those of the other.
    moment = 2 * tracks['frame'] + (direction == _UPPER)
    return Traffic(
        vehicle=tracks['id'],
        time=tracks['frame'] / recording.frame_rate,
        v_x=tracks['xVelocity'] * forward,
        v_y=-tracks['yVelocity'] * forward,
        gaps=_gaps(tracks, along),
        inside=standing_inside(moment, along, across, size),
        d_left=np.where(direction == _UPPER, edges[1] - across, across - edges[0]),
        d_right=np.where(direction == _UPPER, across - edges[0], edges[1] - across),
        source={f'highd.{key}': value for key, value in recording.said.items()},
    )


def _read_recording(path: Path) -> _Recording:
    texts = ('id', *_MARKINGS.values())
    file = CsvFile(path, numbers=('frameRate',), texts=texts)
    file.check(file['frameRate'] <= 0.0, 'frameRate', 'are pictures per second above 0')
    markings: dict[int, list[float]] = {}
    for direction, column in _MARKINGS.items():
        text = file.text(column, 0)
        try:
            values = [float(part) for part in text.split(';') if part.strip()]
        except ValueError:
            values = []
        if not np.isfinite(values).all() or len(values) < 2:
            file.fail(
                0, column, f'got {text[:60]!r}; allowed are two or more numbers with ; between'
            )
        if (np.diff(values) <= 0.0).any():
            file.fail(0, column, f'got {text[:60]!r}, lanes that overlap; allowed are growing y')
        for low, high in zip(values, values[1:], strict=False):
            check_lane_width(f'{path}, line 2, column {column!r}', high - low)
        markings[direction] = values
    if markings[_UPPER][-1] > markings[_LOWER][0]:
        file.fail(
            0,
            _MARKINGS[_LOWER],
            f'begins at {markings[_LOWER][0]:g} m, so that its lanes overlap those of '
            f'{_MARKINGS[_UPPER]}, which end at {markings[_UPPER][-1]:g} m; allowed is below them',
        )
    return _Recording(
        path, float(file['frameRate'][0]), markings, {'recording': file.text('id', 0)}
    )


def _directions(tracks: CsvFile, meta: CsvFile) -> np.ndarray:
    """Return the direction of travel of each row, and check that all rows are there."""
    known, first, count = np.unique(meta['id'], return_index=True, return_counts=True)
    if (count > 1).any():
        twice = known[count > 1][0]
        row = int(np.flatnonzero(meta['id'] == twice)[1])
        meta.fail(row, 'id', f'got {twice} a second time; allowed is one row for each vehicle')
    place = np.minimum(np.searchsorted(known, tracks['id']), len(known) - 1)
    strange = known[place] != tracks['id']
    tracks.check(strange, 'id', f'are the vehicles of {meta.path.name}')
    rows = np.bincount(place, minlength=len(known))
    lacking = rows != meta['numFrames'][first]
    if lacking.any():
        row = int(first[np.argmax(lacking)])
        meta.fail(
            row,
            'numFrames',
            f'got {meta["numFrames"][row]} for vehicle {meta["id"][row]}, of which '
            f'{tracks.path.name} has {rows[np.argmax(lacking)]} rows; allowed is the same number',
        )
    return meta['drivingDirection'][first][place]


def _check_tracks(tracks: CsvFile, direction: np.ndarray, recording: _Recording) -> None:
    tracks.check(~is_length(tracks['width']), 'width', ALLOWED_LENGTH.removeprefix('allowed '))
    order = np.lexsort((tracks['frame'], tracks['id']))
    frame, vehicle = tracks['frame'][order], tracks['id'][order]
    step = np.diff(frame)
    broken = np.zeros(len(order), dtype=bool)
    broken[order[1:][(np.diff(vehicle) == 0) & (step != 1)]] = True
    tracks.check(broken, 'frame', 'is one after the other, without gap, for a vehicle')
    against = tracks['xVelocity'] * np.where(direction == _UPPER, -1.0, 1.0) < -_ROLLING_M_S
    if against.mean() > 0.5:
        tracks.fail(
            int(np.argmax(against)),
            'xVelocity',
            'has the sign of the other direction, as in most rows; allowed are speeds below 0 for '
            'direction 1 and above 0 for direction 2',
        )
    velocity = np.stack([tracks['xVelocity'], tracks['yVelocity']], axis=1)[order]
    found = implausible_motion(
        vehicle,
        frame / recording.frame_rate,
        np.stack([tracks['x'], tracks['y']], axis=1)[order],
        np.linalg.norm(velocity, axis=1),
    )
    if found is not None:
        tracks.fail(int(order[found[0]]), 'xVelocity', f'vehicle {vehicle[found[0]]} {found[1]}')


def _edges(recording: _Recording, direction: np.ndarray, tracks: CsvFile) -> np.ndarray:
    """Return (2, rows) y of the outer markings of the vehicle's carriageway: upper and lower."""
    upper, lower = (recording.markings[number] for number in (_UPPER, _LOWER))
    edges = np.where(direction == _UPPER, [[upper[0]], [upper[-1]]], [[lower[0]], [lower[-1]]])
    across = tracks['y'] + tracks['height'] / 2.0
    width = edges[1] - edges[0]
    tracks.check(
        (across < edges[0] - width) | (across > edges[1] + width),
        'y',
        f'are places near the carriageway that {recording.path.name} has for the direction',
    )
    return edges


def _gaps(tracks: CsvFile, along: np.ndarray) -> np.ndarray:
    """Return (rows, 6) gaps to the neighbours that each row names."""
    frame, vehicle = tracks['frame'], tracks['id']
    order = np.lexsort((vehicle, frame))
    # Frame and vehicle as one number, by which a neighbour's row is looked up.
    span = int(vehicle.max()) + 1
    keys = frame[order] * span + vehicle[order]
    gaps = np.full((len(along), 6), np.inf)
    for column in _NEIGHBOURS:
        named = np.flatnonzero(tracks[column] != 0)
        other = tracks[column][named]
        wanted = frame[named] * span + other
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        strange = np.zeros(len(along), dtype=bool)
        strange[named] = (keys[place] != wanted) | (other < 0) | (other >= span)
        tracks.check(strange, column, 'are 0 and the vehicles of the same frame')
        rows = order[place]
        ahead = along[rows] - along[named]
        gap = np.abs(ahead) - (tracks['width'][rows] + tracks['width'][named]) / 2.0
        if column in _ALONGSIDE:
            side = _ALONGSIDE.index(column)
            target = np.where(ahead < 0.0, side, side + len(_BEHIND))
        else:
            target = np.full(len(named), (*_BEHIND, *_AHEAD).index(column))
        np.minimum.at(gaps, (named, target), gap)
    return gaps
