# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One message of a topic to numbers: field paths, and what errors say of them."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from typing import Any, cast

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.features.paths import (
    Path,
    Selector,
    number_in,
    parse_path,
    path_text,
)
from occ_constraints_pkg.features.reductions import (
    ArrayReductions,
    RangeRule,
    angle_of,
    angle_parts,
    fill_unmeasured,
)
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.sources import ANGLES, Reading
from occ_constraints_pkg.features.table import Table

# What LaserScan and Range call their least and greatest ranges, and LaserScan its angles.
LEAST = ('range_min', 'min_range')
GREATEST = ('range_max', 'max_range')
GEOMETRY = ('angle_min', 'angle_increment')
# How its package says that a quaternion lies in an array.
_ORDERS = {'px4_msgs': 'wxyz'}


class NotNamedError(DataError):
    """A message does not have the name that a reading selects by, so it says nothing of it."""


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
            geometry = field.geometry(message) if array.needs_geometry and values.size else None
            array.reduce(values[np.newaxis], field.limits(message), geometry, numbers)
        return numbers


def split_readings(
    readings: Sequence[tuple[str, Reading]],
) -> tuple[list[tuple[int, FieldReader]], list[list[tuple[int, str, Reading]]]]:
    """Return readings of one number with their columns, and those of each array together."""
    scalars: list[tuple[int, FieldReader]] = []
    arrays: dict[tuple[str | None, RangeRule], list[tuple[int, str, Reading]]] = {}
    for column, (name, reading) in enumerate(readings):
        if reading.reduce is None or reading.reduce in ANGLES or is_plain_count(reading):
            scalars.append((column, FieldReader(name, reading)))
        else:
            key = reading.field, RangeRule.of(reading)
            arrays.setdefault(key, []).append((column, name, reading))
    return scalars, list(arrays.values())


def is_plain_count(reading: Reading) -> bool:
    """Tell whether all elements of an array are counted, whatever they are."""
    return reading.reduce == 'count' and not reading.is_sector and RangeRule.of(reading).is_plain


