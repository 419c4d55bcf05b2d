# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Bags that tests write without ROS: simulated drives as a recorder would have seen them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.bags.writer import BagWriter
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
