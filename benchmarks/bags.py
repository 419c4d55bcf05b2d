# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Extraction of features from a bag beside reading and deserializing it with ``rosbags``."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

_MEGABYTES = 200
_BEAMS = 720
_START_NS = 1_700_000_000_000_000_000
_TICK_NS = 10_000_000
# Messages per 100 ticks of 10 ms: 100, 50 and 20 Hz.
_EVERY = {'/imu': 1, '/odom': 2, '/scan': 5}
_ROUNDS = 3


def run(seconds: float | None = None) -> dict[str, Any]:
    """Compare, on a bag of Imu 100 Hz, Odometry 50 Hz and LaserScan 20 Hz of 200 MB.

    The two take turns in one process, and its processor time is what counts, which the load of the
    machine changes least. What the pace is matters: with ``/scan`` one message of eight gives a
    row, with ``/imu`` more than half of them do; both are measured. Extraction is what ``occ
    check`` does: hashes of the files, which ``occ learn`` writes down, are not computed.

    Args:
        seconds: how long the measurement goes on at least; default: three rounds.
    """
    with tempfile.TemporaryDirectory() as folder:
        bags = {name: Path(folder) / name for name in ('none', 'zstd')}
        for name, path in bags.items():
            _write(path, name)
        count = Recording(bags['none']).message_count
        size = sum(file.stat().st_size for file in Recording(bags['none']).files)
        work = {
            'extract': lambda: _extract(bags['none'], 'scan'),
            'extract_pace_imu': lambda: _extract(bags['none'], 'imu'),
            'extract_zstd': lambda: _extract(bags['zstd'], 'scan'),
            'rosbags': lambda: _deserialize(bags['none']),
            'rosbags_zstd': lambda: _deserialize(bags['zstd']),
        }
        best = _best_times(work, seconds)
    metrics = {f'{name}_us_per_message': 1e6 * best[name] / count for name in work}
    peers = {name: metrics.pop(name) for name in list(metrics) if name.startswith('rosbags')}
    metrics['extract_times_as_fast_ratio'] = best['rosbags'] / best['extract']
    metrics['extract_pace_imu_times_as_fast_ratio'] = best['rosbags'] / best['extract_pace_imu']
    metrics['extract_zstd_times_as_fast_ratio'] = best['rosbags_zstd'] / best['extract_zstd']
    return {
        'metrics': metrics,
        'peers': peers,
        'settings': {
            'megabytes': size / 1e6,
            'messages': count,
            'beams': _BEAMS,
            'features': len(_feature_map('scan').features),
        },
    }


def _best_times(work: dict[str, Callable[[], Any]], seconds: float | None) -> dict[str, float]:
    """Return the shortest time of each in seconds; they take turns, so that load meets all."""
    best = dict.fromkeys(work, float('inf'))
    start, rounds = time.process_time(), 0
    while rounds < 1 or (
        rounds < _ROUNDS if seconds is None else time.process_time() - start < seconds
    ):
        for name, call in work.items():
            begin = time.process_time()
            call()
            best[name] = min(best[name], time.process_time() - begin)
        rounds += 1
    return best


def _feature_map(pace: str) -> FeatureMap:
    """Return 20 features: sectors of the scan, velocities, rates, accelerations, the heading."""
    width = _BEAMS // 8
    sectors = [
        FeatureSource(
            f'd_{number}',
            'scan',
            f'ranges[{number * width}:{(number + 1) * width}]',
            reduce='min',
            missing='max_range',
        )
        for number in range(8)
    ]
    odometry = {
        'v_x': 'twist.twist.linear.x',
        'v_y': 'twist.twist.linear.y',
        'w_z': 'twist.twist.angular.z',
        'p_x': 'pose.pose.position.x',
        'p_y': 'pose.pose.position.y',
    }
    imu = {f'a_{axis}': f'linear_acceleration.{axis}' for axis in 'xyz'}
    imu |= {f'g_{axis}': f'angular_velocity.{axis}' for axis in 'xyz'}
    features = [
        *sectors,
        *(FeatureSource(name, 'odom', field) for name, field in odometry.items()),
        FeatureSource('yaw', 'odom', 'pose.pose.orientation', transform='yaw'),
        *(FeatureSource(name, 'imu', field) for name, field in imu.items()),
    ]
    return FeatureMap(pace, 0.5, tuple(features))


def _extract(path: Path, pace: str) -> None:
    data = extract([path], _feature_map(pace), provenance=False)
    # All but the rows before the first odometry and scan are complete.
    if np.isfinite(data.values).all(axis=1).sum() < len(data) - 10:
        raise RuntimeError('the extracted features are not those that were written')


def _deserialize(path: Path) -> int:
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
        return reader.message_count


def _write(path: Path, compression: str) -> None:
    rng = np.random.default_rng(0)
    store = get_typestore(Stores.ROS2_JAZZY)
    written, tick = 0, 0
    with BagWriter(path, compression=compression) as bag:
        while written < _MEGABYTES * 1e6:
            stamp = _START_NS + tick * _TICK_NS
            for topic, every in _EVERY.items():
                if tick % every == 0:
                    message = _MESSAGES[topic](store.types, rng, stamp)
                    data = bytes(store.serialize_cdr(message, message.__msgtype__))
                    bag.write(topic, message.__msgtype__, data, stamp)
                    # What MCAP stores beside a message: record head, channel, times, index entry.
                    written += len(data) + 47
            tick += 1


def _header(types: Any, stamp_ns: int, frame: str) -> Any:
    stamp = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return types['std_msgs/msg/Header'](stamp, frame)


def _vector(types: Any, rng: np.random.Generator) -> Any:
    return types['geometry_msgs/msg/Vector3'](*rng.normal(size=3).tolist())


def _quaternion(types: Any, rng: np.random.Generator) -> Any:
    return types['geometry_msgs/msg/Quaternion'](*rng.normal(size=4).tolist())


def _imu(types: Any, rng: np.random.Generator, stamp: int) -> Any:
    covariance = np.zeros(9)
    return types['sensor_msgs/msg/Imu'](
        _header(types, stamp, 'imu_link'), _quaternion(types, rng), covariance,
        _vector(types, rng), covariance, _vector(types, rng), covariance,
    )  # fmt: skip


def _odometry(types: Any, rng: np.random.Generator, stamp: int) -> Any:
    point = types['geometry_msgs/msg/Point'](*rng.normal(size=3).tolist())
    pose = types['geometry_msgs/msg/Pose'](point, _quaternion(types, rng))
    twist = types['geometry_msgs/msg/Twist'](_vector(types, rng), _vector(types, rng))
    return types['nav_msgs/msg/Odometry'](
        _header(types, stamp, 'odom'), 'base_footprint',
        types['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
        types['geometry_msgs/msg/TwistWithCovariance'](twist, np.zeros(36)),
    )  # fmt: skip


def _scan(types: Any, rng: np.random.Generator, stamp: int) -> Any:
    ranges = rng.uniform(0.1, 12.0, _BEAMS).astype(np.float32)
    ranges[rng.random(_BEAMS) < 0.1] = np.inf
    return types['sensor_msgs/msg/LaserScan'](
        _header(types, stamp, 'laser'), 0.0, 6.28, 6.28 / _BEAMS, 0.0, 0.05, 0.1, 12.0,
        ranges, np.zeros(0, dtype=np.float32),
    )  # fmt: skip


_MESSAGES = {'/imu': _imu, '/odom': _odometry, '/scan': _scan}
