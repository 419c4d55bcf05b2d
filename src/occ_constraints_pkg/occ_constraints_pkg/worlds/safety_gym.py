# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The Safety-Gym tasks Goal and Push, level 1, for the robots Point and Car."""

from __future__ import annotations

import os
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from occ_constraints_pkg.worlds.base import Column, World
from occ_constraints_pkg.worlds.bodies import (
    CAR,
    CAR_BOX,
    PILLAR_HEIGHT,
    PILLAR_RADIUS,
    POINT,
    POINT_BOX,
    VASE,
    Movable,
    Robot,
)
from occ_constraints_pkg.worlds.geometry import lengths, matrix_of_yaw, product, quaternion_of_yaw
from occ_constraints_pkg.worlds.layout import Layout, PlacementRules
from occ_constraints_pkg.worlds.lidar import BINS, MAX_DISTANCE, beams, lidar_readings
from occ_constraints_pkg.worlds.physics import SUBSTEPS, Physics
from occ_constraints_pkg.worlds.robots import checked_action, robot_generators, selected_rows
from occ_constraints_pkg.worlds.velocity_control import velocity_action
from occ_constraints_pkg.worlds.view import RobotView, Thing, standing_cylinder
from occ_constraints_pkg.worlds.worker_pool import SharedArrays, WorkerPool, is_importable

GOAL_RADIUS = 0.3
_GOAL_HEIGHT = 0.16
# How high goal and hazards are drawn, in m.
_GOAL_SIZE, _HAZARD_SIZE = 0.3, 0.02
_ROBOT_KEEPOUT = 0.4
_FAILURE_REWARD = -10.0
_REWARD_CLIP = 10.0
# With fewer robots, a process costs more than it gains.
_ROBOTS_PER_PROCESS = 16
_Rows = np.ndarray | slice


