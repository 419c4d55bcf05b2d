# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers out of one message: field paths, missing ranges, sectors, reduction."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.sources import Reading

_STEP = re.compile(r'\.?([A-Za-z_]\w*)|\[(-?\d+)\]|\[(-?\d*):(-?\d*)\]')

REDUCTIONS: dict[str, Callable[[np.ndarray], float]] = {
    'min': np.min,
    'max': np.max,
    'mean': np.mean,
    'norm': np.linalg.norm,
}
# What LaserScan and Range call their greatest range, and LaserScan its angles.
GREATEST = ('range_max', 'max_range')
GEOMETRY = ('angle_min', 'angle_increment')
# Sectors are compared in whole ten-thousandths of a degree: finer than the single-precision angles
# of a scan, and exact, so that no beam is lost or counted twice between two sectors.
_PER_DEGREE = 10_000
_CIRCLE = 360 * _PER_DEGREE
# In degrees; a scan with beams beyond has no angles that make sense.
_FURTHEST = 36_000


class MessageReader:
    """Reads several numbers from each message of a topic, of rosbags or of rclpy alike.

    This is where a message becomes numbers; everything after it sees only those.

    Args:
        readings: ``(feature, reading)`` for each number; the feature's name is for errors.
    """

    def __init__(self, readings: Sequence[tuple[str, Reading]]) -> None:
        self._count = len(readings)
        self._single: list[tuple[int, FieldReader]] = []
        arrays: dict[tuple[str | None, str], list[tuple[int, FieldReader]]] = {}
        for place, (name, reading) in enumerate(readings):
            field = FieldReader(name, reading)
            if reading.reduce in (None, 'yaw'):
                self._single.append((place, field))
            else:
                arrays.setdefault((reading.field, reading.missing), []).append((place, field))
        self._arrays = [_Array(members) for members in arrays.values()]

    def read(self, message: Any) -> list[float]:
        """Return the numbers, in order; NaN where nothing was measured.

        Raises:
            OccError: the message has no such field, or it is not what the feature map says.
        """
        numbers = [math.nan] * self._count
        for place, field in self._single:
            numbers[place] = field.number(message)
        for array in self._arrays:
            array.read(message, numbers)
        return numbers


