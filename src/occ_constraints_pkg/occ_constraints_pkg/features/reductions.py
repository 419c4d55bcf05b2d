# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a field mean: unmeasured ranges, sectors of beams, reductions, angles.

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
from occ_constraints_pkg.features.sources import FULL_CIRCLE, Reading

# Sectors are compared in whole ten-thousandths of a degree: finer than the single-precision angles
# of a scan, and exact, so that no beam is lost or counted twice between two sectors.
_PER_DEGREE = 10_000
_CIRCLE = 360 * _PER_DEGREE
# In degrees; a scan with beams beyond, or over more than that, has no angles that make sense.
_LARGEST_ANGLE, _LARGEST_SPAN = 1080, 540
_LARGEST_RADIANS = 4.0 * math.pi
# How each extreme is found, and its identity, with which values that do not count are replaced.
_EXTREMES = {'min': (np.minimum, np.inf), 'max': (np.maximum, -np.inf)}
# What np.mean and np.linalg.norm compute, in a third of their time for few numbers.
_SUMS: dict[str, Callable[[np.ndarray], float]] = {
    'mean': lambda numbers: np.add.reduce(numbers) / len(numbers),
    'norm': lambda numbers: math.sqrt(numbers.dot(numbers)),
}

_COUNT = 'count'

_NONE = np.empty(0, dtype=np.intp)
_Indices = slice | np.ndarray

Geometry = tuple[float, float]
"""Angle of the first beam and step from one beam to the next, in rad."""


@dataclass(frozen=True)
class RangeRule:
    """Which ranges are measurements, and what the others stand for; see :class:`Reading`.

    Attributes:
        missing: ``unknown``, ``max_range`` or ``drop``.
        limits: ``own``, ``ignore``, two numbers, or None.
    """

    missing: str
    limits: str | tuple[float, float] | None

    @classmethod
    def of(cls, reading: Reading) -> RangeRule:
        """Return the rule of a reading."""
        return cls(reading.missing, reading.range_limits)

    @property
    def is_plain(self) -> bool:
        """Whether every value is taken as it is."""
        return self.missing == 'unknown' and self.limits in (None, 'ignore')

    @property
    def needs_greatest(self) -> bool:
        """Whether the message has to tell its greatest range."""
        return self.missing == 'max_range' or self.limits == 'own'

    @property
    def needs_least(self) -> bool:
        """Whether the message has to tell its least range."""
        return self.limits == 'own'

    @property
    def uses_greatest(self) -> bool:
        """Whether the greatest range makes a difference where the message tells it."""
        return self.needs_greatest or (self.limits is None and self.missing == 'drop')

    def is_measured(
        self, values: np.ndarray, least: np.ndarray | None, greatest: np.ndarray | None
    ) -> np.ndarray:
        """Return which of (n, length) values are measurements.

        A scanner reports nothing as +Inf, NaN (REP 117), 0 or a value beyond its limits. -Inf,
        too close to measure, is a measurement.

        Args:
            values: what the messages say.
            least: (n,) least range of each message; None where it does not tell.
            greatest: (n,) greatest range; likewise. One of 0 or less, or NaN, is not set.
        """
        low, high = None, None
        if isinstance(self.limits, tuple):
            low, high = (np.full(1, limit) for limit in self.limits)
        elif self.limits != 'ignore':
            if least is not None and self.needs_least:
                low = np.where(least > 0, least, -np.inf)
            if greatest is not None and self.uses_greatest:
                high = np.where(greatest > 0, greatest, np.inf)
        measured = values != 0.0
        if high is None:
            measured &= values < np.inf
        else:
            high = _exact(np.minimum(high, np.finfo(values.dtype).max), values.dtype)
            measured &= values <= high[:, np.newaxis]
        if low is not None:
            low = _exact(low, values.dtype)
            measured &= (values >= low[:, np.newaxis]) | (values == -np.inf)
        return measured


