# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which topics are of which robot, by their namespaces."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping

from occ_constraints_pkg.suggestion.inspection import TopicInspection
from occ_constraints_pkg.suggestion.meanings import words_of

# Parts of one robot, not robots.
_PARTS = {
    *('left', 'right', 'front', 'rear', 'back', 'top', 'bottom', 'upper', 'lower', 'arm', 'leg'),
    *('camera', 'cam', 'lidar', 'laser', 'imu', 'gripper', 'hand', 'wheel', 'motor', 'joint'),
    *('sensor', 'controller', 'base', 'head', 'torso', 'foot', 'wrist', 'finger', 'thruster'),
    *('gps', 'sonar', 'radar', 'battery', 'scan', 'filtered', 'raw', 'cmd', 'esc', 'rotor'),
}
# Of these each robot has one of its own.
_OF_ONE_ROBOT = re.compile(
    r'(Odometry|JointState|BatteryState|BatteryStatus|NavSatFix|Imu|PoseStamped|Twist\w*|LaserScan)$'
)
_NUMBERED = re.compile(r'(.*?)_?\d+')


def robots_of(topics: Mapping[str, TopicInspection]) -> dict[str, list[str]]:
    """Return the namespace of each robot with the names of its topics; empty for one robot.

    Several robots have the same topics of the same types below namespaces side by side, of which
    none is named after a part of a robot.

    Args:
        topics: by name.
    """
    # Per place in the tree of names: what is below each name there.
    below: dict[str, dict[str, set[tuple[str, str]]]] = defaultdict(lambda: defaultdict(set))
    for name, topic in topics.items():
        parts = name.strip('/').split('/')
        for depth in range(len(parts) - 1):
            rest = '/'.join(parts[depth + 1 :])
            below['/'.join(parts[:depth])][parts[depth]].add((rest, topic.msgtype))
    for place in sorted(below, key=lambda place: (place.count('/') + bool(place), place)):
        robots = _alike(below[place])
        if robots:
            spaces = [f'/{place}/{robot}/'.replace('//', '/') for robot in robots]
            return {
                space.strip('/'): [name for name in topics if name.startswith(space)]
                for space in spaces
            }
    return {}


def _alike(spaces: Mapping[str, set[tuple[str, str]]]) -> list[str]:
    """Return those of the namespaces side by side that are robots, if there are several."""
    found = []
    for name, own in spaces.items():
        if _PARTS.intersection(words_of(name)):
            continue
        shared = [own & other for others, other in spaces.items() if others != name]
        kinds = [{kind for _, kind in both if _OF_ONE_ROBOT.search(kind)} for both in shared]
        if any(
            _is_like(name, other) and kind or len(kind) > 1
            for other, kind in zip((n for n in spaces if n != name), kinds, strict=True)
        ):
            found.append(name)
    return sorted(found) if len(found) > 1 else []


def _is_like(name: str, other: str) -> bool:
    """Tell whether two names differ only in a number, as ``robot1`` and ``robot2``."""
    first, second = _NUMBERED.fullmatch(name), _NUMBERED.fullmatch(other)
    return bool(first and second and first[1] == second[1])
