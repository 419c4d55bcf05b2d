# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as serialized messages, without ROS and fast: only what differs is written anew."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from occ_constraints_pkg.features.table import Table

TABLE_TYPE = 'sensor_msgs/msg/PointCloud2'
# Four bytes that name the encoding, little-endian CDR: the last two are free. Then the stamp.
_ENCODING = b'\0\1'
STAMP = struct.Struct('<iI')
STAMP_AT = 4
# What follows the numbers: ``is_dense``.
_IS_DENSE = b'\1'


class TableHead:
    """The bytes before the numbers of a serialized PointCloud2, in CDR.

    Attributes:
        known: the bytes; 0 where others will do.
        mask: 255 for each byte that is fixed; 0 for the stamp and for padding.

    Args:
        frame_id: of the header.
        height: of the cloud.
        width: of the cloud.
        layout: ``(name, offset, datatype, count)`` of each field.
        point_step: bytes of a point.
        row_step: bytes of a row.
        size: bytes of all numbers.
    """

    def __init__(
        self,
        frame_id: str,
        height: int,
        width: int,
        layout: Sequence[tuple[str, int, int, int]],
        point_step: int,
        row_step: int,
        size: int,
    ) -> None:
        free = bytes(STAMP_AT + STAMP.size - len(_ENCODING))
        self.known = bytearray(_ENCODING + free)
        self.mask = bytearray(b'\xff' * len(_ENCODING) + free)
        self._text(frame_id)
        self._numbers(height, width, len(layout))
        for name, offset, datatype, count in layout:
            self._text(name)
            self._numbers(offset)
            self._add(bytes([datatype]))
            self._numbers(count)
        is_bigendian = b'\0'
        self._add(is_bigendian)
        self._numbers(point_step, row_step, size)

    def _text(self, value: str) -> None:
        written = value.encode('utf-8', 'replace') + b'\0'
        self._numbers(len(written))
        self._add(written)

    def _numbers(self, *values: int) -> None:
        fill = bytes(-len(self.known) % 4)
        self.known += fill
        self.mask += fill
        self._add(struct.pack(f'<{len(values)}I', *values))

    def _add(self, written: bytes) -> None:
        self.known += written
        self.mask += b'\xff' * len(written)


class TableSerializer:
    """Serializes tables that are alike but for their numbers: PointCloud2 in CDR.

    Args:
        names: the columns.
        frame_id: of the header.
        rows: of each table.
        dtype: float32 or float64.
    """

    def __init__(
        self, names: Sequence[str], frame_id: str, rows: int = 1, dtype: DTypeLike = np.float64
    ) -> None:
        table = Table(tuple(names), np.zeros((rows, len(names)), dtype))
        size = table.values.nbytes
        step = len(names) * table.values.itemsize
        head = TableHead(frame_id, 1, rows, table.layout, step, size, size)
        self._dtype = table.values.dtype.newbyteorder('<')
        self._message = head.known + table.packed() + _IS_DENSE
        self._data = slice(len(head.known), len(head.known) + size)

    def serialize(self, values: ArrayLike, stamp_ns: int) -> bytes:
        """Return the message of a table.

        Args:
            values: (rows, columns) numbers, or (columns,) for one row.
            stamp_ns: of the header, nanoseconds.
        """
        STAMP.pack_into(self._message, STAMP_AT, *divmod(stamp_ns, 10**9))
        self._message[self._data] = np.asarray(values, dtype=self._dtype).tobytes()
        return bytes(self._message)