def fill_unmeasured(
    numbers: np.ndarray,
    rule: RangeRule,
    least: np.ndarray | None,
    greatest: np.ndarray | None,
) -> np.ndarray:
    """Return numbers, each a field of its own, with a rule applied.

    Args:
        numbers: (n,) float64.
        rule: says which are measurements.
        least: (n,) least range of each message; None where it does not tell.
        greatest: (n,) greatest range; likewise.
    """
    if rule.is_plain:
        return numbers
    measured = rule.is_measured(numbers[:, np.newaxis], least, greatest)[:, 0]
    if rule.missing == 'unknown':
        # What is not finite stays as it is.
        return np.where(measured | ~np.isfinite(numbers), numbers, np.nan)
    filling = greatest if rule.missing == 'max_range' else None
    return np.where(measured, numbers, np.full(1, np.nan) if filling is None else filling)


def angle_parts(angle: str, x: Any, y: Any, z: Any, w: Any) -> tuple[Any, Any, Any]:
    """Return of an angle of quaternions what :func:`angle_of` makes it from.

    Each is a sum of products, so that one message and many give the same bits.

    Args:
        angle: ``yaw``, ``roll`` or ``pitch``, as REP 103 has them: turns about the fixed axes x, y
            and z, in this order; or ``tilt``, between the z axes of body and world.
        x: first of the parts, which may be of any length.
        y: likewise.
        z: likewise.
        w: likewise.

    Returns:
        Two parts of the angle's sine, and its cosine, times the squared length.
    """
    if angle == 'yaw':
        return 2.0 * (w * z + x * y), 0.0 * w, w * w + x * x - y * y - z * z
    if angle == 'roll':
        return 2.0 * (w * x + y * z), 0.0 * w, w * w - x * x - y * y + z * z
    if angle == 'tilt':
        return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z
    return 2.0 * (w * y - x * z), 0.0 * w, w * w + x * x + y * y + z * z


def angle_of(angle: str, sine: float, other: float, cosine: float) -> float:
    """Return the angle in rad; NaN for a quaternion of zeros, which is an orientation not set."""
    # Not NumPy's functions, which may differ in the last bit.
    if not (sine or other or cosine):
        return math.nan
    if angle == 'pitch':
        # Here the third part is the squared length.
        return math.asin(min(max(sine / cosine, -1.0), 1.0)) if cosine > 0.0 else math.nan
    if angle == 'tilt':
        return math.atan2(math.sqrt(sine * sine + other * other), cosine)
    return math.atan2(sine, cosine)


def sector_beams(name: str, reading: Reading, geometry: Geometry, count: int) -> np.ndarray:
    """Return which beams of a scan lie in the sector of a reading: their (m,) indices.

    Args:
        name: the feature's, for errors.
        reading: its ``degrees`` are the sector, without what its ``exclude_degrees`` leave out.
        geometry: of the scan.
        count: number of beams.

    Raises:
        DataError: there is none, or the angles of the scan make no sense.
    """
    first, step = geometry
    angles = np.degrees(first + step * np.arange(count)) * _PER_DEGREE
    is_near = (np.abs(angles) <= _LARGEST_ANGLE * _PER_DEGREE).all()
    if not is_near or abs(angles[-1] - angles[0]) > _LARGEST_SPAN * _PER_DEGREE:
        in_degrees = max(abs(first), abs(step * count)) > _LARGEST_RADIANS
        hint = '; these look like degrees' if in_degrees else ''
        raise DataError(
            f'topic {reading.topic!r} has a scan of {count} beams with angle_min {first:g} and '
            f'angle_increment {step:g}; allowed are radians, within one turn or little more{hint}'
        )
    if count > 1 and not step:
        raise DataError(
            f'topic {reading.topic!r} has a scan of {count} beams with angle_increment 0, which '
            'all point the same way; allowed is the angle from one beam to the next, in radians'
        )
    angles = np.rint(angles).astype(np.int64)
    sector = reading.degrees or (0.0, FULL_CIRCLE)
    is_inside = _is_in_sector(angles, sector)
    for excluded in reading.exclude_degrees:
        is_inside &= ~_is_in_sector(angles, excluded)
    inside = np.flatnonzero(is_inside)
    if not len(inside):
        ends = sorted((int(angles[0]), int(angles[-1])))
        besides = ', besides exclude_degrees' if reading.exclude_degrees else ''
        raise DataError(
            f'feature {name!r} of topic {reading.topic!r} asks for the sector from '
            f'{sector[0]:g} to {sector[1]:g} degrees, but no beam of the '
            f'scan is there{besides}; its beams go from {ends[0] / _PER_DEGREE:g} to '
            f'{ends[1] / _PER_DEGREE:g} degrees'
        )
    return inside