class FieldReader:
    """One reading's field of a message, and the errors that speak of it.

    Args:
        name: the feature's, for errors.
        reading: what to read; it has a field.
    """

    def __init__(self, name: str, reading: Reading) -> None:
        self._name, self.reading = name, reading
        # The type of message in which the path has been found to lead through declared fields.
        self._checked: type | None = None
        self._steps: list[str | int | slice] = []
        for attribute, index, start, stop in _STEP.findall(reading.field):
            if attribute:
                self._steps.append(attribute)
            elif index:
                self._steps.append(int(index))
            else:
                self._steps.append(
                    slice(int(start) if start else None, int(stop) if stop else None)
                )

    @property
    def path(self) -> tuple[str | int | slice, ...]:
        """The steps from the message to the field."""
        return tuple(self._steps)

    def check_type(self, message: Any) -> None:
        """Do nothing if messages of this one's type can be read; an empty one shows it.

        Raises:
            OccError: there is no such field, or it is not what the feature map says.
        """
        value = message
        for place, step in enumerate(self._steps):
            if not isinstance(step, str):
                # What elements an array has, only a real message shows.
                return
            try:
                value = getattr(value, step)
            except AttributeError as error:
                raise self._missing(place, value) from error
        if self.reading.reduce in (None, 'yaw'):
            self.number(message)
        else:
            self.array(message)
            if self.reading.degrees is not None:
                self.geometry(message)

    def value(self, message: Any) -> Any:
        """Follow the path, through declared fields only: not methods, constants or private ones."""
        value, is_checked = message, type(message) is self._checked
        for place, step in enumerate(self._steps):
            try:
                if isinstance(step, slice):
                    self._check_reach(step, len(value))
                elif isinstance(step, str) and not is_checked and step not in field_names(value):
                    raise AttributeError(step)
                value = getattr(value, step) if isinstance(step, str) else value[step]
            except (AttributeError, IndexError, TypeError) as error:
                raise self._missing(place, value) from error
        self._checked = type(message)
        return value

    def number(self, message: Any) -> float:
        """Return a field that is one number, or the yaw of a quaternion."""
        value = self.value(message)
        if self.reading.reduce == 'yaw':
            return self._yaw(value)
        if isinstance(value, str | bytes) or np.ndim(value):
            raise self._wrong(value, 'one number; an array needs the key "reduce"')
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self._wrong(value, 'one number') from None
        if self.reading.missing != 'unknown' and unmeasured(number):
            return self.greatest(message) if self.reading.missing == 'max_range' else math.nan
        return number

    def array(self, message: Any) -> np.ndarray:
        """Return a field that is an array, or a vector such as Vector3, as float64."""
        value = self.value(message)
        if hasattr(value, 'x') and hasattr(value, 'y'):
            value = [getattr(value, axis) for axis in 'xyzw' if hasattr(value, axis)]
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = np.empty(())
        if numbers.ndim != 1:
            raise self._wrong(value, 'an array or vector of numbers')
        return numbers

    def greatest(self, message: Any) -> float:
        """Return the greatest range of a LaserScan or a Range message."""
        for name in GREATEST:
            if hasattr(message, name):
                return float(getattr(message, name))
        raise DataError(
            f'feature {self._name!r} of topic {self.reading.topic!r} has missing: '
            f"max_range, but {_kind(message)} has no field 'range_max'"
        )

    def geometry(self, message: Any) -> tuple[float, float]:
        """Return first angle and step between beams, in rad."""
        try:
            return float(message.angle_min), float(message.angle_increment)
        except AttributeError:
            raise DataError(
                f'feature {self._name!r} of topic {self.reading.topic!r} asks for a sector, but '
                f"{_kind(message)} has no fields 'angle_min' and 'angle_increment'"
            ) from None

    def beams(self, first: float, step: float, count: int) -> np.ndarray:
        """Return the positions of the beams in the reading's sector.

        Args:
            first: angle of the first beam, in rad.
            step: angle between beams.
            count: number of beams.

        Raises:
            OccError: there is none.
        """
        angles = np.degrees(first + step * np.arange(count)) * _PER_DEGREE
        if not (np.abs(angles) <= _FURTHEST * _PER_DEGREE).all():
            raise DataError(
                f'topic {self.reading.topic!r} has a scan of {count} beams with angle_min '
                f'{first:g} and angle_increment {step:g}; allowed are beams within some turns'
            )
        angles = np.rint(angles).astype(np.int64)
        low, high = (round(angle * _PER_DEGREE) for angle in self.reading.degrees)
        inside = np.flatnonzero((angles - low) % _CIRCLE < high - low)
        if not len(inside):
            ends = sorted((int(angles[0]), int(angles[-1])))
            raise DataError(
                f'feature {self._name!r} of topic {self.reading.topic!r} asks for the sector from '
                f'{low / _PER_DEGREE:g} to {high / _PER_DEGREE:g} degrees, but no beam of the '
                f'scan is there; its beams go from {ends[0] / _PER_DEGREE:g} to '
                f'{ends[1] / _PER_DEGREE:g} degrees'
            )
        return inside

    def _yaw(self, value: Any) -> float:
        try:
            x, y, z, w = (float(getattr(value, axis)) for axis in 'xyzw')
        except (AttributeError, TypeError):
            raise self._wrong(value, 'a quaternion, for the transform yaw') from None
        # Written so that the quaternion need not be of length one.
        sine, cosine = 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z
        # All zero is how an orientation is said to be unset.
        return math.atan2(sine, cosine) if sine or cosine else math.nan

    def _check_reach(self, step: slice, length: int) -> None:
        """Refuse a slice that asks for elements that are not there, except of an empty array."""
        start, stop, _ = step.indices(length)
        beyond = any(abs(end) > length for end in (step.start, step.stop) if end is not None)
        if length and (beyond or start >= stop):
            raise DataError(
                f'feature {self._name!r} of topic {self.reading.topic!r} asks for '
                f'{self.reading.field!r}, but the array has {length} elements'
            )

    def _missing(self, place: int, value: Any) -> OccError:
        reading, step = self.reading, self._steps[place]
        if isinstance(step, str):
            names = field_names(value)
            at = _render(self._steps[:place]) or 'the message'
            hint = did_you_mean(step, names) or ';'
            what = f'{at} has no {step!r}{hint} it has {", ".join(names) or "no fields"}'
        elif hasattr(value, '__len__') and not isinstance(step, slice):
            what = f'{_render(self._steps[:place])} has {len(value)} elements'
        else:
            what = f'{_render(self._steps[:place])} is not an array'
        return DataError(
            f'feature {self._name!r} of topic {reading.topic!r} asks for {reading.field!r}, '
            f'but {what}'
        )

    def _wrong(self, value: Any, allowed: str) -> OccError:
        return DataError(
            f'feature {self._name!r} of topic {self.reading.topic!r}: '
            f'{self.reading.field!r} is {_kind(value)}; allowed is {allowed}'
        )


