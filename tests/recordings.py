# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Real recordings, and messages and bags made up for one test."""

import os
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def _data(name):
    default = Path(__file__).parents[2] / 'shared' / 'data'
    folder = Path(os.environ.get('OCC_TEST_DATA', default)) / name
    if not folder.is_dir():
        pytest.skip(f'no test data at {folder}; set OCC_TEST_DATA')
    return folder


@pytest.fixture(scope='session')
def robots():
    """Return the folder of the real robots' recordings."""
    return _data('robots')


@pytest.fixture(scope='session')
def odd():
    """Return the folder of odd recordings: other people's test data."""
    return _data('odd')


@pytest.fixture(scope='session')
def cases():
    return _data('cases')


@pytest.fixture(scope='session')
def driving():
    """Return the folder of recorded road traffic."""
    return _data('driving')


class Messages:
    """Builds messages of rosbags."""

    def __init__(self):
        self.types = STORE.types

    def header(self, stamp_ns=0, frame=''):
        time = self.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
        return self.types['std_msgs/msg/Header'](time, frame)

    def scan(self, ranges, *, stamp_ns=0, least=0.1, range_max=4.0, first=0.0, step=0.1):
        return self.types['sensor_msgs/msg/LaserScan'](
            self.header(stamp_ns), first, 1.0, step, 0.0, 0.0, least, range_max,
            np.array(ranges, dtype=np.float32), np.array([], dtype=np.float32),
        )  # fmt: skip

    def vector(self, x, y, z):
        return self.types['geometry_msgs/msg/Vector3'](x, y, z)

    def quaternion(self, x, y, z, w):
        return self.types['geometry_msgs/msg/Quaternion'](x, y, z, w)

    def twist(self, x=0.0, y=0.0, wz=0.0):
        return self.types['geometry_msgs/msg/Twist'](
            self.vector(x, y, 0.0), self.vector(0.0, 0.0, wz)
        )

    def odometry(self, *, stamp_ns=0, x=0.0, wz=0.0, orientation=None, frame='odom'):
        types = self.types
        point = types['geometry_msgs/msg/Point'](x, 0.0, 0.0)
        orientation = orientation or self.quaternion(0.0, 0.0, 0.0, 1.0)
        pose = types['geometry_msgs/msg/Pose'](point, orientation)
        return types['nav_msgs/msg/Odometry'](
            self.header(stamp_ns, frame), 'base_link',
            types['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
            types['geometry_msgs/msg/TwistWithCovariance'](self.twist(x=x, wz=wz), np.zeros(36)),
        )  # fmt: skip

    def imu(self, orientation, *, stamp_ns=0):
        return self.types['sensor_msgs/msg/Imu'](
            self.header(stamp_ns), orientation, np.zeros(9),
            self.vector(0.0, 0.0, 0.0), np.zeros(9), self.vector(0.0, 0.0, 0.0), np.zeros(9),
        )  # fmt: skip

    def joints(self, stamp_ns, names, position=(), velocity=(), effort=()):
        arrays = (np.array(values, dtype=np.float64) for values in (position, velocity, effort))
        header = self.header(stamp_ns)
        return self.types['sensor_msgs/msg/JointState'](header, list(names), *arrays)

    def table(self, names, values, *, stamp_ns=0):
        table = Table(tuple(names), np.asarray(values))
        field = self.types['sensor_msgs/msg/PointField']
        size = table.values.dtype.itemsize * len(names)
        rows = len(table.values)
        return self.types['sensor_msgs/msg/PointCloud2'](
            self.header(stamp_ns), 1, rows, [field(*item) for item in table.layout], False,
            size, size * rows, np.frombuffer(table.packed(), dtype=np.uint8), True,
        )  # fmt: skip


def write_typed(path, store, entries):
    """Write ``(topic, message, time)`` triples of any types that a store knows to an MCAP file."""
    with path.open('wb') as stream:
        writer, channels = Writer(stream), {}
        writer.start('ros2')
        for topic, message, time in entries:
            name = message.__msgtype__
            if topic not in channels:
                text, _ = store.generate_msgdef(name, ros_version=2)
                schema = writer.register_schema(name, 'ros2msg', text.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            data = bytes(store.serialize_cdr(message, name))
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


@pytest.fixture(scope='session')
def messages():
    return Messages()


@pytest.fixture(scope='session')
def write_entries():
    """Return a function that writes ``(topic, message, time)`` triples to a new bag."""

    def write(path, entries, **options):
        with BagWriter(path, **options) as bag:
            for topic, message, time in entries:
                data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
                bag.write(topic, message.__msgtype__, data, time)
        return path

    return write


@pytest.fixture
def write_bag(tmp_path, write_entries):
    """Return a function that writes such triples to a bag of the test and returns it."""
    return lambda entries, name='bag', **options: write_entries(tmp_path / name, entries, **options)