def _is_in_sector(angles: np.ndarray, degrees: tuple[float, float]) -> np.ndarray:
    low, high = (round(angle * _PER_DEGREE) for angle in degrees)
    return (angles - low) % _CIRCLE < high - low


class ArrayReductions:
    """Reductions of one array field, which share one meaning of what was not measured.

    Args:
        readings: ``(column, feature, reading)`` of each; all have the same field and rule.

    Attributes:
        rule: which values are measurements.
        needs_geometry: whether :meth:`reduce` has to be told the scan's geometry.
    """

    def __init__(self, readings: Sequence[tuple[int, str, Reading]]) -> None:
        self.rule = RangeRule.of(readings[0][2])
        self._columns = np.array([column for column, _, _ in readings])
        self._whole = [item for item in readings if not item[2].is_sector]
        self._sectors = [item for item in readings if item[2].is_sector]
        self.needs_geometry = bool(self._sectors)
        # Of the scan before: scans keep their geometry, as a rule.
        self._layout: tuple[Geometry | None, int] | None = None
        self._extremes: list[_Pieces] = []
        self._sums: list[tuple[int, str, _Indices]] = []
        self._counts = [column for column, _, item in readings if item.reduce == _COUNT]

    def reduce(
        self,
        values: np.ndarray,
        limits: tuple[np.ndarray | None, np.ndarray | None],
        geometry: Geometry | None,
        numbers: np.ndarray,
    ) -> None:
        """Put the reductions into ``numbers``, NaN where nothing was measured.

        Empty arrays leave ``numbers`` as they are, but for their count of 0.

        Args:
            values: (n, length) float64, or float32 as stored.
            limits: (n,) least and greatest range of each message; None where it does not tell.
            geometry: of all these scans.
            numbers: (n, k) float64, in whose columns the results go.

        Raises:
            DataError: a sector has no beam.
        """
        if not values.shape[1]:
            numbers[:, self._counts] = 0.0
            return
        rule, measured, blind = self.rule, None, _NONE
        if not rule.is_plain:
            measured = rule.is_measured(values, *limits)
            if rule.missing == 'max_range' and limits[1] is not None:
                blind = _blind(values, measured)
                filling = _exact(limits[1], values.dtype)[:, np.newaxis]
                values, measured = np.where(measured, values, filling), None
            elif rule.missing == 'unknown':
                values = np.where(measured | ~np.isfinite(values), values, np.nan)
                measured = None
        if (geometry, values.shape[1]) != self._layout:
            self._lay_out(geometry, values.shape[1])
        for pieces in self._extremes:
            numbers[:, pieces.columns] = pieces.find(values, measured)
        for column, reduction, beams in self._sums:
            if reduction == _COUNT:
                kept = np.ones_like(values, dtype=bool) if measured is None else measured
                numbers[:, column] = np.count_nonzero(kept[:, beams], axis=1)
                continue
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
        self._sums = [item for item in beams if item[1] not in _EXTREMES]
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


def _exact(limits: np.ndarray, dtype: Any) -> np.ndarray:
    """Return limits in the type of the values if they are exact in it, else as they are."""
    # Comparing float32 as it is takes half the time.
    cast = limits.astype(dtype, copy=False)
    return cast if cast is limits or np.array_equal(cast, limits, equal_nan=True) else limits


def _blind(values: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return the indices of scans without a return and without an "+Inf: nothing in range"."""
    if np.logical_or.reduce(measured, axis=1).all() and not np.count_nonzero(values < 0):
        return _NONE
    returns = (measured & (values > 0)) | np.isinf(values)
    return np.flatnonzero(~np.logical_or.reduce(returns, axis=1))


def _as_slice(indices: np.ndarray) -> _Indices:
    """Return indices as a slice where they follow one another, which is faster."""
    is_run = bool((np.diff(indices) == 1).all())
    return slice(int(indices[0]), int(indices[-1]) + 1) if is_run else indices
