# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A bare rclpy relay, the peer of the monitor in the benchmark ``monitor``.

It takes observations and answers with costs.

It runs as a process of its own, ``python -m benchmarks.relay --ros-args ...``,
and publishes each message as it came.
"""

from __future__ import annotations

import sys

import rclpy
from occ_constraints_pkg.ros.qos import STEPS
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2

_LOOK_SECONDS = 0.2


def main() -> None:
    """Relay until the process is asked to end."""
    rclpy.init(args=['--ros-args', *sys.argv[1:]])
    node = rclpy.create_node('relay')
    publisher = node.create_publisher(PointCloud2, 'costs', STEPS)
    node.create_subscription(PointCloud2, 'observation', publisher.publish, STEPS)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            # Not without a limit: with some C++ libraries that wait spins at full load.
            executor.spin_until_future_complete(Future(), _LOOK_SECONDS)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
