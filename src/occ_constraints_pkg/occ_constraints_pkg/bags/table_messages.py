# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as serialized messages, without ROS and fast: only what differs is written anew."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from rosbags.typesys import Stores, get_typestore

from occ_constraints_pkg.bags.table import Table

TABLE_TYPE = 'sensor_msgs/msg/PointCloud2'
# The stamp follows the four bytes that say which CDR it is; ``is_dense`` follows the data.
_STAMP_AT, _DENSE_BYTES = 4, 1


class RowSerializer:
    """Serializes tables of one row each: PointCloud2 with float64 fields, in CDR.

    Args:
        names: the columns.
        frame_id: of the header.
    """

    def __init__(self, names: Sequence[str], frame_id: str) -> None:
        table = Table(tuple(names), np.zeros((1, len(names))))
        store = get_typestore(Stores.ROS2_JAZZY)
        types = store.types
        size = 8 * len(names)
        message = types[TABLE_TYPE](
            types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](0, 0), frame_id),
            1,
            1,
            [types['sensor_msgs/msg/PointField'](*field) for field in table.layout],
            False,
            size,
            size,
            np.frombuffer(table.packed(), dtype=np.uint8),
            True,
        )
        self._message = bytearray(store.serialize_cdr(message, TABLE_TYPE))
        self._data = slice(len(self._message) - _DENSE_BYTES - size, -_DENSE_BYTES)

    def serialize(self, values: np.ndarray, stamp_ns: int) -> bytes:
        """Return the message of one row.

        Args:
            values: (columns,) numbers.
            stamp_ns: of the header, nanoseconds.
        """
        struct.pack_into('<iI', self._message, _STAMP_AT, *divmod(stamp_ns, 10**9))
        self._message[self._data] = np.asarray(values, dtype='<f8').tobytes()
        return bytes(self._message)
