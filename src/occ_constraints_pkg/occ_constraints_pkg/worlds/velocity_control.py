# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Velocity commands, as mobile robots in ROS take them, turned into actions of Point and Car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.worlds.bodies import Robot


@dataclass(frozen=True)
class _Gains:
    """What keeps a velocity up, and what corrects it.

    Attributes:
        hold_speed: action per m/s that drag needs at a steady speed.
        mend_speed: action per m/s of missing speed.
        hold_turning: action per rad/s that a steady turn needs.
        mend_turning: action per rad/s of missing turning rate.
    """

    hold_speed: float
    mend_speed: float
    hold_turning: float
    mend_turning: float


_GAINS = {
    # Drag is 0.01 N s/m against 0.3 N per unit of thrust. The servo mends the yaw rate itself, and
    # chatters about it: measured 0.65, 1.35 and 3.0 rad/s on average at 0.25, 0.5 and 1.
    'Point': _Gains(0.01 / 0.3, 0.5, 1 / 2.65, 0.0),
    # Wheels of 0.05 m radius with a drag of 0.001 N m s each; turning on the spot at 1.2 rad/s
    # takes the full 0.02 N m of both.
    'Car': _Gains(0.001 / 0.05, 0.1, 0.02 / 1.2, 0.02),
}


def velocity_action(robot: Robot, command: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the action that brings a robot to the velocity asked for.

    Args:
        robot: what drives.
        command: (2,) speed ahead in m/s and turning rate in rad/s, counter-clockwise.
        now: (2,) the same as they are.

    Returns:
        (2,) within [-1, 1].
    """
    gains = _GAINS[robot.name]
    speed, turning = command
    missing = command - now
    drive = gains.hold_speed * speed + gains.mend_speed * missing[0]
    turn = gains.hold_turning * turning + gains.mend_turning * missing[1]
    wheels = robot.name == 'Car'
    return np.clip([drive + turn, drive - turn] if wheels else [drive, turn], -1.0, 1.0)
