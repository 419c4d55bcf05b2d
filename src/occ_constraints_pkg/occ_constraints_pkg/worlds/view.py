# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The view of one robot for ROS and pictures: metres; x forward, y left, z up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Thing:
    """An object on the floor.

    Attributes:
        kind: ``goal``, ``hazard``, ``pillar``, ``vase``, ``box`` or ``robot``.
        shape: ``cylinder`` or ``box``.
        position: (3,) of its centre, in m.
        quaternion: (4,) w, x, y, z.
        size: (3,) its extent along its own axes, in m.
    """

    kind: str
    shape: str
    position: np.ndarray
    quaternion: np.ndarray
    size: np.ndarray


def standing_cylinder(kind: str, place: np.ndarray, radius: float, height: float) -> Thing:
    """Return a cylinder that stands on the floor at (2,) ``place``; all in m."""
    return Thing(
        kind,
        'cylinder',
        np.array([*place, height / 2]),
        np.array([1.0, 0.0, 0.0, 0.0]),
        np.array([2 * radius, 2 * radius, height]),
    )


@dataclass(frozen=True, eq=False)
class RobotView:
    """The readings of a robot's own sensors, in its base frame, and where everything is.

    Attributes:
        position: (3,) of the robot in the world, in m.
        quaternion: (4,) w, x, y, z, of its base frame in the world.
        linear_velocity: (3,) in m/s, base frame.
        angular_velocity: (3,) in rad/s, base frame.
        acceleration: (3,) in m/s^2, base frame, as measured by an accelerometer: up at rest.
        ranges: by type of things, (16,) distances in m by direction, infinite where there is
            nothing. Beam i looks in direction :attr:`first_beam` + i * :attr:`beam_step`.
        first_beam: in rad, counter-clockwise from straight ahead.
        beam_step: in rad.
        range_max: in m.
        things: everything there is, the robot included.
    """

    position: np.ndarray
    quaternion: np.ndarray
    linear_velocity: np.ndarray
    angular_velocity: np.ndarray
    acceleration: np.ndarray
    ranges: Mapping[str, np.ndarray]
    first_beam: float
    beam_step: float
    range_max: float
    things: tuple[Thing, ...]
