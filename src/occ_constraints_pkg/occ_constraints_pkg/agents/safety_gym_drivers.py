# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Scripted drivers for the Safety-Gym tasks; they use nothing but the observation.

A driver first chooses a direction in its body frame, as a complex number x + iy in m. Avoiders then
turn it away from hazards. Finally it is converted to the actions of the robot: a Point thrusts and
turns, a Car drives two wheels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError

_BINS = 16
_BIN = 2 * np.pi / _BINS
_CENTRES = np.exp(1j * _BIN * (np.arange(_BINS) + 0.5))
_LIDAR_REACH = 3.0
# Where the lidars begin, by robot, and their order by task.
_SENSORS = {'Point': 12, 'Car': 24}
_LIDARS = {
    'Goal1': ('goal', 'hazards', 'vases'),
    'Push1': ('goal', 'hazards', 'pillars', 'push_box'),
}
_HAZARD_RADIUS = {'Goal1': 0.2, 'Push1': 0.3}
_FORWARD = {'Point': 1.0, 'Car': -1j}


class Senses:
    """The parts of an observation (N, k) of one of the tasks, in the body frame."""

    def __init__(self, world: str, observation: np.ndarray) -> None:
        """Take the observation apart.

        Raises:
            ConfigurationError: it has the wrong number of columns.
        """
        robot, task = _split_name(world)
        width = _SENSORS[robot] + _BINS * len(_LIDARS[task])
        values = np.asarray(observation, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != width:
            raise ConfigurationError(
                f'a driver for {world} was given an observation of shape {values.shape}; '
                f'allowed is (N, {width})'
            )
        self.velocity = values[:, 3] + 1j * values[:, 4]
        lidars = values[:, _SENSORS[robot] :].reshape(len(values), -1, _BINS)
        self._lidars = dict(zip(_LIDARS[task], np.moveaxis(lidars, 1, 0), strict=True))

    def lidar(self, kind: str) -> np.ndarray:
        """Return the (N, 16) readings of one lidar; 0 where the task has none of this kind."""
        return self._lidars.get(kind, np.zeros((len(self.velocity), _BINS)))

    def only(self, kind: str) -> np.ndarray:
        """Return where the only object of a kind is, (N,) complex in m.

        The brightest bin gives its distance, and the ratio of the next bin its position within the
        brightest bin. Beyond 3 m it is not seen; it is then assumed 3 m away, in the mean direction
        of the hazards, which are spread all over the floor.
        """
        lidar = self.lidar(kind)
        rows = np.arange(len(lidar))
        brightest = lidar.argmax(axis=1)
        strength = lidar[rows, brightest]
        following = lidar[rows, (brightest + 1) % _BINS]
        share = np.divide(following, strength, out=np.zeros_like(strength), where=strength > 0)
        bearing = (brightest + share) * _BIN
        middle = np.angle(self.lidar('hazards') @ _CENTRES)
        bearing = np.where(strength > 0, bearing, middle)
        return _LIDAR_REACH * (1 - strength) * np.exp(1j * bearing)


def _split_name(world: str) -> tuple[str, str]:
    """Return the robot and the task of a world's name: ``CarGoal1`` is ``Car``, ``Goal1``."""
    robot = 'Car' if world.startswith('Car') else 'Point'
    return robot, world.removeprefix(robot)


def straight_point(world: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the driver ``straightv``: to the goal, through whatever lies between.

    It turns until its velocity will point at the goal, and thrusts while it nearly does.
    """

    def drive(observation: np.ndarray) -> np.ndarray:
        senses = Senses(world, observation)
        goal = senses.only('goal')
        wanted = np.exp(1j * np.angle(goal)) - senses.velocity
        turn = np.angle(wanted)
        forward = (np.abs(turn) < np.pi / 4).astype(np.float64)
        return np.column_stack([forward, np.clip(turn, -1.0, 1.0)])

    return drive


def straight_car(world: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the driver ``straight``: to the goal, through whatever lies between.

    It turns towards the goal and drives while it nearly faces it.
    """

    def drive(observation: np.ndarray) -> np.ndarray:
        turn = np.angle(Senses(world, observation).only('goal') / _FORWARD['Car'])
        forward = np.abs(turn) < np.pi / 4
        return np.clip(np.column_stack([forward + turn, forward - turn]), -1.0, 1.0)

    return drive


def avoider(world: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the driver that keeps out of hazards on its way.

    In Goal it goes to the goal; in Push it goes round the box to the side away from the goal, and
    pushes.
    """
    return _Avoider(world)


@dataclass(frozen=True)
class _Habits:
    """Driving parameters of a robot type.

    Attributes:
        speed: in m/s if nothing is near.
        foresight: time that its position is extrapolated by, in s.
        width: its half width, in m.
    """

    speed: float
    foresight: float
    width: float


_HABITS = {'Point': _Habits(0.8, 0.2, 0.17), 'Car': _Habits(0.7, 0.05, 0.22)}
_BOX_HALF_SIZE = {'Point': 0.2, 'Car': 0.125}
_PILLAR_RADIUS = 0.2
# Candidate directions, as rotations from the straight one to the target, and their length in m.
_FAN = np.exp(1j * np.linspace(-np.pi, np.pi, 48, endpoint=False))
_LOOK = 0.6
# Desired clearance beyond the radius of a hazard, in m, and the penalty for less, relative to a
# turn of 1 rad, along the way and at its end.
_MARGIN, _LACK = 0.12, 30.0
# It slows down below this clearance, in m, but not below this share of its speed.
_SLOW_ROOM, _SLOWEST = 0.25, 0.3
# Clearance when it goes round the box, in m.
_ROUND_BOX = 0.15
_FAR_AWAY = 1e3


class _Avoider:
    """Chooses the direction with the smallest turn and enough clearance."""

    def __init__(self, world: str) -> None:
        self._world = world
        self._robot, self._task = _split_name(world)
        self._habits = _HABITS[self._robot]
        self._steer = _steer_car if self._robot == 'Car' else _steer_point

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        senses = Senses(self._world, observation)
        hazards = _points(senses.lidar('hazards'))
        obstacles = [(hazards, np.full(hazards.shape, _HAZARD_RADIUS[self._task]))]
        target = senses.only('goal')
        if self._task == 'Push1':
            target, solid = self._behind_box(senses, target)
            obstacles += solid
        places, radii = (np.concatenate(parts, axis=1) for parts in zip(*obstacles, strict=True))
        return self._steer(self._way(senses.velocity, target, places, radii), senses.velocity)

    def _way(
        self, velocity: np.ndarray, target: np.ndarray, places: np.ndarray, radii: np.ndarray
    ) -> np.ndarray:
        """Return the desired velocity (N,), avoiding (N, P) ``places`` with (N, P) ``radii``."""
        ways = (target / np.maximum(np.abs(target), 1e-9))[:, None] * _FAN
        length = np.minimum(np.abs(target), _LOOK)[:, None, None]
        # Seen from where the robot will be, each way along the real axis.
        places = (places - self._habits.foresight * velocity[:, None])[:, None] / ways[:, :, None]
        along = np.clip(places.real, 0.0, length)
        room = (np.abs(places - along) - radii[:, None]).min(axis=2)
        end_room = (np.abs(places - length) - radii[:, None]).min(axis=2)
        lack = np.maximum(0.0, _MARGIN - room) + np.maximum(0.0, _MARGIN - end_room)
        rows = np.arange(len(ways))
        chosen = (np.abs(np.angle(_FAN)) + _LACK * lack).argmin(axis=1)
        share = np.clip(room[rows, chosen] / _SLOW_ROOM, _SLOWEST, 1.0)
        return self._habits.speed * share * ways[rows, chosen]

    def _behind_box(
        self, senses: Senses, goal: np.ndarray
    ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """Return the target for pushing the box to the goal, and the obstacles."""
        half = _BOX_HALF_SIZE[self._robot]
        # With the columns at its edges, the box is half as large again.
        reach = 1.5 * half
        box = senses.only('push_box')
        way = np.abs(goal - box)
        # Any direction if the box is on the goal.
        ahead = np.divide(goal - box, way, out=np.ones_like(box), where=way > 0)
        # The robot seen from the box, the goal along the real axis.
        robot = -box / ahead
        push = (robot.real < -half) & (np.abs(robot.imag) < -0.5 * robot.real)
        passing = ~push & (robot.real > -1.2 * half)
        side = np.where(robot.imag >= 0, 1j, -1j)
        target = np.where(
            passing,
            box + ahead * (side * (reach + _ROUND_BOX) - half),
            box - ahead * (reach + _ROUND_BOX),
        )
        # While pushing, it stays on the line through box and goal.
        target = np.where(push, ahead * (2 * half - 1.5j * robot.imag), target)
        pillars = _points(senses.lidar('pillars'))
        pillar_radius = _PILLAR_RADIUS + self._habits.width
        box_radius = np.where(push, -_FAR_AWAY, reach + 0.7 * self._habits.width)
        solid = [
            (pillars, np.full(pillars.shape, pillar_radius)),
            (box[:, None], box_radius[:, None]),
        ]
        return target, solid


def _points(lidar: np.ndarray) -> np.ndarray:
    """Return a point (N, 16) in m for each bin, far away if it sees nothing."""
    return np.where(lidar > 0, _LIDAR_REACH * (1 - lidar), _FAR_AWAY) * _CENTRES


def _steer_point(wanted: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return thrust and turn that bring the (N,) ``velocity`` to the ``wanted`` one."""
    missing = wanted - velocity
    turn = np.angle(missing + 0.5 * wanted)
    return np.clip(np.column_stack([8.0 * missing.real, turn]), -1.0, 1.0)


def _steer_car(wanted: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the wheel commands that bring the velocity to the ``wanted`` one."""
    wanted, velocity = wanted / _FORWARD['Car'], velocity / _FORWARD['Car']
    turn = np.angle(wanted)
    faster = np.clip(6.0 * (np.abs(wanted) - velocity.real), -1.0, 1.0)
    forward = np.where(np.abs(turn) < np.pi / 3, faster, 0.0)
    turn = np.clip(1.2 * turn, -1.0, 1.0)
    return np.clip(np.column_stack([forward + turn, forward - turn]), -1.0, 1.0)
