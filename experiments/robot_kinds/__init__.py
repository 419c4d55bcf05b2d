# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Synthetic drives of many kinds of robots, with planted faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.robot_kinds.arms import arm, arm_with_gripper, humanoid, legged
from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.in_air_and_water import auv, boat, mavros, px4
from experiments.robot_kinds.messages import write_messages
from experiments.robot_kinds.on_wheels import car, ground, racecar, two_robots, vacuum


@dataclass(frozen=True)
class Robot:
    """A kind of robot.

    Attributes:
        messages: of a drive.
        faults: fault to a word that is in the name of a feature that must tell it.
    """

    messages: Callable[[Drive], Iterator[Any]]
    faults: dict[str, str]


ROBOTS = {
    'ground': Robot(
        ground,
        {
            'collision': 'clearance|acceleration',
            'too fast': 'speed',
            'stall': 'speed_error',
            'tilt': 'tilt',
            'low battery': 'battery',
        },
    ),
    'legged': Robot(
        legged, {'tilt': 'tilt', 'stall': 'tau_est', 'low battery': 'power_v', 'too fast': '_dq'}
    ),
    'arm': Robot(
        arm,
        {
            'stall': 'effort',
            'too fast': 'velocity',
            'collision': 'force',
            'tracking error': 'error',
        },
    ),
    'arm_with_gripper': Robot(
        arm_with_gripper, {'stall': 'effort', 'too fast': 'velocity', 'gripper stall': 'finger'}
    ),
    'px4': Robot(px4, {'tilt': 'tilt', 'low battery': 'battery', 'too fast': 'speed'}),
    'mavros': Robot(mavros, {'tilt': 'tilt|roll', 'low battery': 'battery', 'too fast': 'speed'}),
    'auv': Robot(
        auv,
        {
            'collision': 'range',
            'too deep': 'depth',
            'tilt': 'tilt',
            'low battery': 'battery',
            'stall': 'current',
        },
    ),
    'boat': Robot(boat, {'tilt': 'tilt', 'too fast': 'speed', 'low battery': 'battery'}),
    'car': Robot(car, {'too fast': 'velocity', 'tracking error': 'error', 'tilt': 'tilt'}),
    'racecar': Robot(
        racecar,
        {
            'collision': 'clearance',
            'too fast': 'speed',
            'stall': 'current',
            'low battery': 'voltage',
        },
    ),
    'vacuum': Robot(
        vacuum,
        {
            'bump': 'bump',
            'cliff': 'cliff',
            'stall': 'current|error',
            'low battery': 'battery',
            'tilt': 'tilt',
        },
    ),
    'two_robots': Robot(two_robots, {'collision': 'clearance', 'too fast': 'speed'}),
    'humanoid': Robot(humanoid, {'tilt': 'tilt', 'stall': 'effort', 'too fast': 'velocity'}),
}


def write_robot(
    folder: Path, kind: str, seed: int, fault: str = '', seconds: float = 120.0
) -> Path:
    """Write a drive of a kind of robot; return its file."""
    name = f'{kind}_{seed}{"_" + fault.replace(" ", "_") if fault else ""}.mcap'
    return write_messages(folder / name, ROBOTS[kind].messages(Drive(seed, fault, seconds)))
