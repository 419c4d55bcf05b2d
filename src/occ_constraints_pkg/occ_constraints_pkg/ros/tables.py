# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tables as messages: batched, stamped numbers as PointCloud2, to and from topics."""

from __future__ import annotations

import array
from collections.abc import Callable
from functools import cache, lru_cache, partial

import numpy as np
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2, PointField

from occ_constraints_pkg.features.serialized_tables import TableMessage, TableReader
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TableSerializer
from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import STEPS, overridable


def table_message(table: Table, stamp_ns: int, frame_id: str = '') -> PointCloud2:
    """Return a table as a PointCloud2 of one row, stamped."""
    message = PointCloud2()
    message.header.stamp = to_time(stamp_ns)
    message.header.frame_id = frame_id
    message.height, message.width = 1, len(table.values)
    message.fields = _fields(tuple(table.layout))
    message.point_step = table.values.shape[1] * table.values.dtype.itemsize
    message.row_step = message.point_step * message.width
    message.data = array.array('B', table.packed())
    message.is_dense = True
    return message


@cache
def _fields(layout: tuple[tuple[str, int, int, int], ...]) -> list[PointField]:
    return [
        PointField(name=name, offset=offset, datatype=datatype, count=count)
        for name, offset, datatype, count in layout
    ]


def table_bytes(table: Table, stamp_ns: int, frame_id: str) -> bytes:
    """Return the message of :func:`table_message` serialized, as publishers take it as well."""
    values = table.values
    serializer = _serializer(table.names, frame_id, len(values), values.dtype)
    return serializer.serialize(values, stamp_ns)


@lru_cache(maxsize=16)
def _serializer(
    names: tuple[str, ...], frame_id: str, rows: int, dtype: np.dtype
) -> TableSerializer:
    return TableSerializer(names, frame_id, rows, dtype)


def subscribe_to_tables(
    node: OccNode, topic: str, callback: Callable[[TableMessage], None]
) -> Subscription:
    """Subscribe to a topic of tables, reliably.

    Args:
        node: subscribes.
        topic: its name.
        callback: called with each message, which may turn out not to be a table.

    Raises:
        OccError: the topic's name is not valid.
    """
    return node.create_subscription(
        PointCloud2,
        topic,
        table_callback(node, topic, callback),
        STEPS,
        raw=True,
        qos_overriding_options=overridable(),
    )


def table_callback(
    node: OccNode, topic: str, callback: Callable[[TableMessage], None]
) -> Callable[[bytes], None]:
    """Return what a subscription with ``raw=True`` calls; see :func:`subscribe_to_tables`."""
    reader = TableReader(partial(deserialize_message, message_type=PointCloud2))

    def on_bytes(data: bytes) -> None:
        try:
            message = reader.read(data)
        except RuntimeError as error:
            # The middleware drops such a message as well, so this is silence.
            node.get_logger().error(
                f'a message on {topic} is damaged: {error}', throttle_duration_sec=1.0
            )
            return
        callback(message)

    return on_bytes