class SafetyGymWorld(World):
    """What these tasks have in common; each robot has its own floor.

    The true cost is 1 while the robot is within the radius of a hazard. Goal and hazards are only
    seen by lidars, so they are plain arrays; whatever can be touched is part of the physics.

    Episodes are truncated after 1000 steps. They terminate only if there is no room for a new goal,
    as in Safety-Gym, or if the physics of a robot diverges: that robot gets reward -10 and keeps
    its last observation, and ``info['failed']`` (N,) bool is set.

    Worker processes import the class from its module: they do not see what a program changes in it
    later.

    Attributes:
        robot: what drives.
        movable: what can be pushed.
        rules: the keepouts of objects when they are placed.
        lidars: type of the objects that each lidar sees, and how many there are.
        hazard_radius: in m.
        generators: one per robot; draws its layouts and new goals.
        physics: where robots, vases, boxes and pillars are and how they move.
    """

    robot: ClassVar[Robot]
    movable: ClassVar[Movable]
    rules: ClassVar[PlacementRules]
    lidars: ClassVar[dict[str, int]]
    hazard_radius: ClassVar[float]
    max_episode_steps = 1000
    state_names = (
        'generators',
        '_objects',
        '_to_go',
        '_steps',
        '_observation',
        'physics.qpos',
        'physics.qvel',
        'physics.movable',
        'physics.movable_velocity',
        'physics.pillars',
        'physics._moves',
    )

    def __init_subclass__(cls) -> None:
        """Derive the names of columns and the length of a step from robot and lidars."""
        super().__init_subclass__()
        if hasattr(cls, 'robot'):
            cls.name = cls.__name__
            cls.columns = tuple(
                Column(name, unit, -bound, bound) for name, unit, bound in cls.robot.sensors
            ) + tuple(
                Column(f'{kind}_lidar_{index}', '1', 0.0, 1.0)
                for kind in cls.lidars
                for index in range(BINS)
            )
            cls.action_columns = tuple(
                Column(name, low=-1.0, high=1.0) for name in cls.robot.actions
            )
            cls.step_seconds = SUBSTEPS * cls.robot.timestep
            cls.view_kinds = tuple(cls.lidars)

    def __init__(
        self, num_envs: int, *, processes: int = 0, arrays: SharedArrays | None = None
    ) -> None:
        """Build the world; :meth:`reset` it before the first step.

        Args:
            num_envs: number of robots N.
            processes: processes that step the robots, this one included; 0 means one per core,
                fewer for small N, and one for a class that others cannot import.
            arrays: where its state lies, in a worker process.

        Raises:
            WorkerError: worker processes cannot be started.
        """
        if processes == 0 and is_importable(type(self)):
            processes = min(len(os.sched_getaffinity(0)), num_envs // _ROBOTS_PER_PROCESS)
        self._pool = WorkerPool(type(self), num_envs, min(max(processes, 1), num_envs))
        arrays = self._pool.arrays if arrays is None else arrays
        zeros = np.zeros if arrays is None else arrays.zeros
        self.num_envs = num_envs
        self.generators = robot_generators(None, num_envs)
        pillars = self.lidars.get('pillars', 0)
        self.physics = Physics(
            self.robot, self.movable, pillars=pillars, num_envs=num_envs, zeros=zeros
        )
        # What each robot's lidars see, in their order: the goal first, the vase or box last.
        self._seen_by = tuple(
            lidar for lidar, count in enumerate(self.lidars.values()) for _ in range(count)
        )
        self._objects = zeros((num_envs, sum(self.lidars.values()), 2))
        self._goal = self._objects[:, 0]
        self._hazards = self._objects[:, 1 : 1 + self.lidars['hazards']]
        self._pillars = self._objects[:, 1 + self.lidars['hazards'] : -1]
        self._movable = self._objects[:, -1]
        self._to_go = zeros(num_envs)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._observation = zeros((num_envs, len(self.columns)), np.float32)
        # Input and output of a step.
        self._action = zeros((num_envs, len(self.action_columns)))
        self._reward, self._true_cost = zeros(num_envs), zeros(num_envs)
        self._failed, self._reached = zeros(num_envs, bool), zeros(num_envs, bool)

    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes; see :meth:`World.reset`."""
        self._pool.check()
        rows = selected_rows(mask, self.num_envs)
        if seed is not None:
            self.generators = robot_generators(seed, self.num_envs)
        if len(rows):
            self.start(rows, self.rules.sample_layout([self.generators[row] for row in rows]))
        return self._observation.copy(), {'true_cost': self._cost(self._offsets(slice(None)))}

    def start(
        self, rows: np.ndarray, layout: Layout, velocity: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Start an episode of some robots from a given layout, for example a recorded one.

        Args:
            rows: (M,) indices of the robots.
            layout: the M places.
            velocity: (M, nv) of the robots as MuJoCo has them; for Point x, y in m/s, world frame,
                and yaw in rad/s.

        Returns:
            (M, k) float32, their observations.
        """
        self._pool.check()
        sensors = self.physics.place(rows, layout.robot, layout.movable, layout.pillars, velocity)
        self._goal[rows] = layout.goal
        self._hazards[rows] = layout.hazards
        self._pillars[rows] = layout.pillars
        self._movable[rows] = layout.movable[:, :2]
        self._steps[rows] = 0
        offsets = self._offsets(rows)
        self._to_go[rows] = self._distances(rows, offsets)[0]
        self._observe(rows, sensors, offsets)
        return self._observation[rows]

    def move_goals(self, rows: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Move the goals of some robots, for example to recorded places.

        Args:
            rows: (M,) indices of the robots.
            places: (M, 2) x, y in m.

        Returns:
            (M, k) float32, the observations of these robots.
        """
        self._pool.check()
        self._goal[rows] = places
        offsets = self._offsets(rows)
        self._to_go[rows] = self._distances(rows, offsets)[0]
        self._observe(rows, self._observation[rows, : len(self.robot.sensors)], offsets)
        return self._observation[rows]

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step; see :meth:`World.step`."""
        self._action[:] = checked_action(action, self.num_envs, self.robot.actions)
        self._pool.share(self.physics.costs, self.advance)
        self._steps += 1
        failed, terminated = self._failed.copy(), self._failed.copy()
        for row in self._reached.nonzero()[0]:
            place = self._next_goal(int(row))
            if place is None:
                terminated[row] = True
            else:
                self.move_goals(np.array([row]), place)
        truncated = ~terminated & (self._steps >= self.max_episode_steps)
        info = {'true_cost': self._true_cost.copy(), 'failed': failed}
        return self._observation.copy(), self._reward.copy(), terminated, truncated, info

    def advance(self, rows: slice) -> None:
        """Do the part of a step that runs in parallel, for some robots.

        Args:
            rows: the robots.
        """
        sensors, failed = self.physics.step(self._action[rows], rows)
        self._movable[rows] = self.physics.movable[rows, :2]
        offsets = self._offsets(rows)
        to_go, to_goal = self._distances(rows, offsets)
        reached = (to_goal <= GOAL_RADIUS) & ~failed
        reward = (self._to_go[rows] - to_go + reached).clip(-_REWARD_CLIP, _REWARD_CLIP)
        reward[failed] = _FAILURE_REWARD
        self._reward[rows], self._failed[rows], self._reached[rows] = reward, failed, reached
        self._to_go[rows], self._true_cost[rows] = to_go, self._cost(offsets)
        if failed.any():
            sound = np.arange(self.num_envs)[rows][~failed]
            self._observe(sound, sensors[~failed], offsets[..., ~failed])
        else:
            self._observe(rows, sensors, offsets)

    def restore(self, state: dict[str, np.ndarray | list[str]]) -> None:
        """Go on where a world was when it returned ``state``; see :meth:`World.restore`."""
        self._pool.check()
        super().restore(state)

    def close(self) -> None:
        """End the worker processes."""
        self._pool.close()

    def view(self, row: int) -> RobotView:
        """Return one robot as ROS and pictures see it; see :meth:`World.view`."""
        physics, forward = self.physics, self.robot.forward
        # The base frame looks the way the robot drives.
        base = matrix_of_yaw(np.array([forward]))[0]
        sensors = self._observation[row, :9].astype(np.float64).reshape(3, 3)
        acceleration, linear, angular = sensors @ base
        width = len(self.robot.sensors)
        lidars = self._observation[row, width:].astype(np.float64).reshape(-1, BINS)
        first_beam, ranges = beams(lidars, forward)
        quaternion = product(physics.quaternion(row), quaternion_of_yaw(np.array([forward]))[0])
        return RobotView(
            position=physics.position(np.array([row]))[0],
            quaternion=quaternion,
            linear_velocity=linear,
            angular_velocity=angular,
            acceleration=acceleration,
            ranges=dict(zip(self.lidars, ranges, strict=True)),
            first_beam=first_beam,
            beam_step=2 * np.pi / BINS,
            range_max=MAX_DISTANCE,
            things=self._things(row, quaternion),
        )

    def _things(self, row: int, heading: np.ndarray) -> tuple[Thing, ...]:
        """Return everything around a robot, and the robot as its bounding box."""
        position = self.physics.position(np.array([row]))[0]
        movable, half = self.physics.movable[row], 2 * self.movable.half_extents
        goal = standing_cylinder('goal', self._goal[row], GOAL_RADIUS, _GOAL_SIZE)
        return (
            goal,
            *(
                standing_cylinder('hazard', place, self.hazard_radius, _HAZARD_SIZE)
                for place in self._hazards[row]
            ),
            *(
                standing_cylinder('pillar', place, PILLAR_RADIUS, PILLAR_HEIGHT)
                for place in self._pillars[row]
            ),
            Thing(self.movable.name, 'box', movable[:3].copy(), movable[3:].copy(), half),
            Thing('robot', 'box', position, heading, np.array(self.robot.size)),
        )

    def action_for(self, row: int, speed: float, turning: float) -> np.ndarray:
        """Return the action that a velocity command asks for; see :meth:`World.action_for`."""
        view = self.view(row)
        now = np.array([view.linear_velocity[0], view.angular_velocity[2]])
        return velocity_action(self.robot, np.array([speed, turning]), now)

    @abstractmethod
    def _distances(self, rows: _Rows, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance left to go, and the distance of the robot or box from the goal.

        The reward is the decrease of the first, plus 1 where the second is at most the radius of
        the goal; both are (M,) in m.
        """

    @property
    def _position(self) -> np.ndarray:
        return self.physics.qpos[:, :2]

    def _next_goal(self, row: int) -> np.ndarray | None:
        """Return the place of a robot's next goal, or ``None`` where there is no room for it."""
        obstacles = np.concatenate([self._position[row : row + 1], self._objects[row, 1:]])
        return self.rules.sample_goal(self.generators[row], obstacles)

    def _offsets(self, rows: _Rows) -> np.ndarray:
        """(2, K, M) x, y of the K objects around each of M robots, from its centre, in m."""
        # Robots last: NumPy is fastest along long rows.
        return np.subtract(self._objects[rows].T, self._position[rows].T[:, None], order='C')

    def _observe(self, rows: _Rows, sensors: np.ndarray, offsets: np.ndarray) -> None:
        """Write the observation of some robots from their (M, s) sensors and their offsets."""
        heights, axes = self.physics.heights(rows), self.physics.axes(rows)
        lidars = lidar_readings(offsets, heights, axes, self._seen_by)
        width = sensors.shape[1]
        self._observation[rows, :width] = sensors
        self._observation[rows, width:] = lidars.reshape(len(sensors), len(self.lidars) * BINS)

    def _cost(self, offsets: np.ndarray) -> np.ndarray:
        x, y = offsets[:, 1 : 1 + self.lidars['hazards']]
        return ((x * x + y * y).min(axis=0) <= self.hazard_radius**2).astype(np.float64)


class _Goal(SafetyGymWorld):
    """Drive to goal after goal on a floor with eight hazards and a vase.

    The reward is the decrease of the distance to the goal, in m, plus 1 in every step that ends
    within 0.3 m of it; the goal then moves elsewhere. The vase may be pushed about, at no cost.
    """

    movable = VASE
    rules = PlacementRules(
        robot=_ROBOT_KEEPOUT, goal=0.305, hazards=(0.18,) * 8, pillars=(), movable=0.15
    )
    lidars: ClassVar = {'goal': 1, 'hazards': 8, 'vases': 1}
    hazard_radius = 0.2

    def _distances(self, rows: _Rows, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        distance = lengths(*offsets[:, 0])
        return distance, distance


class _Push(SafetyGymWorld):
    """Push a box to goal after goal on a floor with two hazards and a pillar.

    The reward is the decrease of the distance to the box, plus that of the box to the goal, in m,
    plus 1 in every step that ends with the box within 0.3 m of the goal; the goal then moves
    elsewhere. As in Safety-Gym these distances are three-dimensional, though robot, box and goal
    differ in height. The pillar stands firm and costs nothing.
    """

    lidars: ClassVar = {'goal': 1, 'hazards': 2, 'pillars': 1, 'push_box': 1}
    hazard_radius = 0.3

    def _distances(self, rows: _Rows, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        height = self.physics.movable[rows, 2]
        x, y = offsets[:, -1]
        to_box = lengths(x, y, height - self.physics.heights(rows))
        x, y = (self._goal[rows] - self._movable[rows]).T
        to_goal = lengths(x, y, _GOAL_HEIGHT - height)
        return to_box + to_goal, to_goal


def _push_rules(box: float) -> PlacementRules:
    return PlacementRules(
        robot=_ROBOT_KEEPOUT, goal=0.4, hazards=(0.4,) * 2, pillars=(0.3,), movable=box
    )


class PointGoal1(_Goal):
    """Goal with the robot Point."""

    robot = POINT


class CarGoal1(_Goal):
    """Goal with the robot Car."""

    robot = CAR


class PointPush1(_Push):
    """Push with the robot Point."""

    robot, movable, rules = POINT, POINT_BOX, _push_rules(0.2)


class CarPush1(_Push):
    """Push with the robot Car, whose box is smaller."""

    robot, movable, rules = CAR, CAR_BOX, _push_rules(0.125)
