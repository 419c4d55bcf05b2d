# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Batched, named numbers as they travel in ``sensor_msgs/PointCloud2``: one point per robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError

# sensor_msgs/PointField datatype numbers; a table holds columns of one of these two kinds.
FLOAT32, FLOAT64 = 7, 8
_DTYPES = {FLOAT32: np.dtype('<f4'), FLOAT64: np.dtype('<f8')}
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
            raise OccError(
                f'a table of {len(self.names)} columns got values of shape {self.values.shape}; '
                'allowed is (rows, columns)'
            )
        if self.values.dtype.newbyteorder('<') not in _DATATYPES:
            raise OccError(f'a table got {self.values.dtype} values; allowed are float32, float64')
        if len(set(self.names)) != len(self.names):
            raise OccError(f'a table names a column twice: {", ".join(self.names)}')

    def column(self, name: str) -> np.ndarray:
        """Return one column as a (rows,) view.

        Raises:
            OccError: there is no such column.
        """
        try:
            return self.values[:, self.names.index(name)]
        except ValueError:
            raise OccError(
                f'the table has no column {name!r}; its columns are {", ".join(self.names)}'
            ) from None

    @property
    def layout(self) -> list[tuple[str, int, int, int]]:
        """``(name, offset, datatype, count)`` of each field, as PointCloud2 wants them."""
        dtype = self.values.dtype.newbyteorder('<')
        return [
            (name, index * dtype.itemsize, _DATATYPES[dtype], 1)
            for index, name in enumerate(self.names)
        ]

    def packed(self) -> bytes:
        """Return the values row by row, little-endian, as the message's ``data``."""
        dtype = self.values.dtype.newbyteorder('<')
        return np.ascontiguousarray(self.values, dtype=dtype).tobytes()

    @classmethod
    def from_message(cls, message: Any) -> Table:
        """Read a PointCloud2, from rclpy or from rosbags.

        Fields of other kinds than FLOAT32 and FLOAT64 are refused rather than skipped: a table
        written by somebody else with, say, an integer label is not silently read in part.

        Raises:
            OccError: the message is not a table in this sense.
        """
        fields = message.fields
        names = tuple(field.name for field in fields)
        kinds = {field.datatype for field in fields}
        rows = message.height * message.width
        if not fields or message.is_bigendian or not kinds <= _DTYPES.keys():
            raise OccError(
                f'a PointCloud2 with fields {", ".join(names) or "(none)"} of datatypes '
                f'{sorted(kinds)} is not a table; allowed are little-endian FLOAT32 and FLOAT64'
            )
        _check_layout(fields, message)
        data = np.frombuffer(message.data, dtype=np.uint8)
        if data.size < rows * message.point_step:
            raise OccError(
                f'a table of {rows} rows of {message.point_step} bytes holds only {data.size} bytes'
            )
        if len(kinds) == 1 and _is_packed(fields, message):
            dtype = _DTYPES[next(iter(kinds))]
            values = data[: rows * message.point_step].view(dtype).reshape(rows, len(names))
            return cls(names, values)
        record = np.dtype(
            {
                'names': [str(index) for index in range(len(names))],
                'formats': [_DTYPES[field.datatype] for field in fields],
                'offsets': [field.offset for field in fields],
                'itemsize': message.point_step,
            }
        )
        records = data[: rows * message.point_step].view(record)
        # A mixed table is widened, so that no FLOAT64 column loses digits.
        columns = [records[key] for key in record.names]
        return cls(names, np.stack(columns, axis=1).astype(np.float64))


def _check_layout(fields: Any, message: Any) -> None:
    """Refuse what PointCloud2 may express and a table does not mean."""
    for field in fields:
        # Some writers leave count at 0 where they mean 1.
        if field.count > 1:
            raise OccError(
                f'the table field {field.name!r} holds {field.count} numbers per point; '
                'allowed is 1'
            )
        if field.offset + _DTYPES[field.datatype].itemsize > message.point_step:
            raise OccError(
                f'the table field {field.name!r} at byte {field.offset} reaches past the '
                f'{message.point_step} bytes of a point'
            )
    if message.height > 1 and message.row_step != message.width * message.point_step:
        raise OccError(
            f'a table of {message.height} x {message.width} points of {message.point_step} bytes '
            f'has row_step {message.row_step}; allowed is {message.width * message.point_step}'
        )


def _is_packed(fields: Any, message: Any) -> bool:
    """Tell whether the fields follow one another without holes, in the order listed."""
    size = message.point_step // len(fields)
    return message.point_step == size * len(fields) == len(fields) * _DTYPES[
        fields[0].datatype
    ].itemsize and all(field.offset == index * size for index, field in enumerate(fields))
