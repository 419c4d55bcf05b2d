# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reads damaged and hostile recordings: ``python -m fuzz_bags FIRST COUNT``, in ``tests``.

Every other case has bytes damaged; the others are whole files whose definitions, types, names, QoS
profiles, metadata.yaml or manifest are odd.
"""

from __future__ import annotations

import shutil
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
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.manifest import select
from occ_constraints_pkg.documents import dump_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.rosbag.playback import is_latched
from occ_constraints_pkg.rosbag.recording import Recording
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
        return refused(error)
    return 'read in part' if recording.warnings else 'read'


def call(number: int, folder: Path) -> Callable[[], str]:
    """Write the recording of a number; return the call that reads it."""
    rng = np.random.default_rng(number)
    if number % 2:
        return odd_call(rng, folder)
    number //= 2
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


MSG = (
    'std_msgs/Header header\nfloat64 x 1.5\nuint8 KIND=1\nstring NAME=a b\nfloat32[] y\n'
    'Part[3] z\nstring<=9 s\nint8[<=4] i\n'
    + '=' * 80
    + '\nMSG: p/Part\nfloat64 x\n'
    + '=' * 80
    + '\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
)
IDL = """
#include "p/msg/Part.idl"
module p { module msg {
  typedef double p__double__3[3];
  module X_Constants { const uint8 KIND = 1; const string NAME = "a" "b"; };
  struct Part { double x; };
  @verbatim (language="comment", text="a (b)")
  struct X { @default (value=1.5) double x; sequence<float, 4> y; p__double__3 z; string<9> s;
    sequence<p::msg::Part> q; long n[1 + 2]; };
}; };
"""
PIECES = (
    *('<<', '>>', '*', '(', '((((', ')', '[', ']', '[1<<40]', '[4294967295]', '[-1]', '1e999'),
    *('9' * 50, '9' * 5000, '-', '~', '/', '%', '0', '"', "'", '\\', '@', '@a(', '/*', '//', '#'),
    *('const long A = 1<<1000000000;', 'const long A = A * A;', 'uint64 A=1e999', 'float64 B=nan'),
    *('module', 'struct', '{', '}', ';', 'sequence<', '>', 'typedef X X;', 'X x', 'X[] x', 'enum'),
    *('string', 'wstring', 'import os', '__import__("os")', 'class', 'None', 'x: y', '\n', '\0'),
    *('\N{SNOWMAN}', '=' * 80 + '\n', 'MSG: os/system\n', '[1000000] ', '\ud7ff', 'time t\n'),
)
TYPES = (
    *('p/msg/X', 'p/msg/X', 'std_msgs/msg/String', 'this/msg/x', 'os/path/join', './msg/x'),
    *('std_srvs/srv/Trigger', '', 'p', '/', 'p/msg/X\nint8 a', 'a' * 300, 'p/msg/' + 'X' * 300),
    *('../../msg/X', 'p/X', 'example_interfaces/action/Fibonacci', 'rcl_interfaces/msg/Log'),
)
TOPICS = ('/scan', '/t', '', '/rosout', '/a b', '/' + 'a' * 400, '/\0', '/\x1b[2J', 'x\ny', '//')
PROFILES = (
    *('', '- history: 1\n  depth: 5\n', '[' * 5000, '{a: ' * 3000, '- ' * 30_000, '&a [*a]'),
    *('- &a {history: 1}\n- *a', '- !!python/object/apply:os.system [true]', '"', '- {1: 2}'),
    *('- [[[[1]]]]', '1e999', '- history: 99999999999999999999\n', '- durability: [1]\n', '\0'),
)
METADATA = (
    *('', '[]', '[' * 5000, 'rosbag2_bagfile_information: 3', '- ' * 10_000, '&a [*a]'),
    'rosbag2_bagfile_information: {version: 9, relative_file_paths: [' + 'a' * 300 + ']}',
    'rosbag2_bagfile_information: {version: 9, relative_file_paths: ["../../etc/passwd"]}',
    'rosbag2_bagfile_information: {version: 9, relative_file_paths: [bag.mcap], message_count: x}',
    'rosbag2_bagfile_information: {version: 1e999}',
    'rosbag2_bagfile_information: {version: 9, topics_with_message_count: [{topic_metadata: '
    '{name: [a], offered_qos_profiles: ' + '[' * 900 + ']' * 900 + '}}]}',
)


def _edited(text: str, rng: np.random.Generator) -> str:
    """Return a text with a few pieces put in, taken out or repeated."""
    for _ in range(int(rng.integers(4))):
        at, size = int(rng.integers(len(text) + 1)), int(rng.geometric(0.1))
        piece = PIECES[int(rng.integers(len(PIECES)))]
        match int(rng.integers(4)):
            case 0:
                text = text[:at] + piece * int(rng.choice([1, 1, 1, 5, 300])) + text[at:]
            case 1:
                text = text[:at] + text[at + size :]
            case 2:
                text = text[:at] + piece + text[at + size :]
            case _:
                text = text[:at] + text[at : at + size] * int(rng.choice([2, 1000])) + text[at:]
    return text


def odd_call(rng: np.random.Generator, folder: Path) -> Callable[[], str]:
    """Write a whole recording with odd contents; return the call that reads it."""
    bag = folder / 'odd'
    shutil.rmtree(bag, ignore_errors=True)
    bag.mkdir()
    pick = lambda choices: choices[int(rng.integers(len(choices)))]  # noqa: E731
    with (bag / 'bag.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for _ in range(int(rng.integers(1, 4))):
            kind, text = pick([('ros2msg', MSG), ('ros2idl', IDL)])
            if rng.random() < 0.05:
                kind = pick(['', 'protobuf', 'x'])
            schema = writer.register_schema(pick(TYPES), kind, _edited(text, rng).encode())
            metadata = {'offered_qos_profiles': pick(PROFILES)} if rng.random() < 0.5 else {}
            channel = writer.register_channel(pick(TOPICS), 'cdr', schema, metadata)
            for time in range(3):
                data = b'\0\1\0\0' + rng.bytes(int(rng.integers(200)))
                writer.add_message(channel, 10**18 + time, data, time)
        writer.finish()
    if rng.random() < 0.3:
        text = pick(METADATA)
        (bag / 'metadata.yaml').write_text(text if rng.random() < 0.5 else _edited(text, rng))
    manifest = folder / 'manifest.yaml'
    name = pick(['odd', 'odd', 'odd/bag.mcap', 'a' * 300, '\0', '..', '.'])
    text = dump_yaml({'schema_version': 1, 'recordings': [{'path': name}]})
    manifest.write_text(text if rng.random() < 0.7 else _edited(text, rng))
    return lambda: ', '.join((read_odd(bag), read_manifest(manifest)))


def read_odd(path: Path) -> str:
    """Decode each message, and read numbers of each topic without decoding."""
    try:
        recording = Recording(path)
    except OccError as error:
        return refused(error)
    endings = set()
    for topic, info in recording.topics.items():
        is_latched(topic, info)
        source = FeatureSource('x', topic, 'x')
        for use in (
            lambda topic=topic: [recording.decode(m) for m in recording.messages([topic])],
            lambda source=source, topic=topic: extract([path], FeatureMap(topic, 0.5, (source,))),
        ):
            try:
                use()
                endings.add('read')
            except OccError as error:
                endings.add(refused(error))
    return 'read' if 'read' in endings else 'refused'


def read_manifest(path: Path) -> str:
    """Read what a manifest lists."""
    try:
        for selection in select([path]):
            Recording(selection.path)
    except OccError as error:
        return refused(error)
    return 'read'


def refused(error: OccError) -> str:
    """Return the ending of a case that was refused, and check that one sentence says so."""
    if not str(error) or '\n' in str(error):
        raise AssertionError(f'not one sentence: {error}') from error
    return 'refused'


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as place:
        watch(lambda number: call(number, Path(place)), int(sys.argv[1]), int(sys.argv[2]))
