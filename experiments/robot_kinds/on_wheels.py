# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots on wheels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.messages import make
from experiments.robot_kinds.parts import (
    batteries,
    header,
    imus,
    odometry,
    pose,
    rolling,
    scans,
    stamp,
    vector,
)


def ground(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a robot on wheels with lidar, Imu and battery."""
    yield from rolling(drive)
    yield from scans(drive, '/scan')
    yield from imus(drive, '/imu/data', sway=0.03)
    yield from batteries(drive, '/battery_state', 25.0)


def car(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a car with Autoware."""
    speed, steer = drive.goals('speed', 0.0, 14.0, 20.0), drive.goals('steer', -0.2, 0.2, 9.0)
    loose = drive.noise('loose', 0.02)
    for time in drive.ticks(30.0):
        got, fast = speed(time) + loose(), drive.has('too fast', time)
        got = 25.0 if fast else got
        wheel = steer(time) + loose() / 10
        wheel += 0.15 if drive.has('tracking error', time) else 0.0
        yield (
            time,
            '/vehicle/status/velocity_status',
            make(
                'autoware_vehicle_msgs/VelocityReport',
                header=header(time),
                longitudinal_velocity=got,
                heading_rate=got * math.tan(steer(time)) / 2.8,
            ),
        )
        yield (
            time,
            '/vehicle/status/steering_status',
            make(
                'autoware_vehicle_msgs/SteeringReport',
                stamp=stamp(time),
                steering_tire_angle=wheel,
            ),
        )
        yield (
            time,
            '/control/command/control_cmd',
            make(
                'autoware_control_msgs/Control',
                stamp=stamp(time),
                lateral=make('autoware_control_msgs/Lateral', steering_tire_angle=steer(time)),
                longitudinal=make(
                    'autoware_control_msgs/Longitudinal', velocity=25.0 if fast else speed(time)
                ),
            ),
        )
    yield from imus(drive, '/sensing/imu/imu_data', sway=0.03)


def racecar(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a small racing car."""
    speed, steer = drive.goals('speed', 0.0, 4.0), drive.goals('steer', -0.35, 0.35, 5.0)
    slip, far = drive.noise('slip', 0.03), 1000.0 * drive.seed
    start = drive.between('volt', 15.0, 16.5)
    for time in drive.ticks(40.0):
        got = speed(time) + slip() + (4.0 if drive.has('too fast', time) else 0.0)
        stalled = drive.has('stall', time)
        got, far = 0.0 if stalled else got, far + got / 40
        yield (
            time,
            '/drive',
            make(
                'ackermann_msgs/AckermannDriveStamped',
                header=header(time),
                drive=make(
                    'ackermann_msgs/AckermannDrive', speed=speed(time), steering_angle=steer(time)
                ),
            ),
        )
        yield (
            time,
            '/odom',
            odometry(
                time,
                pose(time, 0.0, 0.0, (0.0, 0.0, steer(time))),
                vector(got, 0.0, 0.0),
                got * math.tan(steer(time)) / 0.33,
            ),
        )
        volt = 11.8 if drive.has('low battery', time) else start - 0.003 * time
        yield (
            time,
            '/sensors/core',
            make(
                'vesc_msgs/VescStateStamped',
                header=header(time),
                state=make(
                    'vesc_msgs/VescState',
                    temperature_fet=35.0 + 3 * math.sin(time / 10),
                    current_motor=60.0 if stalled else 2.0 + 3.0 * got + slip(),
                    current_input=1.0 + got,
                    duty_cycle=got / 20,
                    speed=4000.0 * got,
                    voltage_input=volt,
                    charge_drawn=0.01 * time,
                    energy_drawn=0.2 * time,
                    displacement=int(far * 100),
                    distance_traveled=int(far * 100),
                ),
            ),
        )
    yield from scans(drive, '/scan')


def vacuum(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a vacuum cleaner with bumper and cliff sensors."""
    yield from rolling(drive, top=0.3)
    left = drive.goals('left', 60.0, 150.0)
    for time in drive.ticks(25.0):
        kinds = [1] if drive.has('bump', time) else [2] if drive.has('cliff', time) else []
        yield (
            time,
            '/hazard_detection',
            make(
                'irobot_create_msgs/HazardDetectionVector',
                header=header(time),
                detections=[
                    make('irobot_create_msgs/HazardDetection', header=header(time), type=kind)
                    for kind in kinds
                ],
            ),
        )
        load = 900.0 if drive.has('stall', time) else left(time)
        yield (
            time,
            '/wheel_status',
            make(
                'irobot_create_msgs/WheelStatus',
                header=header(time),
                current_ma_left=int(load),
                current_ma_right=int(left(time + 1)),
                pwm_left=60,
                pwm_right=60,
                wheels_enabled=True,
            ),
        )
    yield from imus(drive, '/imu', sway=0.02)
    yield from batteries(drive, '/battery_state', 16.0)


def two_robots(drive: Drive) -> Iterator[Any]:
    """Yield the messages of two robots in one recording, the fault with the second."""
    for number in (1, 2):
        own = Drive(10 * drive.seed + number, drive.fault if number == 2 else '', drive.seconds)
        yield from rolling(own, f'/robot{number}')
        yield from scans(own, f'/robot{number}/scan')
