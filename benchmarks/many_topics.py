# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Publishes on many topics and writes down what, when, and whether somebody listened.

It runs as a process of its own, ``python -m benchmarks.many_topics -r ...``. Its parameters are the
number of ``topics``, the ``rate`` of each in Hz, the file ``log``, and the ``bytes`` of a message;
on every twentieth topic there are twenty times as many, as of a camera among other sensors.
"""

from __future__ import annotations

import random
import struct
import sys
import time
from pathlib import Path

import rclpy
from occ_constraints_pkg.ros.qos import STEPS
from rclpy.node import Node
from std_msgs.msg import UInt64MultiArray

ENTRY = struct.Struct('<QQII')
"""An entry of the log: the message's number, its time in ns, the topic's, whether it was heard."""

# The head of CDR, a layout without dimensions and offset, and how many numbers follow at the next
# multiple of eight bytes.
_HEAD = struct.Struct('<4sIIIxxxx')
_NUMBER = struct.Struct('<Q')
_LARGE_EVERY, _LARGE_TIMES = 20, 20
# Payloads that no compression makes smaller are cut out of so many random bytes.
_RANDOM_BYTES = 1 << 20


def number_of(data: bytes) -> int:
    """Return the number that a serialized message carries."""
    return _NUMBER.unpack_from(data, _HEAD.size)[0]


def bytes_of_topics(topics: int, size: int) -> list[int]:
    """Return the payload of a message on each topic, in bytes, a multiple of eight."""
    sizes = [size * (1 if place % _LARGE_EVERY else _LARGE_TIMES) for place in range(topics)]
    return [max(_NUMBER.size, size // _NUMBER.size * _NUMBER.size) for size in sizes]


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
    sizes = bytes_of_topics(count, node.declare_parameter('bytes', 0).value)
    _publish(node, rate, sizes, Path(node.declare_parameter('log', '').value))


def _publish(node: Node, rate: float, sizes: list[int], path: Path) -> None:
    count = len(sizes)
    publishers = [
        node.create_publisher(UInt64MultiArray, f'topic_{place}', STEPS) for place in range(count)
    ]
    rng = random.Random(0)
    noise = rng.randbytes(_RANDOM_BYTES + max(sizes))
    heads = [_HEAD.pack(b'\0\1\0\0', 0, 0, size // _NUMBER.size) for size in sizes]
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
            place = number % count
            begin = rng.randrange(_RANDOM_BYTES)
            payload = noise[begin : begin + sizes[place] - _NUMBER.size]
            publisher.publish(heads[place] + _NUMBER.pack(number) + payload)
            entries += ENTRY.pack(number, time.time_ns(), place, is_heard)
            number += 1


if __name__ == '__main__':
    main()
