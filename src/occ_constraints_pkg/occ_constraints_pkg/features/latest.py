# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The last message of a topic, and what a feature map reads of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.fields import MessageReader
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.features.table import Table


class Held:
    """The last message of a topic, with its values once they have been asked for.

    Attributes:
        message: of rosbags or rclpy, or a :class:`TableMessage`.
        stamp: its header stamp in ns; None without one.
        arrival: when it came, in ns.
        values: (rows, readings) float64; None until :meth:`read`.
        table: the message as a table, if it is one.
    """

    def __init__(self, message: Any, stamp: int | None, arrival: int) -> None:
        self.message, self.stamp, self.arrival = message, stamp, arrival
        self.values: np.ndarray | None = None
        self.table: Table | None = None

    def read(self, reader: TopicReader) -> None:
        """Set ``values``, and ``table`` for a table."""
        if self.values is None:
            self.values, self.table = reader.read(self.message)

    def age_ns(self, stamp: int | None, arrival: int) -> int:
        """Return the distance to the message of the row; the future is as far as the past.

        That a clock has jumped back shows in nothing else.
        """
        return abs(self.ahead_ns(stamp, arrival))

    def ahead_ns(self, stamp: int | None, arrival: int) -> int:
        """Return by how much this message is of a later time than another one."""
        if stamp is None or self.stamp is None:
            return self.arrival - arrival
        return self.stamp - stamp


class TopicReader:
    """Reads all that is asked of one topic.

    Attributes:
        places: where its readings stand among those of the map.

    Args:
        places: see above.
        readings: ``(feature, reading)`` of each.
    """

    def __init__(self, places: list[int], readings: Sequence[tuple[str, Reading]]) -> None:
        self.places = places
        self._columns = [item for item in readings if item[1].column is not None]
        self._fields = MessageReader([item for item in readings if item[1].column is None])
        self._is_table = bool(self._columns)
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
            return np.array([self._fields.read(message)]), None
        if not has_points:
            name, reading = self._columns[0]
            raise DataError(
                f'feature {name!r} asks for column {reading.column!r} of topic '
                f'{reading.topic!r}, whose messages are {type(message).__name__}; '
                'allowed is a table (sensor_msgs/msg/PointCloud2)'
            )
        table = message.table if is_read else Table.from_message(message)
        if table.names != self._names:
            self._positions = np.array([_find(table, *item) for item in self._columns], np.intp)
            self._names = table.names
        return table.values[:, self._positions].astype(np.float64, copy=False), table


def _find(table: Table, name: str, reading: Reading) -> int:
    try:
        return table.names.index(reading.column)
    except ValueError:
        hint = did_you_mean(reading.column, table.names) or ';'
        raise DataError(
            f'feature {name!r} asks for column {reading.column!r} of topic '
            f'{reading.topic!r}, which the table does not have{hint} '
            f'its columns are {", ".join(table.names)}'
        ) from None
