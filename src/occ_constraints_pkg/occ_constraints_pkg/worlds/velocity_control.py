# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of ROS velocity commands into actions of Point and Car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.worlds.bodies import Robot


@dataclass(frozen=True)
class _Gains:
    """Feed-forward and feedback gains of the velocity control.

    Attributes:
        speed: feed-forward, action per m/s at constant speed.
        speed_error: feedback, action per m/s of error.
        turning: feed-forward, action per rad/s at constant turning rate.
        turning_error: feedback, action per rad/s of error.
    """

    speed: float
    speed_error: float
    turning: float
    turning_error: float


_GAINS = {
    # Drag is 0.01 N s/m against 0.3 N per unit of thrust. The servo controls the yaw rate itself,
    # with chatter: measured 0.65, 1.35 and 3.0 rad/s on average at 0.25, 0.5 and 1.
    'Point': _Gains(0.01 / 0.3, 0.5, 1 / 2.65, 0.0),
    # Wheels of 0.05 m radius with a drag of 0.001 N m s each; turning on the spot at 1.2 rad/s
    # takes the full 0.02 N m of both.
    'Car': _Gains(0.001 / 0.05, 0.1, 0.02 / 1.2, 0.02),
}


def velocity_action(robot: Robot, command: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the action that brings a robot to the commanded velocity.

    Args:
        robot: the robot.
        command: (2,) forward speed in m/s and turning rate in rad/s, counter-clockwise.
        now: (2,) the present ones.

    Returns:
        (2,) within [-1, 1].
    """
    gains = _GAINS[robot.name]
    speed, turning = command
    error = command - now
    drive = gains.speed * speed + gains.speed_error * error[0]
    turn = gains.turning * turning + gains.turning_error * error[1]
    wheels = robot.name == 'Car'
    return np.clip([drive + turn, drive - turn] if wheels else [drive, turn], -1.0, 1.0)
