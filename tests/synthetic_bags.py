# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Bags that tests write without ROS: simulated drives as a recorder would have seen them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rosbag.writer import BagWriter
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
STEP = ('reward', 'terminated', 'truncated', 'episode', 'true_cost')
START_NS = 1_700_000_000_000_000_000


def table_message(table: Table, stamp_ns: int, frame: str = ''):
    """Return a table as the PointCloud2 of rosbags."""
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    header = types['std_msgs/msg/Header'](time, frame)
    rows = len(table.values)
    size = table.values.dtype.itemsize * len(table.names)
    fields = [types['sensor_msgs/msg/PointField'](*field) for field in table.layout]
    data = np.frombuffer(table.packed(), dtype=np.uint8)
    return types['sensor_msgs/msg/PointCloud2'](
        header, 1, rows, fields, False, size, size * rows, data, True
    )


def write_drive(
    path: Path,
    *,
    driver: str = 'expert',
    robots: int = 40,
    steps: int = 100,
    topic: str = '/observation',
    seed: int = 0,
) -> Path:
    """Write the observations of robots in simple_nav to a new bag and return it."""
    world = make_world('simple_nav', robots)
    drive = find_driver(world, driver, np.random.default_rng(seed))
    stream = EpisodeStream(world, seed=seed)
    names = (*(column.name for column in world.columns), *STEP)
    batch = stream.reset()
    with BagWriter(path) as bag:
        for step in range(steps):
            columns = [batch.observation, *(getattr(batch, name)[:, None] for name in STEP)]
            table = Table(names, np.concatenate(columns, axis=1).astype(np.float32))
            stamp = START_NS + step * 10**8
            message = table_message(table, stamp, world.name)
            data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
            bag.write(topic, message.__msgtype__, data, stamp)
            batch = stream.step(drive(batch.observation))
    return path


def write_rover(
    path: Path,
    *,
    seconds: float = 12.0,
    seed: int = 0,
    backlog: float = 0.0,
    ahead: float = 0.0,
    **options,
) -> Path:
    """Write a bag of a robot with odometry at 20 Hz, a scanner at 5 Hz and a command now and then.

    It has what real bags have: a scanner that misses beams, odometry that pauses, commands that
    carry no stamp and stop, log times that lag behind stamps, a scan that comes twice.

    Args:
        path: of the bag.
        seconds: its length.
        seed: of its values.
        backlog: seconds by which all that is stamped from 7 s on is logged later.
        ahead: seconds by which the clock of the log is ahead of that of the stamps.
        **options: see :class:`BagWriter`.
    """
    types, rng = STORE.types, np.random.default_rng(seed)
    name = {kind: f'{package}/msg/{kind}' for package, kinds in {
        'builtin_interfaces': ['Time'], 'std_msgs': ['Header'],
        'geometry_msgs': ['Vector3', 'Point', 'Quaternion', 'Pose', 'Twist', 'PoseWithCovariance',
                          'TwistWithCovariance'],
        'nav_msgs': ['Odometry'], 'sensor_msgs': ['LaserScan'],
    }.items() for kind in kinds}  # fmt: skip

    def make(kind, *fields):
        return types[name[kind]](*fields)

    def header(stamp, frame):
        return make('Header', make('Time', *divmod(stamp, 10**9)), frame)

    def twist(x, wz):
        return make('Twist', make('Vector3', x, 0.0, 0.0), make('Vector3', 0.0, 0.0, wz))

    entries = []
    for tick in range(round(seconds * 20)):
        stamp, phase = START_NS + tick * 50_000_000, tick / 30
        speed, turn = 0.3 + 0.2 * np.sin(phase), 0.5 * np.cos(phase)
        if not 5.0 < tick / 20 < 6.0:
            pose = make('Pose', make('Point', phase, 0.0, 0.0),
                        make('Quaternion', 0.0, 0.0, np.sin(phase), np.cos(phase)))  # fmt: skip
            odom = make('Odometry', header(stamp, 'odom'), 'base_link',
                        make('PoseWithCovariance', pose, np.zeros(36)),
                        make('TwistWithCovariance', twist(speed, turn), np.zeros(36)))  # fmt: skip
            entries.append((stamp + int(rng.integers(1e6, 9e6)), '/odom', odom))
        if tick % 4 == 0:
            ranges = (2.0 + np.sin(phase) + rng.normal(0.0, 0.1, 36)).astype(np.float32)
            ranges[rng.random(36) < 0.2] = rng.choice([0.0, np.inf, np.nan])
            scan = make('LaserScan', header(stamp, 'laser'), 0.0, 6.1, 0.17, 0.0, 0.2, 0.1, 3.5,
                        ranges, np.array([], dtype=np.float32))  # fmt: skip
            late = int(rng.integers(1e6, 30e6))
            entries += [(stamp + late, '/scan', scan)] * (2 if tick == 40 else 1)
        if tick % 7 == 0 and tick / 20 < 8.0:
            entries.append((stamp + int(rng.integers(1e6, 9e6)), '/cmd_vel', twist(speed, turn)))
    with BagWriter(path, **options) as bag:
        for time, topic, message in sorted(entries, key=lambda entry: entry[0]):
            data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
            late = backlog if time >= START_NS + 7 * 10**9 else 0.0
            bag.write(topic, message.__msgtype__, data, time + round((late + ahead) * 1e9))
    return path


ROVER_MAP = """
schema_version: 1
pace: /scan
max_age: 0.4
features:
  - {name: v, topic: /odom, field: twist.twist.linear.x, unit: m/s}
  - {name: w, topic: /odom, field: twist.twist.angular.z, unit: rad/s, transform: abs}
  - {name: yaw, topic: /odom, field: pose.pose.orientation, unit: rad, transform: yaw}
  - {name: closest, topic: /scan, field: 'ranges[:]', unit: m, reduce: min, missing: max_range}
  - {name: ahead, topic: /scan, field: 'ranges[0:5]', unit: m, reduce: mean, missing: max_range}
  - {name: sector, topic: /scan, field: ranges, unit: m, sectors: 3, reduce: min, missing: drop}
  - {name: gain, topic: /odom, field: twist.twist.linear.x, unit: m/s^2, transform: rate}
  - {name: command, topic: /cmd_vel, field: linear.x, unit: m/s}
  - name: lag
    topic: /cmd_vel
    field: linear.x
    unit: m/s
    minus: {topic: /odom, field: twist.twist.linear.x}
"""
