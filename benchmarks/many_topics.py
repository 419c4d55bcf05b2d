# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Publishes on many topics and writes down what, when, and whether somebody listened.

It runs as a process of its own, ``python -m benchmarks.many_topics -r ...``.
"""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

import rclpy
from occ_constraints_pkg.ros.qos import STEPS
from rclpy.node import Node
from std_msgs.msg import UInt64

ENTRY = struct.Struct('<QQII')
"""An entry of the log: the message's number, its time in ns, the topic's, whether it was heard."""

_CDR_HEAD = b'\0\1\0\0'


def number_of(data: bytes) -> int:
    """Return the number that a serialized message carries."""
    return int.from_bytes(data[len(_CDR_HEAD) :], 'little')


def read_log(path: Path) -> list[tuple[int, int, int, int]]:
    """Return the whole entries so far."""
    data = path.read_bytes()
    return list(ENTRY.iter_unpack(data[: len(data) // ENTRY.size * ENTRY.size]))


def main() -> None:
    """Publish until the process is killed."""
    rclpy.init(args=['--ros-args', *sys.argv[1:]])
    node = rclpy.create_node('many_topics')
    count = node.declare_parameter('topics', 0).value
    rate = node.declare_parameter('rate', 0.0).value
    _publish(node, count, rate, Path(node.declare_parameter('log', '').value))


def _publish(node: Node, count: int, rate: float, path: Path) -> None:
    publishers = [node.create_publisher(UInt64, f'topic_{place}', STEPS) for place in range(count)]
    # Unbuffered, so that the log is complete whenever this process is killed.
    with path.open('ab', buffering=0) as log:
        start, number, entries = time.monotonic(), 0, bytearray()
        while True:
            early = start + number / (rate * count) - time.monotonic()
            if early > 0.0:
                log.write(entries)
                entries.clear()
                time.sleep(max(early, 0.001))
                continue
            publisher = publishers[number % count]
            is_heard = publisher.get_subscription_count() > 0
            publisher.publish(_CDR_HEAD + number.to_bytes(8, 'little'))
            entries += ENTRY.pack(number, time.time_ns(), number % count, is_heard)
            number += 1


if __name__ == '__main__':
    main()
