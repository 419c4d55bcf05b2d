# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One number out of one message: field paths, missing ranges, reduction, transform."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from occ_constraints_pkg.bags.feature_map import FeatureSource
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import OccError

_STEP = re.compile(r'\.?([A-Za-z_]\w*)|\[(-?\d+)\]|\[(-?\d*):(-?\d*)\]')

_REDUCTIONS: dict[str, Callable[[np.ndarray], float]] = {
    'min': np.min,
    'max': np.max,
    'mean': np.mean,
    'norm': np.linalg.norm,
}


class FieldReader:
    """Reads one feature from messages of rosbags or rclpy, which name their fields alike."""

    def __init__(self, source: FeatureSource) -> None:
        self._source = source
        self._steps: list[str | int | slice] = []
        for name, index, start, stop in _STEP.findall(source.field):
            if name:
                self._steps.append(name)
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

    def read(self, message: Any) -> float:
        """Return the feature's value; NaN where the message holds an empty array.

        Raises:
            OccError: the message has no such field, or it is not what the feature map says.
        """
        source = self._source
        value: Any = message
        for place, step in enumerate(self._steps):
            try:
                if isinstance(step, slice):
                    self._check_reach(step, len(value))
                value = getattr(value, step) if isinstance(step, str) else value[step]
            except (AttributeError, IndexError, TypeError) as error:
                raise self._missing(place, value) from error
        if source.transform == 'yaw':
            return self._yaw(value)
        if source.reduce is not None:
            number = self._reduce(value, message)
        else:
            number = self._number(value)
            if source.missing == 'max_range' and unmeasured(number):
                number = self._range_max(message)
        return abs(number) if source.transform == 'abs' else number

    def _reduce(self, value: Any, message: Any) -> float:
        if hasattr(value, 'x') and hasattr(value, 'y'):
            value = [getattr(value, axis) for axis in 'xyzw' if hasattr(value, axis)]
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = np.empty(())
        if numbers.ndim != 1:
            raise self._wrong(value, 'an array or vector of numbers')
        if numbers.size == 0:
            return math.nan
        if self._source.missing == 'max_range':
            furthest = self._range_max(message)
            if not (numbers > 0).any() and not np.isneginf(numbers).any():
                # Not one beam returned or says "nothing in range" (+Inf): the scanner is blind.
                return math.nan
            numbers = np.where(unmeasured(numbers), furthest, numbers)
        return float(_REDUCTIONS[self._source.reduce](numbers))

    def _number(self, value: Any) -> float:
        if isinstance(value, str | bytes) or np.ndim(value):
            raise self._wrong(value, 'one number; an array needs the key "reduce"')
        try:
            return float(value)
        except (TypeError, ValueError):
            raise self._wrong(value, 'one number') from None

    def _yaw(self, value: Any) -> float:
        try:
            x, y, z, w = (float(getattr(value, axis)) for axis in 'xyzw')
        except (AttributeError, TypeError):
            raise self._wrong(value, 'a quaternion, for the transform yaw') from None
        # Written so that the quaternion need not be of length one.
        sine, cosine = 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z
        # All zero is how an orientation is said to be unset.
        return math.atan2(sine, cosine) if sine or cosine else math.nan

    def _range_max(self, message: Any) -> float:
        try:
            return float(message.range_max)
        except AttributeError:
            raise OccError(
                f'feature {self._source.name!r} of topic {self._source.topic!r} has missing: '
                f"max_range, but {_kind(message)} has no field 'range_max'"
            ) from None

    def _check_reach(self, step: slice, length: int) -> None:
        """Refuse a slice that asks for elements that are not there, except of an empty array."""
        start, stop, _ = step.indices(length)
        beyond = any(abs(end) > length for end in (step.start, step.stop) if end is not None)
        if length and (beyond or start >= stop):
            raise OccError(
                f'feature {self._source.name!r} of topic {self._source.topic!r} asks for '
                f'{self._source.field!r}, but the array has {length} elements'
            )

    def _missing(self, place: int, value: Any) -> OccError:
        source, step = self._source, self._steps[place]
        if isinstance(step, str):
            names = field_names(value)
            at = _render(self._steps[:place]) or 'the message'
            hint = did_you_mean(step, names) or ';'
            what = f'{at} has no {step!r}{hint} it has {", ".join(names) or "no fields"}'
        elif hasattr(value, '__len__') and not isinstance(step, slice):
            what = f'{_render(self._steps[:place])} has {len(value)} elements'
        else:
            what = f'{_render(self._steps[:place])} is not an array'
        return OccError(
            f'feature {source.name!r} of topic {source.topic!r} asks for {source.field!r}, '
            f'but {what}'
        )

    def _wrong(self, value: Any, allowed: str) -> OccError:
        return OccError(
            f'feature {self._source.name!r} of topic {self._source.topic!r}: '
            f'{self._source.field!r} is {_kind(value)}; allowed is {allowed}'
        )


def field_names(message: Any) -> list[str]:
    """Return the names of a message's fields, whether of rosbags or of rclpy; else nothing."""
    if hasattr(message, 'get_fields_and_field_types'):
        return list(message.get_fields_and_field_types())
    names = getattr(message, '__dataclass_fields__', {})
    return [name for name in names if not name.startswith('__')]


def header_stamp_ns(message: Any) -> int | None:
    """Return a message's header stamp in ns; None without a header or with the unset stamp 0."""
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
