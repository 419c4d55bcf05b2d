# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reads damaged recordings: ``python -m fuzz_bags FIRST COUNT``, in ``tests``."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from fuzzing import damaged, watch
from mcap.writer import CompressionType, Writer
from occ_constraints_pkg.bags.extract import extract
from occ_constraints_pkg.bags.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.bags.recording import Recording
from occ_constraints_pkg.errors import OccError
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
MAP = FeatureMap(
    'scan',
    0.5,
    (
        FeatureSource('d', 'scan', 'ranges[0:4]', reduce='min', missing='max_range'),
        FeatureSource('v', 'odom', 'twist.twist.linear.x'),
        FeatureSource('h', 'odom', 'pose.pose.orientation', transform='yaw'),
        FeatureSource('j', 'joints', 'position[1]'),
    ),
)


def _messages() -> list[tuple[str, str, int, bytes]]:
    types, rng, result = STORE.types, np.random.default_rng(0), []
    vector, point = (
        types[f'geometry_msgs/msg/{name}'](1.0, 2.0, 3.0) for name in ('Vector3', 'Point')
    )
    pose = types['geometry_msgs/msg/Pose'](
        point, types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.6, 0.8)
    )
    twist = types['geometry_msgs/msg/Twist'](vector, vector)
    for step in range(40):
        time = 10**18 + step * 10**8
        header = types['std_msgs/msg/Header'](
            types['builtin_interfaces/msg/Time'](*divmod(time, 10**9)), 'frame'
        )
        ranges = rng.uniform(0, 4, 12).astype(np.float32)
        nothing = np.zeros(0, dtype=np.float32)
        made = {
            '/scan': types['sensor_msgs/msg/LaserScan'](
                header, 0.0, 1.0, 0.1, 0.0, 0.0, 0.1, 4.0, ranges, nothing
            ),
            '/odom': types['nav_msgs/msg/Odometry'](
                header,
                'base',
                types['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
                types['geometry_msgs/msg/TwistWithCovariance'](twist, np.zeros(36)),
            ),
            '/joints': types['sensor_msgs/msg/JointState'](
                header, ['left', 'right'], np.arange(2.0), np.arange(2.0), np.zeros(0)
            ),
        }
        for topic, message in made.items():
            data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
            result.append((topic, message.__msgtype__, time, data))
    return result


@cache
def originals() -> tuple[dict[str, bytes], ...]:
    """Return whole recordings of each kind: file name to content."""
    messages, made = _messages(), []
    with tempfile.TemporaryDirectory() as folder:
        for number, compression in enumerate(
            [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE, None]
        ):
            path = Path(folder) / f'{number}.mcap'
            chunks = {'compression': compression, 'chunk_size': 4000}
            options = chunks if compression is not None else {'use_chunking': False}
            with path.open('wb') as stream:
                writer = Writer(stream, **options)
                writer.start('ros2')
                channels = {}
                for topic, msgtype, time, data in messages:
                    if topic not in channels:
                        text, _ = STORE.generate_msgdef(msgtype, ros_version=2)
                        schema = writer.register_schema(msgtype, 'ros2msg', text.encode())
                        channels[topic] = writer.register_channel(topic, 'cdr', schema)
                    writer.add_message(channels[topic], time, data, time)
                writer.finish()
            made.append({'bag.mcap': path.read_bytes()})
        modes = [
            (StoragePlugin.SQLITE3, CompressionMode.NONE),
            (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
            (StoragePlugin.MCAP, CompressionMode.FILE),
            (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        ]
        for number, (plugin, mode) in enumerate(modes):
            path = Path(folder) / f'bag_{number}'
            writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
            writer.set_compression(mode, CompressionFormat.ZSTD)
            with writer:
                channels = {}
                for topic, msgtype, time, data in messages:
                    if topic not in channels:
                        channels[topic] = writer.add_connection(topic, msgtype, typestore=STORE)
                    writer.write(channels[topic], time, data)
            made.append({file.name: file.read_bytes() for file in path.iterdir()})
    return tuple(made)


def bombs() -> dict[str, bytes]:
    """Return MCAP files that would fill the memory: a few bytes that unpack to gigabytes."""
    made = {}
    zeros = bytes(1 << 24)
    compressor = zstandard.ZstdCompressor()
    packed = {
        'zstd': compressor.compress(zeros) * 200,
        'lz4': lz4.frame.compress(bytes(1 << 30)),
    }
    for name, data in packed.items():
        for size in (1 << 20, 1 << 31, 2**63):
            body = (
                b''.join(number.to_bytes(8, 'little') for number in (0, 0, size))
                + bytes(4)
                + len(name).to_bytes(4, 'little')
                + name.encode()
            )
            body += len(data).to_bytes(8, 'little') + data
            made[f'{name}_{size}'] = (
                b'\x89MCAP0\r\n' + b'\6' + len(body).to_bytes(8, 'little') + body
            )
    return made


def read(path: Path) -> str:
    """Read all of a recording; return how that ended."""
    try:
        recording = Recording(path)
        count = sum(1 for _ in recording.messages())
        if count != recording.message_count:
            raise AssertionError(f'{count} messages instead of {recording.message_count}')
        extract([path], MAP)
    except OccError as error:
        if '\n' in str(error) or not str(error):
            raise AssertionError(f'not one sentence: {error}') from error
        return 'refused'
    return 'read in part' if recording.warnings else 'read'


def call(number: int, folder: Path) -> Callable[[], str]:
    """Write the damaged recording of a number; return the call that reads it."""
    rng = np.random.default_rng(number)
    kinds = originals()
    files = dict(kinds[number % len(kinds)])
    other = kinds[int(rng.integers(len(kinds)))]
    victims = [name for name in files if name != 'metadata.yaml' or rng.random() < 0.1]
    victim = victims[int(rng.integers(len(victims)))]
    files[victim] = damaged(files[victim], rng, next(iter(other.values())))
    bag = folder / 'bag'
    bag.mkdir(exist_ok=True)
    for file in bag.iterdir():
        file.unlink()
    for name, content in files.items():
        (bag / name).write_bytes(content)
    return lambda: read(bag)


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as place:
        watch(lambda number: call(number, Path(place)), int(sys.argv[1]), int(sys.argv[2]))
