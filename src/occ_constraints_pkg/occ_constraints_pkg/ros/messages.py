# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Messages: tables, stamps and velocity commands to and from rclpy types."""

from __future__ import annotations

import array
import math
from functools import cache
from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist, Vector3
from sensor_msgs.msg import PointCloud2, PointField

from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.errors import OccError

_SECOND = 1_000_000_000


def to_time(nanoseconds: int) -> Time:
    """Return a time message."""
    seconds, rest = divmod(nanoseconds, _SECOND)
    return Time(sec=seconds, nanosec=rest)


def to_nanoseconds(stamp: Time) -> int:
    """Return a time message as nanoseconds."""
    return stamp.sec * _SECOND + stamp.nanosec


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


def scaled_twist(twist: Twist, scale: float) -> Twist | None:
    """Return a velocity command times ``scale``, or ``None`` if a value is not finite."""
    parts = [
        [getattr(vector, axis) * scale for axis in 'xyz']
        for vector in (twist.linear, twist.angular)
    ]
    if not all(math.isfinite(value) for part in parts for value in part):
        return None
    linear, angular = (Vector3(x=x, y=y, z=z) for x, y, z in parts)
    return Twist(linear=linear, angular=angular)


@cache
def message_class(msgtype: str) -> Any:
    """Return the Python class of a message type such as ``sensor_msgs/msg/LaserScan``.

    Raises:
        OccError: no installed package provides it.
    """
    try:
        package, kind, name = msgtype.split('/')
        return getattr(import_module(f'{package}.{kind}'), name)
    except (ValueError, ImportError, AttributeError) as error:
        raise OccError(
            f'message type {msgtype!r} is not installed; install the ROS package that defines it'
        ) from error
