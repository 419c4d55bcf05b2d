# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots with many joints: arms, a humanoid, one on four legs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.messages import make
from experiments.robot_kinds.parts import (
    header,
    imus,
    joint_state,
    joints,
    quaternion,
    vector,
)

ARM = {
    'shoulder_pan_joint': (-1.5, 1.5, 40.0),
    'shoulder_lift_joint': (-2.0, -0.6, 60.0),
    'elbow_joint': (0.6, 2.0, 30.0),
    'wrist_1_joint': (-1.6, 0.2, 8.0),
    'wrist_2_joint': (-1.7, -1.2, 8.0),
    'wrist_3_joint': (-0.5, 0.5, 6.0),
}


def arm(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an arm with a force sensor and a trajectory controller."""
    values, force = joints(drive, ARM), drive.goals('force', 15.0, 30.0)
    lag = {name: drive.goals(f'{name} lag', -0.01, 0.01, 3.0) for name in ARM}
    for time in drive.ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        hit = 80.0 if drive.has('collision', time) else 0.0
        wrench = make(
            'geometry_msgs/Wrench',
            force=vector(hit, 1.0, -force(time)),
            torque=vector(0.1, 0.2, force(time) / 30),
        )
        yield (
            time,
            '/ft_sensor/wrench',
            make('geometry_msgs/WrenchStamped', header=header(time), wrench=wrench),
        )
        errors = np.array([part(time) for part in lag.values()])
        errors[2] += 0.3 if drive.has('tracking error', time) else 0.0
        point = make('trajectory_msgs/JointTrajectoryPoint', positions=errors)
        yield (
            time,
            '/arm_controller/state',
            make(
                'control_msgs/JointTrajectoryControllerState',
                header=header(time),
                joint_names=list(ARM),
                error=point,
            ),
        )


def arm_with_gripper(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an arm and a gripper, each with a publisher of its own on one topic."""
    values = joints(drive, ARM)
    grip = joints(Drive(drive.seed, '', drive.seconds), {'finger_joint': (0.0, 0.8, 5.0)})
    for time in drive.ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        position, speed, load = grip(time)['finger_joint']
        load = 20.0 if drive.has('gripper stall', time) else load
        yield (
            time + 0.004,
            '/joint_states',
            joint_state(time + 0.004, {'finger_joint': (position, speed, load)}),
        )


def humanoid(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a humanoid: many joints, two feet with force sensors."""
    limits = {
        f'{side}_{name}': item
        for side in ('left', 'right')
        for name, item in {
            'hip_pitch': (-0.8, 0.4, 60.0),
            'hip_roll': (-0.2, 0.2, 50.0),
            'knee': (0.1, 1.4, 90.0),
            'ankle_pitch': (-0.6, 0.3, 40.0),
            'shoulder_pitch': (-0.5, 0.5, 10.0),
            'elbow': (0.2, 1.0, 8.0),
        }.items()
    } | {'waist_yaw': (-0.3, 0.3, 20.0)}
    values = joints(drive, limits)
    feet = [drive.gait(f'foot{place}', 0.0, 600.0) for place in range(2)]
    for time in drive.ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        for side, load in zip(('left', 'right'), feet, strict=True):
            wrench = make('geometry_msgs/Wrench', force=vector(5.0, 3.0, load(time)))
            yield (
                time,
                f'/{side}_foot/wrench',
                make('geometry_msgs/WrenchStamped', header=header(time), wrench=wrench),
            )
    yield from imus(drive, '/imu', sway=0.06)


def legged(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a robot on four legs, in one message of its own type."""
    legs = {
        f'{leg}_{joint}': limits
        for leg in ('FR', 'FL', 'RR', 'RL')
        for joint, limits in (
            ('hip', (-0.3, 0.3, 8.0)),
            ('thigh', (0.4, 1.3, 15.0)),
            ('calf', (-2.2, -1.2, 22.0)),
        )
    }
    values = joints(drive, legs)
    roll, pitch = drive.gait('roll', -0.06, 0.06), drive.gait('pitch', -0.05, 0.05)
    feet = [drive.gait(f'foot{place}', 0.0, 90.0) for place in range(4)]
    shake, start = drive.noise('shake', 0.3), drive.between('volt', 26.5, 29.0)
    for time in drive.ticks(50.0):
        lean = 0.7 if drive.has('tilt', time) else 0.0
        angles = roll(time) + lean, pitch(time), 0.3 * math.sin(time / 9)
        imu = make(
            'unitree_go/IMUState',
            quaternion=np.array(quaternion(*angles), dtype=np.float32),
            gyroscope=np.array([roll(time), pitch(time), 0.03 * math.cos(time / 9)], np.float32),
            accelerometer=np.array([shake(), shake(), 9.81 + shake()], np.float32),
            rpy=np.array(angles, np.float32),
            temperature=60,
        )
        motors = [
            make('unitree_go/MotorState', mode=1, q=q, dq=dq, tau_est=load, temperature=40)
            for q, dq, load in values(time).values()
        ]
        volt = 22.0 if drive.has('low battery', time) else start - 0.002 * time
        yield (
            time,
            '/lowstate',
            make(
                'unitree_go/LowState',
                head=np.array([254, 239], np.uint8),
                sn=np.array([1, 2], np.uint32),
                imu_state=imu,
                motor_state=motors,
                foot_force=np.array([foot(time) for foot in feet], np.int16),
                tick=int(time * 1000) + 1000 * drive.seed,
                power_v=volt,
                power_a=2.0 + abs(roll(time)) * 20,
                crc=int(drive.seed * 1_000_003 + time * 7_919_317) % 2**32,
            ),
        )