class _Sectors(NamedTuple):
    """The beams of several sectors, one sector after the other.

    Attributes:
        places: of the sectors' numbers in the answer.
        beams: positions in the array of ranges.
        starts: where each sector begins in ``beams``.
    """

    places: list[int]
    beams: np.ndarray
    starts: np.ndarray


class _Array:
    """Several reductions of one array, with one meaning of what was not measured."""

    def __init__(self, members: list[tuple[int, FieldReader]]) -> None:
        self._field = members[0][1]
        self._missing = self._field.reading.missing
        self._plain = [item for item in members if item[1].reading.degrees is None]
        self._sectored = [item for item in members if item[1].reading.degrees is not None]
        # Of the scan that came last: scans keep their geometry, as a rule.
        self._geometry: tuple[float, float, int] | None = None
        self._extremes: dict[str, _Sectors] = {}
        self._others: list[tuple[int, FieldReader, np.ndarray]] = []

    def read(self, message: Any, numbers: list[float]) -> None:
        """Put the reductions into ``numbers``; what is missing stays NaN there."""
        values = self._field.array(message)
        if not values.size:
            return
        measured = None
        if self._missing != 'unknown':
            missing = unmeasured(values)
            if self._missing == 'drop':
                measured = ~missing
            else:
                greatest = self._field.greatest(message)
                if not (values > 0).any() and not np.isneginf(values).any():
                    # Not one beam returned or says "nothing in range" (+Inf): it is blind.
                    return
                values = np.where(missing, greatest, values)
        for place, field in self._plain:
            kept = values if measured is None else values[measured]
            if kept.size:
                numbers[place] = float(REDUCTIONS[field.reading.reduce](kept))
        if not self._sectored:
            return
        geometry = (*self._field.geometry(message), len(values))
        if geometry != self._geometry:
            self._lay_out(geometry)
        for reduce, sectors in self._extremes.items():
            worst, pick = (np.inf, np.minimum) if reduce == 'min' else (-np.inf, np.maximum)
            kept = values if measured is None else np.where(measured, values, worst)
            found = pick.reduceat(kept[sectors.beams], sectors.starts).tolist()
            for place, number in zip(sectors.places, found, strict=True):
                # With "drop", the worst value stands for a sector without a return.
                if measured is None or number != worst:
                    numbers[place] = number
        for place, field, beams in self._others:
            kept = values[beams] if measured is None else values[beams][measured[beams]]
            if kept.size:
                numbers[place] = float(REDUCTIONS[field.reading.reduce](kept))

    def _lay_out(self, geometry: tuple[float, float, int]) -> None:
        """Find out which beams lie in which sector."""
        self._extremes, self._others = {}, []
        for reduce in ('min', 'max'):
            members = [item for item in self._sectored if item[1].reading.reduce == reduce]
            if members:
                beams = [field.beams(*geometry) for _, field in members]
                starts = np.cumsum([0, *(len(item) for item in beams[:-1])])
                self._extremes[reduce] = _Sectors(
                    [place for place, _ in members], np.concatenate(beams), starts
                )
        self._others = [
            (place, field, field.beams(*geometry))
            for place, field in self._sectored
            if field.reading.reduce not in self._extremes
        ]
        self._geometry = geometry


def field_names(message: Any) -> list[str]:
    """Return the names of a message's fields, whether of rosbags or of rclpy; else nothing."""
    if hasattr(message, 'get_fields_and_field_types'):
        return list(message.get_fields_and_field_types())
    if not is_dataclass(message):
        return []
    # The classes of rosbags have constants, with values, among their fields.
    return [field.name for field in fields(message) if field.default is MISSING]


def header_stamp_ns(message: Any) -> int | None:
    """Return a message's header stamp in ns; None without a header or with the unset stamp 0."""
    if isinstance(message, TableMessage):
        return message.stamp_ns or None
    stamp = getattr(getattr(message, 'header', None), 'stamp', None)
    if not (hasattr(stamp, 'sec') and hasattr(stamp, 'nanosec')):
        return None
    return stamp.sec * 1_000_000_000 + stamp.nanosec or None


def unmeasured(value: Any) -> Any:
    """Tell where a scanner says that it saw nothing: +Inf and NaN of REP 117, 0 of real ones."""
    return np.logical_not((value < np.inf) & (value != 0.0))


def _kind(value: Any) -> str:
    name = getattr(value, '__msgtype__', None) or type(value).__name__
    shape = np.shape(value) if isinstance(value, np.ndarray) else ()
    return f'{name} of shape {shape}' if shape else str(name)


def _render(steps: list[str | int | slice]) -> str:
    text = ''.join(f'.{step}' if isinstance(step, str) else f'[{step}]' for step in steps)
    return text.lstrip('.')
