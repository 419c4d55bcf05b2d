# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Triage of two hundred recordings of a small robot, of which ten are bad in six ways."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.datasets.each import in_processes, usable_cores
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.typesys import Stores, get_typestore

_RECORDINGS, _BAD, _FIRST = 200, 10, 12
_SECONDS, _BEAMS = 27.0, 360
_START_NS = 1_700_000_000_000_000_000
# Messages per second, about as a TurtleBot3 publishes them.
_RATES = {'/imu': 200, '/odom': 30, '/scan': 5}
MAP = """\
schema_version: 1
pace: scan
max_age: 0.5
features:
- {name: speed, topic: odom, field: twist.twist.linear.x, unit: m/s}
- {name: turn_rate, topic: odom, field: twist.twist.angular.z, unit: rad/s}
- {name: clearance, topic: scan, field: ranges, sectors: 8, reduce: min, missing: max_range,
   unit: m, bounds: [0, null]}
- {name: acceleration_x, topic: imu, field: linear_acceleration.x, unit: m/s^2}
- {name: acceleration_y, topic: imu, field: linear_acceleration.y, unit: m/s^2}
- {name: yaw_rate, topic: imu, field: angular_velocity.z, unit: rad/s}
"""
"""A feature map for the drives."""

FAULTS = ('too fast', 'too close', 'stuck', 'offset', 'spike', 'wrong direction')
"""What a drive may have."""


class Drive:
    """One drive: smooth random signals, and from its middle on perhaps a fault.

    Args:
        seed: of the signals.
        fault: one of :data:`FAULTS`; empty for none.
    """

    def __init__(self, seed: int, fault: str = '') -> None:
        self._rng = np.random.default_rng(seed)
        self._fault = fault
        self._phases = self._rng.uniform(0.0, 2 * np.pi, 8)
        self._pace = self._rng.uniform(0.7, 1.0)
        self._room = self._rng.uniform(1.5, 3.0)

    def has(self, fault: str, at: float, seconds: float = 6.0) -> bool:
        """Tell whether a fault is present, which lasts so long."""
        return self._fault == fault and 0.0 <= at - _SECONDS / 2 < seconds

    def speed(self, at: float) -> float:
        """Return the speed in m/s."""
        speed = self._pace * (0.13 + 0.09 * np.sin(0.5 * at + self._phases[0]))
        if self.has('too fast', at):
            speed += 0.15
        if self.has('wrong direction', at):
            speed = -speed
        return speed

    def turn_rate(self, at: float) -> float:
        """Return the turn rate in rad/s."""
        if self.has('spike', at, 0.2):
            return 4.0
        return self._pace * 0.8 * np.sin(0.37 * at + self._phases[1])

    def odometry(self, at: float) -> tuple[float, float]:
        """Return speed and turn rate as measured."""
        if self.has('stuck', at):
            at = _SECONDS / 2
            return self.speed(at), self.turn_rate(at)
        noise = self._rng.normal(0.0, 0.002, 2)
        return self.speed(at) + noise[0], self.turn_rate(at) + noise[1]

    def ranges(self, at: float) -> np.ndarray:
        """Return what the scanner measures, in m."""
        angles = np.linspace(0.0, 2 * np.pi, _BEAMS, endpoint=False)
        away = 0.5 * (self._room - 0.3) * (1 + np.sin(angles + 0.2 * at + self._phases[2]))
        ranges = 0.3 + away + self._rng.normal(0.0, 0.01, _BEAMS)
        return ranges * 0.4 if self.has('too close', at) else ranges

    def imu(self, at: float) -> tuple[float, float, float]:
        """Return accelerations in m/s^2 and the yaw rate in rad/s."""
        noise = self._rng.normal(0.0, 0.05, 3)
        sideways = self.speed(at) * self.turn_rate(at) + noise[1]
        if self.has('offset', at, _SECONDS):
            sideways += 0.6
        return 0.05 * np.cos(0.5 * at + self._phases[0]) + noise[0], sideways, noise[2]


