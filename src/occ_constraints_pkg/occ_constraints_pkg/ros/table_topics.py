# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tables to and from topics as bytes: to make the messages takes longer than all else."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from occ_constraints_pkg.features.serialized_tables import TableMessage, TableReader
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TableSerializer
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.qos import STEPS, overridable


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
        callback: takes each message, which may turn out not to be a table.

    Raises:
        OccError: the topic's name is not valid.
    """
    return node.create_subscription(
        PointCloud2,
        topic,
        reading(node, topic, callback),
        STEPS,
        raw=True,
        qos_overriding_options=overridable(),
    )


def reading(
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
