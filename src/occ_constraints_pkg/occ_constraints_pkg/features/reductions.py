# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a field mean: unmeasured ranges, sectors of beams, reductions, yaw.

Everything is stated for n messages at once. A live message is the case n = 1, so live topics and
recordings give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.sources import Reading

# Sectors are compared in whole ten-thousandths of a degree: finer than the single-precision angles
# of a scan, and exact, so that no beam is lost or counted twice between two sectors.
_PER_DEGREE = 10_000
_CIRCLE = 360 * _PER_DEGREE
# In degrees; a scan with beams beyond has no angles that make sense.
_LARGEST_ANGLE = 36_000
# How each extreme is found, and its identity, with which values that do not count are replaced.
_EXTREMES = {'min': (np.minimum, np.inf), 'max': (np.maximum, -np.inf)}
# What np.mean and np.linalg.norm compute, in a third of their time for few numbers.
_SUMS: dict[str, Callable[[np.ndarray], float]] = {
    'mean': lambda numbers: np.add.reduce(numbers) / len(numbers),
    'norm': lambda numbers: math.sqrt(numbers.dot(numbers)),
}

_NONE = np.empty(0, dtype=np.intp)
_Indices = slice | np.ndarray

Geometry = tuple[float, float]
"""Angle of the first beam and step from one beam to the next, in rad."""


def is_measured(values: Any) -> Any:
    """Return which values are not how a scanner reports nothing: +Inf, NaN (REP 117) or 0."""
    return (values < np.inf) & (values != 0.0)


def fill_unmeasured(numbers: np.ndarray, missing: str, limits: np.ndarray | None) -> np.ndarray:
    """Return numbers, each a field of its own, with ``missing`` applied, see :class:`Reading`.

    Args:
        numbers: (n,) float64.
        missing: ``unknown``, ``max_range`` or ``drop``.
        limits: (n,) greatest range of each message; needed for ``max_range`` only.
    """
    if missing == 'unknown':
        return numbers
    if missing == 'drop' or limits is None:
        limits = np.full(1, np.nan)
    return np.where(is_measured(numbers), numbers, limits)


def yaw_vector(x: Any, y: Any, z: Any, w: Any) -> tuple[Any, Any]:
    """Return sine and cosine of the yaw of quaternions, times their squared length."""
    return 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z


def yaw_angle(sine: float, cosine: float) -> float:
    """Return the yaw in rad; NaN for a quaternion of zeros, which is an orientation not set."""
    # Not NumPy's arctangent, which may differ in the last bit.
    return math.atan2(sine, cosine) if sine or cosine else math.nan


def sector_beams(name: str, reading: Reading, geometry: Geometry, count: int) -> np.ndarray:
    """Return which beams of a scan lie in the sector of a reading: their (m,) indices.

    Args:
        name: the feature's, for errors.
        reading: its ``degrees`` are the sector.
        geometry: of the scan.
        count: number of beams.

    Raises:
        DataError: there is none, or the angles of the scan make no sense.
    """
    assert reading.degrees is not None
    first, step = geometry
    angles = np.degrees(first + step * np.arange(count)) * _PER_DEGREE
    if not (np.abs(angles) <= _LARGEST_ANGLE * _PER_DEGREE).all():
        raise DataError(
            f'topic {reading.topic!r} has a scan of {count} beams with angle_min {first:g} and '
            f'angle_increment {step:g}; allowed are beams within some turns'
        )
    angles = np.rint(angles).astype(np.int64)
    low, high = (round(angle * _PER_DEGREE) for angle in reading.degrees)
    inside = np.flatnonzero((angles - low) % _CIRCLE < high - low)
    if not len(inside):
        ends = sorted((int(angles[0]), int(angles[-1])))
        raise DataError(
            f'feature {name!r} of topic {reading.topic!r} asks for the sector from '
            f'{low / _PER_DEGREE:g} to {high / _PER_DEGREE:g} degrees, but no beam of the '
            f'scan is there; its beams go from {ends[0] / _PER_DEGREE:g} to '
            f'{ends[1] / _PER_DEGREE:g} degrees'
        )
    return inside


