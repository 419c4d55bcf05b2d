# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots that fly, dive or swim."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.messages import make
from experiments.robot_kinds.parts import (
    batteries,
    header,
    imus,
    orientation,
    pose,
    quaternion,
    vector,
)


def _flight(drive: Drive) -> Callable[[float], dict[str, Any]]:
    roll, pitch = drive.goals('roll', -0.2, 0.2, 4.0), drive.goals('pitch', -0.2, 0.2, 5.0)
    height, speed = drive.goals('height', 2.0, 12.0, 15.0), drive.goals('speed', 0.0, 5.0)
    course = drive.goals('course', -3.0, 3.0, 30.0)

    def state(time: float) -> dict[str, Any]:
        lean = 0.9 if drive.has('tilt', time) else 0.0
        fast = 8.0 if drive.has('too fast', time) else 0.0
        climb = (height(time + 0.01) - height(time - 0.01)) / 0.02
        ahead, way = speed(time) + fast, course(time)
        return {
            'angles': (roll(time) + lean, pitch(time), way),
            'velocity': (ahead * math.cos(way), ahead * math.sin(way), climb),
            'height': height(time),
            'rates': (roll(time), pitch(time), 0.2 * math.sin(time)),
        }

    return state


def px4(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a quadrotor on PX4: no headers, times since boot, down is positive."""
    state, boot = _flight(drive), 10.0 + 60.0 * drive.seed
    for time in drive.ticks(50.0):
        now, clock = state(time), int((boot + time) * 1e6)
        x, y, z = now['velocity']
        yield (
            time,
            '/fmu/out/vehicle_odometry',
            make(
                'px4_msgs/VehicleOdometry',
                timestamp=clock,
                timestamp_sample=clock - 2000,
                pose_frame=1,
                position=np.array([time, math.sin(time), -now['height']], np.float32),
                q=np.array(quaternion(*now['angles']), np.float32),
                velocity=np.array([x, y, -z], np.float32),
                angular_velocity=np.array(now['rates'], np.float32),
                position_variance=np.array([0.1, 0.1, 0.2], np.float32),
            ),
        )
    start, draw = drive.between('volt', 15.4, 16.6), drive.goals('draw', 9.0, 15.0)
    for time in drive.ticks(2.0):
        is_low = drive.has('low battery', time)
        yield (
            time,
            '/fmu/out/battery_status',
            make(
                'px4_msgs/BatteryStatus',
                timestamp=int((boot + time) * 1e6),
                connected=True,
                voltage_v=13.6 if is_low else start - 0.005 * time,
                current_a=draw(time),
                discharged_mah=3.0 * time,
                remaining=0.1 if is_low else (start - 14.0) / 2.8 - 0.001 * time,
                cell_count=4,
                cycle_count=12 + drive.seed,
                id=1,
            ),
        )
        yield (
            time,
            '/fmu/out/vehicle_status',
            make(
                'px4_msgs/VehicleStatus',
                timestamp=int((boot + time) * 1e6),
                armed_time=int(boot * 1e6),
                arming_state=2,
                nav_state=14,
            ),
        )


def mavros(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a quadrotor by way of mavros."""
    state, jolt = _flight(drive), drive.noise('jolt', 0.2)
    for time in drive.ticks(30.0):
        now = state(time)
        yield (
            time,
            '/mavros/imu/data',
            make(
                'sensor_msgs/Imu',
                header=header(time),
                orientation=orientation(*now['angles']),
                angular_velocity=vector(*now['rates']),
                linear_acceleration=vector(jolt(), jolt(), 9.81 + jolt()),
            ),
        )
        yield (
            time,
            '/mavros/local_position/pose',
            make(
                'geometry_msgs/PoseStamped',
                header=header(time, 'map'),
                pose=pose(time, math.sin(time), now['height'], now['angles']),
            ),
        )
        twist = make('geometry_msgs/Twist', linear=vector(*now['velocity']))
        yield (
            time,
            '/mavros/local_position/velocity_local',
            make('geometry_msgs/TwistStamped', header=header(time, 'map'), twist=twist),
        )
    for time in drive.ticks(5.0):
        yield (
            time,
            '/mavros/global_position/global',
            make(
                'sensor_msgs/NavSatFix',
                header=header(time),
                latitude=47.0 + 0.001 * drive.seed + 1e-6 * time,
                longitude=8.0,
                altitude=450.0 + state(time)['height'],
            ),
        )
    yield from batteries(drive, '/mavros/battery', 16.8, rate=2.0)


def auv(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an underwater vehicle."""
    depth, speed = drive.goals('depth', 3.0, 20.0, 20.0), drive.goals('speed', 0.0, 1.2)
    ground_at, sway = drive.goals('ground', 26.0, 32.0, 17.0), drive.noise('sway', 0.01)
    for time in drive.ticks(20.0):
        deep = depth(time) + (15.0 if drive.has('too deep', time) else 0.0)
        climb = -(depth(time + 0.01) - depth(time - 0.01)) / 0.02
        twist = make(
            'geometry_msgs/Twist',
            linear=vector(speed(time), sway(), climb),
            angular=vector(0.0, 0.0, 0.2 * math.sin(time / 3)),
        )
        yield (
            time,
            '/dvl/twist',
            make(
                'geometry_msgs/TwistWithCovarianceStamped',
                header=header(time),
                twist=make('geometry_msgs/TwistWithCovariance', twist=twist),
            ),
        )
        yield time, '/depth', make('std_msgs/Float64', data=deep)
        above = 0.4 if drive.has('collision', time) else ground_at(time) - depth(time)
        yield (
            time,
            '/altimeter',
            make(
                'sensor_msgs/Range',
                header=header(time),
                field_of_view=0.1,
                min_range=0.1,
                max_range=50.0,
                range=above,
            ),
        )
        rpm = np.array([800 + 400 * math.sin(time / 2 + place) for place in range(4)], np.float32)
        load = np.array(2.0 + np.abs(rpm) / 400, np.float32)
        load[1] = 30.0 if drive.has('stall', time) else load[1]
        yield (
            time,
            '/thrusters/state',
            make(
                'demo_msgs/ThrusterState',
                header=header(time),
                uptime=int(1000 * drive.seed + time),
                sequence=int(drive.seed * 5000 + time * 20),
                rpm=rpm,
                current=load,
                setpoint=speed(time),
                mode=3,
            ),
        )
    yield from imus(drive, '/imu', sway=0.08)
    yield from batteries(drive, '/battery', 28.0)


def boat(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a boat."""
    speed, course = drive.goals('speed', 0.0, 3.0, 12.0), drive.goals('course', -3.0, 3.0, 30.0)
    drift = drive.between('drift', -3.0, 3.0)
    rudder, slack = drive.goals('rudder', -0.5, 0.5), drive.noise('slack', 0.01)
    for time in drive.ticks(10.0):
        ahead = speed(time) + (5.0 if drive.has('too fast', time) else 0.0)
        way = course(time)
        twist = make(
            'geometry_msgs/Twist', linear=vector(ahead * math.cos(way), ahead * math.sin(way), 0.0)
        )
        yield time, '/gps/vel', make('geometry_msgs/TwistStamped', header=header(time), twist=twist)
        yield (
            time,
            '/gps/fix',
            make(
                'sensor_msgs/NavSatFix',
                header=header(time),
                latitude=60.0 + 1e-5 * time,
                longitude=20.0 + 0.1 * drive.seed,
                altitude=drift + 0.05 * math.sin(time),
            ),
        )
        yield time, '/rudder/command', make('std_msgs/Float32', data=rudder(time))
        yield time, '/rudder/angle', make('std_msgs/Float32', data=rudder(time) + slack())
    yield from imus(drive, '/imu/data', sway=0.12)
    yield from batteries(drive, '/power/battery', 12.8)
