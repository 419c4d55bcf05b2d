# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Batched, named numbers as they travel in ``sensor_msgs/PointCloud2``: one point per robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from occ_constraints_pkg.errors import DataError

# sensor_msgs/PointField datatype numbers; a table holds columns of one of these two kinds.
FLOAT32, FLOAT64 = 7, 8
_DTYPES: dict[int, np.dtype[Any]] = {FLOAT32: np.dtype('<f4'), FLOAT64: np.dtype('<f8')}
# NumPy knows no larger records.
_LARGEST_STEP = 2**31 - 1
_DATATYPES = {dtype: number for number, dtype in _DTYPES.items()}


@dataclass(frozen=True)
class Table:
    """Named columns of numbers, one row per robot.

    Attributes:
        names: the columns' names, unique.
        values: (rows, columns) float32 or float64.

    Raises:
        OccError: names and values do not fit together, or the values are of another kind.
    """

    names: tuple[str, ...]
    values: np.ndarray

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.names):
            raise DataError(
                f'a table of {len(self.names)} columns got values of shape {self.values.shape}; '
                'allowed is (rows, columns)'
            )
        if _little(self.values.dtype) not in _DATATYPES:
            raise DataError(f'a table got {self.values.dtype} values; allowed are float32, float64')
        if len(set(self.names)) != len(self.names):
            raise DataError(f'a table names a column twice: {", ".join(self.names)}')

    def column(self, name: str) -> np.ndarray:
        """Return one column as a (rows,) view.

        Raises:
            OccError: there is no such column.
        """
        try:
            return self.values[:, self.names.index(name)]
        except ValueError:
            raise DataError(
                f'the table has no column {name!r}; its columns are {", ".join(self.names)}'
            ) from None

    @property
    def layout(self) -> list[tuple[str, int, int, int]]:
        """``(name, offset, datatype, count)`` of each field, as PointCloud2 wants them."""
        dtype = _little(self.values.dtype)
        return [
            (name, index * dtype.itemsize, _DATATYPES[dtype], 1)
            for index, name in enumerate(self.names)
        ]

    def packed(self) -> bytes:
        """Return the values row by row, little-endian, as the message's ``data``."""
        dtype = _little(self.values.dtype)
        return np.ascontiguousarray(self.values, dtype=dtype).tobytes()

    @classmethod
    def from_message(cls, message: Any) -> Table:
        """Read a PointCloud2, from rclpy or from rosbags.

        Fields of other kinds than FLOAT32 and FLOAT64 are refused rather than skipped: a table
        written by somebody else with, say, an integer label is not silently read in part.

        Raises:
            OccError: the message is not a table in this sense.
        """
        fields = [
            (field.name, field.offset, field.datatype, field.count) for field in message.fields
        ]
        form = _form(tuple(fields), message.point_step, message.is_bigendian)
        rows = message.height * message.width
        step = message.width * message.point_step
        if message.height > 1 and message.row_step != step:
            raise DataError(
                f'a table of {message.height} x {message.width} points of {message.point_step} '
                f'bytes has row_step {message.row_step}; allowed is {step}'
            )
        data = np.frombuffer(message.data, dtype=np.uint8)
        if data.size < rows * message.point_step:
            raise DataError(
                f'a table of {rows} rows of {message.point_step} bytes holds only {data.size} bytes'
            )
        data = data[: rows * message.point_step]
        if form.packed is not None:
            return cls(form.names, data.view(form.packed).reshape(rows, len(form.names)))
        records = data.view(form.record)
        # A mixed table is widened, so that no FLOAT64 column loses digits.
        columns = [records[str(index)] for index in range(len(form.names))]
        return cls(form.names, np.stack(columns, axis=1).astype(np.float64))


class _Form(NamedTuple):
    """How a table's bytes are read.

    Attributes:
        names: of the columns.
        record: type of a row.
        packed: type of all numbers, where they are of one type and follow one another without
            holes in the order listed; else None.
    """

    names: tuple[str, ...]
    record: np.dtype
    packed: np.dtype | None


# The messages of a topic are alike, so their form is worked out once.
@lru_cache(maxsize=64)
def _form(
    fields: tuple[tuple[str, int, int, int], ...], point_step: int, is_bigendian: bool
) -> _Form:
    """Return how to read ``(name, offset, datatype, count)`` of some fields.

    Raises:
        OccError: PointCloud2 may express this, but it is no table.
    """
    names = tuple(name for name, _, _, _ in fields)
    kinds = {datatype for _, _, datatype, _ in fields}
    if not fields or is_bigendian or not kinds <= _DTYPES.keys():
        raise DataError(
            f'a PointCloud2 with fields {", ".join(names) or "(none)"} of datatypes '
            f'{sorted(kinds)} is not a table; allowed are little-endian FLOAT32 and FLOAT64'
        )
    if point_step > _LARGEST_STEP:
        raise DataError(
            f'a table has points of {point_step} bytes; allowed are up to {_LARGEST_STEP}'
        )
    for name, offset, datatype, count in fields:
        # Some writers leave count at 0 where they mean 1.
        if count > 1:
            raise DataError(
                f'the table field {name!r} holds {count} numbers per point; allowed is 1'
            )
        if offset + _DTYPES[datatype].itemsize > point_step:
            raise DataError(
                f'the table field {name!r} at byte {offset} reaches past the {point_step} bytes of '
                'a point'
            )
    record = np.dtype(
        {
            'names': [str(index) for index in range(len(names))],
            'formats': [_DTYPES[datatype] for _, _, datatype, _ in fields],
            'offsets': [offset for _, offset, _, _ in fields],
            'itemsize': point_step,
        }
    )
    size = _DTYPES[fields[0][2]].itemsize
    is_packed = len(kinds) == 1 and point_step == len(fields) * size
    is_packed = is_packed and all(
        offset == index * size for index, (_, offset, _, _) in enumerate(fields)
    )
    return _Form(names, record, _DTYPES[fields[0][2]] if is_packed else None)


@cache
def _little(dtype: np.dtype) -> np.dtype:
    return dtype.newbyteorder('<')