def run(seconds: float = 0.0) -> dict[str, Any]:
    """Time ``occ triage`` on recordings of the size of a TurtleBot3's, and rank the bad ones.

    Args:
        seconds: has no effect; the work is what it is.
    """
    rng = np.random.default_rng(0)
    places = rng.choice(_RECORDINGS, _BAD, replace=False).tolist()
    faults = {place: FAULTS[number % len(FAULTS)] for number, place in enumerate(places)}
    cores = usable_cores()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'map.yaml').write_text(MAP)
        drives = [(place, faults.get(place, '')) for place in range(_RECORDINGS)]
        in_processes(partial(_write, folder / 'bags'), drives, cores)
        size = sum(file.stat().st_size for file in folder.rglob('*.mcap'))
        begin = time.monotonic()
        command = [sys.executable, '-m', 'occ_constraints_pkg', 'triage', 'bags', '-m', 'map.yaml']
        done = subprocess.run([*command, '--json'], cwd=folder, capture_output=True, text=True)
        took = time.monotonic() - begin
    if done.returncode != 1:
        raise RuntimeError(f'occ triage ended with {done.returncode}: {done.stderr}')
    ranked = [item['name'] for item in json.loads(done.stdout)['recordings']]
    ranks = sorted(ranked.index(f'drive_{place}') + 1 for place in places)
    return {
        'metrics': {
            'triage_s': took,
            'bad_in_first_12': sum(rank <= _FIRST for rank in ranks),
            'last_bad_rank': ranks[-1],
        },
        'peers': {},
        'settings': {
            'recordings': _RECORDINGS,
            'megabytes': size / 1e6,
            'messages_per_recording': round(_SECONDS * sum(_RATES.values())),
            'cores': cores,
            'faults': sorted(set(faults.values())),
            'ranks': ranks,
        },
    }


def _write(folder: Path, drive: tuple[int, str]) -> None:
    place, fault = drive
    write_drive(folder / f'drive_{place}', Drive(place, fault))


def write_drive(path: Path, drive: Drive, seconds: float = _SECONDS) -> None:
    """Write the first seconds of a drive as a new bag."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with BagWriter(path, compression='none') as bag:
        for at, topic in _instants(seconds):
            stamp = _START_NS + round(at * 1e9)
            message = _MESSAGES[topic](store.types, drive, at, stamp)
            data = bytes(store.serialize_cdr(message, message.__msgtype__))
            bag.write(topic, message.__msgtype__, data, stamp)


def _instants(seconds: float) -> Iterator[tuple[float, str]]:
    instants = [
        (count / rate, topic)
        for topic, rate in _RATES.items()
        for count in range(round(seconds * rate))
    ]
    yield from sorted(instants)


def _header(types: Any, stamp: int, frame: str) -> Any:
    time_type = types['builtin_interfaces/msg/Time']
    return types['std_msgs/msg/Header'](time_type(*divmod(stamp, 10**9)), frame)


def _odometry(types: Any, drive: Drive, at: float, stamp: int) -> Any:
    speed, turn_rate = drive.odometry(at)
    vector, point = types['geometry_msgs/msg/Vector3'], types['geometry_msgs/msg/Point']
    pose = types['geometry_msgs/msg/Pose'](
        point(0.0, 0.0, 0.0), types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)
    )
    twist = types['geometry_msgs/msg/Twist'](vector(speed, 0.0, 0.0), vector(0.0, 0.0, turn_rate))
    return types['nav_msgs/msg/Odometry'](
        _header(types, stamp, 'odom'), 'base_footprint',
        types['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
        types['geometry_msgs/msg/TwistWithCovariance'](twist, np.zeros(36)),
    )  # fmt: skip


def _scan(types: Any, drive: Drive, at: float, stamp: int) -> Any:
    return types['sensor_msgs/msg/LaserScan'](
        _header(types, stamp, 'laser'), 0.0, 2 * np.pi, 2 * np.pi / _BEAMS, 0.0, 0.2, 0.1, 12.0,
        drive.ranges(at).astype(np.float32), np.zeros(0, dtype=np.float32),
    )  # fmt: skip


def _imu(types: Any, drive: Drive, at: float, stamp: int) -> Any:
    forward, sideways, yaw_rate = drive.imu(at)
    vector, covariance = types['geometry_msgs/msg/Vector3'], np.zeros(9)
    return types['sensor_msgs/msg/Imu'](
        _header(types, stamp, 'imu_link'),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0), covariance,
        vector(0.0, 0.0, yaw_rate), covariance, vector(forward, sideways, 9.81), covariance,
    )  # fmt: skip


_MESSAGES: dict[str, Callable[..., Any]] = {'/imu': _imu, '/odom': _odometry, '/scan': _scan}