class FieldReader:
    """One reading's field of a message, and the errors that speak of it.

    Args:
        name: the feature's, for errors.
        reading: what to read; it has a field.
    """

    def __init__(self, name: str, reading: Reading) -> None:
        self._name, self.reading = name, reading
        self._rule = RangeRule.of(reading)
        # The type of message in which the path has been found to lead through declared fields.
        self._checked: type | None = None
        self._is_complete = False
        self._written = parse_path(reading.field or '')
        # As it is in messages of the type that came last, which may have a header around.
        self._steps = self._written
        self._has_names = any(isinstance(step, Selector) for step in self._written)
        # Where a name was found in the message before.
        self._places: dict[int, int] = {}

    @property
    def path(self) -> Path:
        """The steps from the message to the field, as the map has them."""
        return self._written

    def check_type(self, message: Any) -> None:
        """Do nothing if messages of this one's type can be read; an empty one shows it.

        Raises:
            OccError: there is no such field, or it is not what the feature map says.
        """
        value, steps = message, self._resolved(message)
        for place, step in enumerate(steps):
            if not isinstance(step, str):
                # What elements an array has, only a real message shows.
                return
            try:
                value = getattr(value, step)
            except AttributeError as error:
                self._steps = steps
                raise self._missing(place, value) from error
        reading = self.reading
        if reading.reduce is None or reading.reduce in ANGLES or is_plain_count(reading):
            self.number(message)
        else:
            self.array(message)
            if reading.is_sector:
                self.geometry(message)

    def value(self, message: Any) -> Any:
        """Follow the path, through declared fields only: not methods, constants or private ones.

        Raises:
            NotNamedError: an array lacks the name that the path asks for.
            DataError: there is no such field or element.
        """
        is_checked = type(message) is self._checked
        if not is_checked:
            self._steps = self._resolved(message)
        self._is_complete = is_checked
        value = self._follow(message, 0, (), is_checked=is_checked)
        if self._is_complete:
            self._checked = type(message)
        return value

    def _follow(self, value: Any, start: int, around: tuple[Any, ...], *, is_checked: bool) -> Any:
        """Go on from a step of the path; ``around`` are the messages that were passed."""
        steps = self._steps
        for place in range(start, len(steps)):
            step = steps[place]
            try:
                if isinstance(step, str):
                    if not is_checked and step not in field_names(value):
                        raise AttributeError(step)
                    if self._has_names:
                        around = (*around, value)
                    value = getattr(value, step)
                elif isinstance(step, Selector):
                    value = self._select(place, step, value, around)
                elif isinstance(step, slice):
                    self._check_reach(step, len(value))
                    value = value[step]
                    if place + 1 < len(steps):
                        return [
                            self._follow(item, place + 1, around, is_checked=is_checked)
                            for item in value
                        ]
                else:
                    value = value[step]
            except (AttributeError, IndexError, TypeError) as error:
                raise self._missing(place, value) from error
        self._is_complete = True
        return value

    def _resolved(self, message: Any) -> Path:
        """Return the path in messages of a type, which may have a header around their part.

        So that a map reads both ``geometry_msgs/msg/Twist`` and ``TwistStamped``, say.
        """
        parts = {name: field_names(getattr(message, name)) for name in field_names(message)}
        return resolve_path(self._written, type_name(message), parts)

    def _select(self, place: int, step: Selector, value: Any, around: tuple[Any, ...]) -> Any:
        """Return the element that has a name; all of them to count them."""
        is_counted = place + 1 == len(self._steps) and self.reading.reduce == 'count'
        if is_counted and not len(value):
            return []
        names = self._names(place, step, value, around)
        if is_counted:
            return [item for item, name in zip(value, names, strict=False) if step.matches(name)]
        index = self._places.get(place, 0)
        if not (index < len(names) and step.matches(names[index])):
            found = [index for index, name in enumerate(names) if step.matches(name)]
            if not found:
                raise self.not_named(step, names)
            index = self._places[place] = found[0]
        if index >= len(value):
            # JointState leaves empty what its publisher does not know.
            if place + 1 < len(self._steps):
                raise self.not_named(step, names)
            return math.nan
        return value[index]

    def _names(self, place: int, step: Selector, value: Any, around: tuple[Any, ...]) -> list[Any]:
        """Return the names of an array's elements."""
        first = step.key[0]
        if len(value) and first in field_names(value[0]):
            return [self._at_key(step, item) for item in value]
        for outer in reversed(around):
            if first in field_names(outer):
                names = self._at_key(step, outer)
                if isinstance(names, str) or not hasattr(names, '__len__'):
                    raise self._wrong(names, f'an array of names at {".".join(step.key)!r}')
                return list(names)
        if not len(value):
            raise self.not_named(step, [])
        known = field_names(value[0]) or field_names(around[-1])
        raise DataError(
            f'feature {self._name!r} of topic {self.reading.topic!r} asks for '
            f'{self.reading.field!r}, but neither {path_text(self._steps[:place])} nor the '
            f'message has {first!r}; there are {", ".join(known)}'
        )

    def _at_key(self, step: Selector, message: Any) -> Any:
        value = message
        for name in step.key:
            if name not in field_names(value):
                raise self._wrong(value, f'a message with {name!r}, as the key of a name')
            value = getattr(value, name)
        return value

    def not_named(self, step: Selector, names: Sequence[Any]) -> NotNamedError:
        """Return the error that a message has these names, but not the one asked for."""
        texts = [str(name) for name in names]
        hint = did_you_mean(step.text, texts) or ';'
        return NotNamedError(
            f'feature {self._name!r} of topic {self.reading.topic!r} asks for '
            f'{self.reading.field!r}, but no message has {".".join(step.key)} {step.text!r}{hint} '
            f'the last one has {", ".join(texts) or "none"}'
        )

    def number(self, message: Any) -> float:
        """Return a field that is one number, an angle of a quaternion, or a length."""
        value, reading = self.value(message), self.reading
        if reading.reduce in ANGLES:
            return self._angle(message, value)
        if reading.reduce == 'count':
            if isinstance(value, str | bytes) or not hasattr(value, '__len__'):
                raise self._wrong(value, 'an array, whose elements are counted')
            return float(len(value))
        if isinstance(value, str):
            found = number_in(value)
            if found is None and not self._has_names:
                raise self._wrong(value, 'one number, or a text that holds one')
            value = math.nan if found is None else found
        # rclpy has a byte as bytes of length 1.
        if isinstance(value, bytes) and len(value) == 1:
            value = value[0]
        if isinstance(value, bytes) or np.ndim(value):
            raise self._wrong(value, 'one number; an array needs the key "reduce"')
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self._wrong(value, 'one number') from None
        if self._rule.is_plain:
            return number
        return float(fill_unmeasured(np.array([number]), self._rule, *self.limits(message))[0])

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

    def limits(self, message: Any) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Return least and greatest range of a LaserScan or Range message, (1,) each.

        None for one that the reading does not need, or could use but the message does not tell.
        """
        rule = self._rule
        least = greatest = None
        if rule.needs_least:
            least = self._limit(message, LEAST, is_needed=True)
        if rule.uses_greatest:
            greatest = self._limit(message, GREATEST, is_needed=rule.needs_greatest)
        return least, greatest

    def _limit(self, message: Any, names: Sequence[str], *, is_needed: bool) -> np.ndarray | None:
        for name in names:
            if hasattr(message, name):
                return np.array([float(getattr(message, name))])
        if not is_needed:
            return None
        key = 'missing: max_range' if names is GREATEST else 'range_limits: own'
        raise DataError(
            f'feature {self._name!r} of topic {self.reading.topic!r} has {key}, but '
            f'{_kind(message)} has no field {names[0]!r}'
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

    def _angle(self, message: Any, value: Any) -> float:
        angle = str(self.reading.reduce)
        if all(hasattr(value, axis) for axis in 'xyzw'):
            parts = [getattr(value, axis) for axis in 'xyzw']
        elif hasattr(value, '__len__') and len(value) in (0, 4):
            if not len(value):
                return math.nan
            order = self.order(type_name(message))
            parts = [value[order.index(axis)] for axis in 'xyzw']
        else:
            raise self._wrong(value, f'a quaternion, for the transform {angle}')
        try:
            x, y, z, w = map(float, parts)
        except (TypeError, ValueError):
            raise self._wrong(value, f'a quaternion, for the transform {angle}') from None
        return angle_of(angle, *angle_parts(angle, x, y, z, w))

    def order(self, msgtype: str) -> str:
        """Return how a quaternion lies in an array of a message's.

        Raises:
            DataError: neither the map nor the type's package says so.
        """
        order = self.reading.order or _ORDERS.get(msgtype.partition('/')[0])
        if order is None:
            raise DataError(
                f'feature {self._name!r} of topic {self.reading.topic!r}: the key "order" is '
                f'missing, which {self.reading.field!r} needs to be a quaternion, for it is an '
                'array; allowed are xyzw and wxyz'
            )
        return order

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
            at = path_text(self._steps[:place]) or 'the message'
            hint = did_you_mean(step, names) or ';'
            what = f'{at} has no {step!r}{hint} it has {", ".join(names) or "no fields"}'
        elif hasattr(value, '__len__') and isinstance(step, int):
            what = f'{path_text(self._steps[:place])} has {len(value)} elements'
        else:
            what = f'{path_text(self._steps[:place])} is not an array'
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
    return _field_names_of(cast(Hashable, type(message)))


# Rclpy builds the names anew each time it is asked.
@lru_cache(maxsize=512)
def _field_names_of(kind: Any) -> list[str]:
    if hasattr(kind, 'get_fields_and_field_types'):
        return list(kind.get_fields_and_field_types())
    if not is_dataclass(kind):
        return []
    # The classes of rosbags have constants, with values, among their fields.
    return [field.name for field in fields(kind) if field.default is MISSING]


def type_name(message: Any) -> str:
    """Return the type of a message of rosbags or of rclpy, such as ``nav_msgs/msg/Odometry``."""
    name = getattr(message, '__msgtype__', None)
    if name is not None:
        return str(name)
    return f'{type(message).__module__.partition(".")[0]}/msg/{type(message).__name__}'


def resolve_path(path: Path, msgtype: str, parts: Mapping[str, Sequence[str]]) -> Path:
    """Return a path as it is in messages of a type, which may be stamped or not.

    Types such as ``geometry_msgs/msg/TwistStamped`` are a header and a part, whose type they are
    named after; the same path reads a topic of either type.

    Args:
        path: as the map has it.
        msgtype: the type's name.
        parts: the names of its fields, each with the names of the field's own fields.
    """
    first = path[0] if path else ''
    if first in parts:
        return path
    if len(parts) == 2 and 'header' in parts:
        part = next(name for name in parts if name != 'header')
        if first in parts[part]:
            return (part, *path)
    if len(path) > 1 and first == msgtype.rpartition('/')[2].lower() and path[1] in parts:
        return path[1:]
    return path


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
