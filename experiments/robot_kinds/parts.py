# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What many kinds of robots publish: odometry, Imu, battery, scan, joint states."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.messages import START_NS, make


def header(time: float, frame: str = 'base_link') -> Any:
    """Return a header with a stamp."""
    return make('std_msgs/Header', stamp=stamp(time), frame_id=frame)


def stamp(time: float) -> Any:
    """Return a Time."""
    seconds, rest = divmod(START_NS + round(time * 1e9), 10**9)
    return make('builtin_interfaces/Time', sec=seconds, nanosec=rest)


def vector(x: float, y: float, z: float) -> Any:
    """Return a Vector3."""
    return make('geometry_msgs/Vector3', x=x, y=y, z=z)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a rotation by roll, pitch and yaw."""
    cr, cp, cy = (math.cos(angle / 2) for angle in (roll, pitch, yaw))
    sr, sp, sy = (math.sin(angle / 2) for angle in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def orientation(roll: float, pitch: float, yaw: float) -> Any:
    """Return the same as a message."""
    w, x, y, z = quaternion(roll, pitch, yaw)
    return make('geometry_msgs/Quaternion', x=x, y=y, z=z, w=w)


def pose(x: float, y: float, z: float, angles: tuple[float, float, float]) -> Any:
    """Return a Pose."""
    point = make('geometry_msgs/Point', x=x, y=y, z=z)
    return make('geometry_msgs/Pose', position=point, orientation=orientation(*angles))


def odometry(time: float, where: Any, linear: Any, turn: float) -> Any:
    """Return an Odometry."""
    twist = make('geometry_msgs/Twist', linear=linear, angular=vector(0.0, 0.0, turn))
    return make(
        'nav_msgs/Odometry',
        header=header(time, 'odom'),
        child_frame_id='base_link',
        pose=make('geometry_msgs/PoseWithCovariance', pose=where),
        twist=make('geometry_msgs/TwistWithCovariance', twist=twist),
    )


def imus(drive: Drive, topic: str, *, sway: float = 0.05, rate: float = 50.0) -> Iterator[Any]:
    """Yield an Imu that sways; the faults ``tilt`` and ``collision`` show in it."""
    roll, pitch = drive.goals('roll', -sway, sway, 5.0), drive.goals('pitch', -sway, sway, 6.0)
    turn, jolt = drive.goals('gyro', -0.6, 0.6, 6.0), drive.noise('jolt', 0.08)
    for time in drive.ticks(rate):
        lean = 0.6 if drive.has('tilt', time) else 0.0
        hit = 25.0 if drive.has('collision', time) and (time * 2) % 1 < 0.2 else 0.0
        yield (
            time,
            topic,
            make(
                'sensor_msgs/Imu',
                header=header(time, 'imu'),
                orientation=orientation(roll(time) + lean, pitch(time), time % 3.0),
                angular_velocity=vector(roll(time) * 2, pitch(time) * 2, turn(time)),
                linear_acceleration=vector(
                    9.81 * pitch(time) + jolt() + hit, 9.81 * roll(time) + jolt(), 9.7 + jolt()
                ),
            ),
        )


def batteries(drive: Drive, topic: str, full: float, *, rate: float = 1.0) -> Iterator[Any]:
    """Yield a BatteryState that drains; the fault ``low battery`` shows in it."""
    start = drive.between('charge', 0.5, 0.95)
    load, ripple = drive.goals('load', -4.0, -1.5), drive.noise('volt', 0.002 * full)
    for time in drive.ticks(rate):
        charge = 0.1 if drive.has('low battery', time) else start - 0.0005 * time
        yield (
            time,
            topic,
            make(
                'sensor_msgs/BatteryState',
                header=header(time),
                voltage=full * (0.8 + 0.2 * charge) + ripple(),
                percentage=charge,
                current=load(time),
                charge=math.nan,
                capacity=math.nan,
                temperature=math.nan,
                power_supply_status=2,
                present=True,
            ),
        )


def scans(drive: Drive, topic: str, rate: float = 10.0) -> Iterator[Any]:
    """Yield a LaserScan between walls; the fault ``collision`` shows in it."""
    walls = [drive.goals(f'wall{place}', 0.6, 4.0, 11.0 + place) for place in range(8)]
    rng = np.random.default_rng(drive.seed)
    for time in drive.ticks(rate):
        corners = np.array([wall(time) for wall in walls])
        ranges = np.interp(np.arange(180) / 22.5 % 8, np.arange(9), [*corners, corners[0]])
        ranges += rng.normal(0.0, 0.01, 180)
        if drive.has('collision', time):
            ranges[80:100] = 0.15
        ranges[rng.random(180) < 0.05] = math.inf
        yield (
            time,
            topic,
            make(
                'sensor_msgs/LaserScan',
                header=header(time, 'laser'),
                angle_min=-math.pi,
                angle_max=math.pi - math.tau / 180,
                angle_increment=math.tau / 180,
                range_min=0.1,
                range_max=10.0,
                ranges=ranges.astype(np.float32),
            ),
        )


def rolling(drive: Drive, space: str = '', top: float = 0.6, rate: float = 20.0) -> Iterator[Any]:
    """Yield commands and odometry of a base on wheels; ``too fast``, ``stall``."""
    speed, turn = drive.goals('speed', 0.0, top), drive.goals('turn', -0.8, 0.8, 9.0)
    slip, x = drive.noise('slip', 0.01), 0.0
    for time in drive.ticks(rate):
        wanted, spin = speed(time), turn(time)
        got = speed(max(time - 0.1, 0.0)) + slip()
        if drive.has('stall', time):
            got = 0.0
        if drive.has('too fast', time):
            got = wanted = 2.0 * top
        x += got / rate
        twist = make(
            'geometry_msgs/Twist', linear=vector(wanted, 0.0, 0.0), angular=vector(0.0, 0.0, spin)
        )
        yield time, f'{space}/cmd_vel', twist
        where = pose(x, 0.0, 0.0, (0.0, 0.0, time % 3.0))
        yield (
            time,
            f'{space}/odom',
            odometry(time, where, vector(got, 0.0, 0.0), turn(max(time - 0.1, 0.0)) + slip()),
        )


def joint_state(time: float, values: dict[str, tuple[float, float, float]]) -> Any:
    """Return a JointState of name to position, velocity and effort."""
    table = np.array(list(values.values()), dtype=float)
    return make(
        'sensor_msgs/JointState',
        header=header(time, ''),
        name=list(values),
        position=table[:, 0].copy(),
        velocity=table[:, 1].copy(),
        effort=table[:, 2].copy(),
    )


def joints(drive: Drive, ranges: dict[str, tuple[float, float, float]]) -> Callable[[float], Any]:
    """Return a function of time to the values of joints, with ``stall`` and ``too fast``.

    Args:
        drive: the drive.
        ranges: name to smallest and largest position, and largest effort.
    """
    moves = {
        name: (drive.goals(name, low, high, 8.0), drive.goals(f'{name} load', 0.2 * load, load))
        for name, (low, high, load) in ranges.items()
    }
    # The joint in the middle of the list has the faults.
    bad, rough = list(ranges)[len(ranges) // 2], drive.noise('effort', 0.02)

    def values(time: float) -> dict[str, tuple[float, float, float]]:
        found = {}
        for name, (position, load) in moves.items():
            speed = (position(time + 0.01) - position(time - 0.01)) / 0.02
            effort = load(time) * (1.0 + rough())
            if name == bad and drive.has('stall', time):
                speed, effort = 0.0, 3.0 * ranges[name][2]
            if name == bad and drive.has('too fast', time):
                speed = 12.0
            found[name] = (position(time), speed, effort)
        return found

    return values