class ArrayReductions:
    """Reductions of one array field, which share one meaning of what was not measured.

    Args:
        readings: ``(column, feature, reading)`` of each; all have the same field and ``missing``.

    Attributes:
        needs_limits: whether :meth:`reduce` has to be told the greatest ranges.
        needs_geometry: whether it has to be told the scan's geometry.
    """

    def __init__(self, readings: Sequence[tuple[int, str, Reading]]) -> None:
        self._missing = readings[0][2].missing
        self._columns = np.array([column for column, _, _ in readings])
        self._whole = [item for item in readings if item[2].degrees is None]
        self._sectors = [item for item in readings if item[2].degrees is not None]
        self.needs_limits = self._missing == 'max_range'
        self.needs_geometry = bool(self._sectors)
        # Of the scan before: scans keep their geometry, as a rule.
        self._layout: tuple[Geometry | None, int] | None = None
        self._extremes: list[_Pieces] = []
        self._sums: list[tuple[int, str, _Indices]] = []

    def reduce(
        self,
        values: np.ndarray,
        limits: np.ndarray | None,
        geometry: Geometry | None,
        numbers: np.ndarray,
    ) -> None:
        """Put the reductions into ``numbers``, NaN where nothing was measured.

        Empty arrays leave ``numbers`` as they are.

        Args:
            values: (n, length) float64, or float32 as stored.
            limits: (n,) greatest range of each message.
            geometry: of all these scans.
            numbers: (n, k) float64, in whose columns the results go.

        Raises:
            DataError: a sector has no beam.
        """
        if not values.shape[1]:
            return
        measured, blind = None, _NONE
        if self._missing == 'drop':
            measured = is_measured(values)
        elif limits is not None and self.needs_limits:
            blind = _blind(values)
            # Comparing float32 as it is takes half the time, and is exact when both are.
            limit = limits.astype(values.dtype, copy=False)
            if limit is not limits and not np.array_equal(limit, limits, equal_nan=True):
                limit = limits
            values = np.where(is_measured(values), values, limit[:, np.newaxis])
        if (geometry, values.shape[1]) != self._layout:
            self._lay_out(geometry, values.shape[1])
        for pieces in self._extremes:
            numbers[:, pieces.columns] = pieces.find(values, measured)
        for column, reduction, beams in self._sums:
            lines = values[:, beams].astype(np.float64, order='C', copy=False)
            if measured is None and reduction == 'mean':
                numbers[:, column] = lines.mean(axis=1)
                continue
            # Row by row, for along an axis NumPy may add in another order.
            for row, line in enumerate(lines):
                kept = line if measured is None else line[measured[row, beams]]
                numbers[row, column] = _SUMS[reduction](kept) if kept.size else np.nan
        if len(blind):
            numbers[np.ix_(blind, self._columns)] = np.nan

    def _lay_out(self, geometry: Geometry | None, count: int) -> None:
        """Find which beams each sector has."""
        beams: list[tuple[int, str, _Indices]]
        beams = [(column, str(item.reduce), slice(None)) for column, _, item in self._whole]
        if geometry is not None:
            for column, name, item in self._sectors:
                inside = sector_beams(name, item, geometry, count)
                beams.append((column, str(item.reduce), _as_slice(inside)))
        self._sums = [item for item in beams if item[1] in _SUMS]
        self._extremes = []
        for reduction in _EXTREMES:
            members = [(column, part) for column, how, part in beams if how == reduction]
            if members:
                self._extremes.append(_Pieces.of(reduction, members, count))
        self._layout = geometry, count


@dataclass(frozen=True, eq=False)
class _Pieces:
    """One extreme of several parts of an array, by way of the pieces that the parts consist of.

    Attributes:
        reduction: ``min`` or ``max``.
        columns: of the results.
        starts: where each piece begins; it ends where the next one does.
        order: indices of the pieces of the first part, then of the second, and so on.
        parts: where in ``order`` each part begins; None where one piece is each part.
    """

    reduction: str
    columns: _Indices
    starts: np.ndarray
    order: np.ndarray
    parts: np.ndarray | None

    @classmethod
    def of(cls, reduction: str, members: Sequence[tuple[int, _Indices]], count: int) -> _Pieces:
        """Cut ``count`` elements wherever the membership in some part changes."""
        inside = np.zeros((len(members), count), dtype=bool)
        for row, (_, beams) in zip(inside, members, strict=True):
            row[beams] = True
        cuts = np.flatnonzero((inside[:, 1:] != inside[:, :-1]).any(axis=0)) + 1
        starts = np.append(0, cuts)
        has = inside[:, starts]
        parts = np.append(0, np.cumsum(has.sum(axis=1))[:-1])
        columns, order = np.array([column for column, _ in members]), has.nonzero()[1]
        joined = None if len(starts) == 1 else parts
        return cls(reduction, _as_slice(columns), starts, order, joined)

    def find(self, values: np.ndarray, measured: np.ndarray | None) -> np.ndarray:
        """Return the (n, parts) extremes of those of (n, length) values that were measured."""
        pick, worst = _EXTREMES[self.reduction]
        if measured is None:
            return self._join(pick, values)
        found = self._join(pick, np.where(measured, values, worst))
        doubtful = found == worst
        if np.count_nonzero(doubtful):
            # A part without a return, unless the value itself was measured (-Inf).
            found[doubtful & ~self._join(np.logical_or, measured)] = np.nan
        return found

    def _join(self, pick: np.ufunc, values: np.ndarray) -> np.ndarray:
        pieces = pick.reduceat(values, self.starts, axis=1)
        if self.parts is None:
            return pieces
        return pick.reduceat(pieces.take(self.order, axis=1), self.parts, axis=1)


def _blind(values: np.ndarray) -> np.ndarray:
    """Return the indices of scans without a return and without an "+Inf: nothing in range"."""
    returns = np.logical_or.reduce(values > 0, axis=1)
    if np.count_nonzero(returns) == len(returns):
        return _NONE
    blind = np.flatnonzero(~returns)
    return blind[~np.isneginf(values[blind]).any(axis=1)]


def _as_slice(indices: np.ndarray) -> _Indices:
    """Return indices as a slice where they follow one another, which is faster."""
    is_run = bool((np.diff(indices) == 1).all())
    return slice(int(indices[0]), int(indices[-1]) + 1) if is_run else indices
