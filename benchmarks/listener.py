# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A bare rclpy listener, the peer of the views in the benchmarks ``watch`` and ``dashboard``.

It runs as a process of its own, ``python -m benchmarks.listener --ros-args ...``, and takes the
verdicts on some robots from an executor, as a node does that is written after the tutorials.
"""

from __future__ import annotations

import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from occ_constraints_pkg.ros.qos import VERDICTS
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.task import Future

_LOOK_SECONDS = 0.2


def main() -> None:
    """Listen until the process is asked to end."""
    rclpy.init(args=['--ros-args', *sys.argv[1:]])
    node = rclpy.create_node('listener')
    robots = node.declare_parameter('robots', 5).value
    for number in range(1, robots + 1):
        topic = f'/robot{number}/violation'
        node.create_subscription(DiagnosticArray, topic, lambda message: None, VERDICTS)
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
