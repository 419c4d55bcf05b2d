# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One message of a topic to numbers: field paths, and what errors say of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.features.reductions import (
    ArrayReductions,
    fill_unmeasured,
    is_measured,
    yaw_angle,
    yaw_vector,
)
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.features.table import Table

_STEP = re.compile(r'\.?([A-Za-z_]\w*)|\[(-?\d+)\]|\[(-?\d*):(-?\d*)\]')

# What LaserScan and Range call their greatest range, and LaserScan its angles.
LIMITS = ('range_max', 'max_range')
GEOMETRY = ('angle_min', 'angle_increment')


class TopicReader:
    """Reads all features of one topic from its messages, be they tables or have fields.

    Attributes:
        columns: indices of its readings among those of the map.

    Args:
        columns: see above.
        readings: ``(feature, reading)`` of each.
    """

    def __init__(self, columns: list[int], readings: Sequence[tuple[str, Reading]]) -> None:
        self.columns = columns
        self._asked = [item for item in readings if item[1].column is not None]
        self._fields = MessageReader([item for item in readings if item[1].column is None])
        self._is_table = bool(self._asked)
        self._is_unread = not readings
        self._names: tuple[str, ...] | None = None
        self._positions = np.empty(0, dtype=np.intp)

    def read(self, message: Any) -> tuple[np.ndarray, Table | None]:
        """Return (rows, readings of this topic) float64, and the message as table if it is one.

        Raises:
            OccError: the message lacks what is asked for, or is no table where one is asked for.
        """
        is_read = isinstance(message, TableMessage)
        has_points = is_read or hasattr(message, 'point_step')
        if not self._is_table and not (self._is_unread and has_points):
            return self._fields.read(message), None
        if not has_points:
            name, reading = self._asked[0]
            raise DataError(
                f'feature {name!r} asks for column {reading.column!r} of topic '
                f'{reading.topic!r}, whose messages are {type(message).__name__}; '
                'allowed is a table (sensor_msgs/msg/PointCloud2)'
            )
        table = message.table if is_read else Table.from_message(message)
        if table.names != self._names:
            self._positions = np.array([_find(table, *item) for item in self._asked], np.intp)
            self._names = table.names
        return table.values[:, self._positions].astype(np.float64, copy=False), table


class MessageReader:
    """Reads several numbers from each message of a topic, of rosbags or of rclpy alike.

    This is where a message becomes numbers; everything after it sees only those.

    Args:
        readings: ``(feature, reading)`` for each number; the feature's name is for errors.
    """

    def __init__(self, readings: Sequence[tuple[str, Reading]]) -> None:
        self._nothing = np.full((1, len(readings)), np.nan)
        self._scalars, arrays = split_readings(readings)
        self._arrays = [
            (FieldReader(*members[0][1:]), ArrayReductions(members)) for members in arrays
        ]

    def read(self, message: Any) -> np.ndarray:
        """Return the (1, k) float64 numbers, in order; NaN where nothing was measured.

        Raises:
            DataError: the message has no such field, or it is not what the feature map says.
        """
        numbers = self._nothing.copy()
        for column, field in self._scalars:
            numbers[0, column] = field.number(message)
        for field, array in self._arrays:
            values = field.array(message)
            if values.size:
                limits = np.array([field.limit(message)]) if array.needs_limits else None
                geometry = field.geometry(message) if array.needs_geometry else None
                array.reduce(values[np.newaxis], limits, geometry, numbers)
        return numbers


def split_readings(
    readings: Sequence[tuple[str, Reading]],
) -> tuple[list[tuple[int, FieldReader]], list[list[tuple[int, str, Reading]]]]:
    """Return readings of one number with their columns, and those of each array together."""
    scalars: list[tuple[int, FieldReader]] = []
    arrays: dict[tuple[str | None, str], list[tuple[int, str, Reading]]] = {}
    for column, (name, reading) in enumerate(readings):
        if reading.reduce in (None, 'yaw'):
            scalars.append((column, FieldReader(name, reading)))
        else:
            key = reading.field, reading.missing
            arrays.setdefault(key, []).append((column, name, reading))
    return scalars, list(arrays.values())


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
        for attribute, index, start, stop in _STEP.findall(reading.field or ''):
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
        missing = self.reading.missing
        if missing == 'unknown' or is_measured(number):
            return number
        limits = np.array([self.limit(message)]) if missing == 'max_range' else None
        return float(fill_unmeasured(np.array([number]), missing, limits)[0])

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

    def limit(self, message: Any) -> float:
        """Return the greatest range of a LaserScan or a Range message."""
        for name in LIMITS:
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

    def _yaw(self, value: Any) -> float:
        try:
            x, y, z, w = (float(getattr(value, axis)) for axis in 'xyzw')
        except (AttributeError, TypeError):
            raise self._wrong(value, 'a quaternion, for the transform yaw') from None
        return yaw_angle(*yaw_vector(x, y, z, w))

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
    stamp: Any = getattr(getattr(message, 'header', None), 'stamp', None)
    if not (hasattr(stamp, 'sec') and hasattr(stamp, 'nanosec')):
        return None
    return stamp.sec * 1_000_000_000 + stamp.nanosec or None


def _kind(value: Any) -> str:
    name = getattr(value, '__msgtype__', None) or type(value).__name__
    shape = np.shape(value) if isinstance(value, np.ndarray) else ()
    return f'{name} of shape {shape}' if shape else str(name)


def _render(steps: list[str | int | slice]) -> str:
    text = ''.join(f'.{step}' if isinstance(step, str) else f'[{step}]' for step in steps)
    return text.lstrip('.')


def _find(table: Table, name: str, reading: Reading) -> int:
    column = reading.column or ''
    try:
        return table.names.index(column)
    except ValueError:
        hint = did_you_mean(column, table.names) or ';'
        raise DataError(
            f'feature {name!r} asks for column {reading.column!r} of topic '
            f'{reading.topic!r}, which the table does not have{hint} '
            f'its columns are {", ".join(table.names)}'
        ) from None
