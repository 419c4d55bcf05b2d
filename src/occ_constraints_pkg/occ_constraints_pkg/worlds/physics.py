# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The physics of N robots, each on a floor of its own, stepped by MuJoCo."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import accumulate

import mujoco
import numpy as np
from mujoco import rollout

from occ_constraints_pkg.worlds.bodies import (
    PILLAR_HEIGHT,
    PILLAR_RADIUS,
    POINT_HEIGHT,
    Movable,
    Robot,
    scene_mjcf,
)
from occ_constraints_pkg.worlds.geometry import (
    lengths,
    matrix_of,
    matrix_of_yaw,
    quaternion_of_yaw,
)

SUBSTEPS = 10
# MuJoCo computes sensors before it integrates, so the readings that belong to the state after ten
# substeps, under the same control, are those of an eleventh.
_STEPS = SUBSTEPS + 1
# Safety distance, in m, for contacts within the coming step, besides the distance at the present
# speed: robots may accelerate, and geometries have a margin.
_RESERVE = 0.02
# A vase or box slower than this, in m/s and rad/s, is at rest.
_REST_SPEED = 1e-6
# Weight of the latest step in the mean time per robot.
_LATEST = 0.05
_ALL = slice(None)
_MOVABLE_Q, _MOVABLE_V = 7, 6


class Physics:
    """Positions and velocities of N robots and their vases or boxes, and their simulation.

    Resting objects are not simulated: a robot that cannot touch anything within a step, while its
    vase or box is at rest, is stepped with a model of the robot alone, which is several times
    faster. The choice depends on the state of each robot only, not on the batch. One compiled model
    serves all robots: pillars are placed by ``mocap_pos``, which is part of the state in MuJoCo.

    Attributes:
        robot: type of the robots.
        qpos: (N, nq) the robots' positions as MuJoCo has them.
        qvel: (N, nv) the robots' velocities.
        movable: (N, 7) position in m and orientation quaternion of the vase or box.
        movable_velocity: (N, 6) as MuJoCo's free joint has it.
        pillars: (N, P, 2) x, y in m; P is 0 or 1.
        costs: (N,) approximate time of the last step of each robot, in s: the mean of its model.
    """

    def __init__(
        self,
        robot: Robot,
        movable: Movable,
        *,
        pillars: int,
        num_envs: int,
        zeros: Callable[..., np.ndarray] = np.zeros,
    ) -> None:
        """Start with everything at the origin; :meth:`place` it before use.

        Args:
            robot: type of the robots.
            movable: the object that each of them can push.
            pillars: number of pillars of each, 0 or 1.
            num_envs: number of robots N.
            zeros: makes the arrays of the state, as ``numpy.zeros`` does.
        """
        self.robot = robot
        self._kind = movable
        self._extents = movable.half_extents
        self._around = float(np.sqrt((self._extents**2).sum()))
        self._alone = _Model(scene_mjcf(robot), num_envs)
        self._together = _Model(scene_mjcf(robot, movable, pillar=pillars > 0), num_envs)
        # As MuJoCo has robot and thing together, the clock first, which starts at 0 in every step.
        ends = accumulate([1, len(robot.start), _MOVABLE_Q, robot.nv, _MOVABLE_V])
        q, movable_q, v, movable_v, end = ends
        self._states = zeros((num_envs, end))
        self.qpos, self.movable = self._states[:, q:movable_q], self._states[:, movable_q:v]
        self.qvel, self.movable_velocity = self._states[:, v:movable_v], self._states[:, movable_v:]
        self._velocities = slice(v, end)
        # Columns of the state of a robot alone, and which of both together these are.
        self._robot_columns = (
            (slice(0, movable_q), slice(0, movable_q)),
            (slice(movable_q, None), slice(v, movable_v)),
        )
        self.pillars = zeros((num_envs, pillars, 2))
        self._sensors = self.model.nsensordata
        self._moves = zeros(num_envs, bool)
        self.costs = zeros(num_envs)

    @property
    def model(self) -> mujoco.MjModel:
        """The model of a robot with everything that it can touch."""
        return self._together.model

    def position(self, rows: np.ndarray | slice = _ALL) -> np.ndarray:
        """Return the (M, 3) centres of some robots, in m."""
        qpos = self.qpos[rows]
        if self.robot.is_planar:
            position = np.empty((len(qpos), 3))
            position[:, :2], position[:, 2] = qpos[:, :2], POINT_HEIGHT
            return position
        return qpos[:, :3]

    def heights(self, rows: np.ndarray | slice = _ALL) -> np.ndarray | float:
        """Return the (M,) heights of some robots' centres, in m; one for all where it is fixed."""
        return POINT_HEIGHT if self.robot.is_planar else self.qpos[rows, 2]

    def axes(self, rows: np.ndarray | slice = _ALL) -> np.ndarray:
        """Return the (M, 3, 3) axes of some robots' bodies as columns, world frame."""
        if self.robot.is_planar:
            return matrix_of_yaw(self.qpos[rows, 2])
        return matrix_of(self.qpos[rows, 3:7])

    def quaternion(self, row: int) -> np.ndarray:
        """Return the (4,) orientation w, x, y, z of a robot's body, world frame."""
        if self.robot.is_planar:
            return quaternion_of_yaw(self.qpos[row : row + 1, 2])[0]
        return self.qpos[row, 3:7].copy()

    def place(
        self,
        rows: np.ndarray,
        robot: np.ndarray,
        movable: np.ndarray,
        pillars: np.ndarray,
        velocity: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Place some robots and the objects around them, vase or box at rest.

        Args:
            rows: (M,) indices of the robots.
            robot: (M, 3) x, y in m and yaw in rad.
            movable: (M, 3) x, y in m and yaw in rad.
            pillars: (M, P, 2) x, y in m.
            velocity: (M, nv) of the robots.

        Returns:
            (M, sensors) what the sensors read there while both actuators are off.
        """
        self.qpos[rows] = self.robot.start
        self.qpos[rows, :2] = robot[:, :2]
        if self.robot.is_planar:
            self.qpos[rows, 2] = robot[:, 2]
        else:
            self.qpos[rows, 3:7] = quaternion_of_yaw(robot[:, 2])
        self.qvel[rows] = velocity
        self.movable[rows, :2] = movable[:, :2]
        self.movable[rows, 2] = self._kind.height
        self.movable[rows, 3:] = quaternion_of_yaw(movable[:, 2])
        self.movable_velocity[rows] = 0.0
        self.pillars[rows] = pillars
        # It first settles into the soft floor.
        self._moves[rows] = True
        state, control = self._alone.inputs(len(rows), steps=1)
        for own, whole in self._robot_columns:
            state[:, own] = self._states[rows, whole]
        control[:] = 0.0
        return self._columns(self._alone.run(len(rows), steps=1)[1][:, 0].copy())

    def step(self, control: np.ndarray, rows: slice = _ALL) -> tuple[np.ndarray, np.ndarray]:
        """Advance some robots by ten substeps.

        Args:
            control: (M, 2) of their actuators, within [-1, 1].
            rows: the M robots, contiguous.

        Returns:
            ``(sensors, failed)``: (M, sensors) readings in the state just reached, and (M,) bool,
            the robots whose physics diverged. These stay where they were, at rest, and their
            sensors read 0.
        """
        near = self._near(rows)
        self.costs[rows] = np.where(near, self._together.seconds, self._alone.seconds)
        states = self._states[rows]
        after = states.copy()
        sensors = np.empty((len(states), self._sensors))
        together = near.nonzero()[0]
        count = len(near) - len(together)
        if count:
            # A slice if possible, which is faster.
            alone = (~near).nonzero()[0] if len(together) else _ALL
            inputs, controls = self._alone.inputs(count, steps=_STEPS)
            for own, whole in self._robot_columns:
                inputs[:, own] = states[alone, whole]
            controls[:] = control[alone, None]
            reached, readings = self._alone.run(count, steps=_STEPS)
            for own, whole in self._robot_columns:
                after[alone, whole] = reached[:, SUBSTEPS - 1, own]
            sensors[alone] = readings[:, SUBSTEPS]
        if len(together):
            inputs, controls = self._together.inputs(len(together), steps=_STEPS)
            inputs[:] = states[together]
            controls[:, :, :2] = control[together, None]
            if controls.shape[2] > 2:
                controls[:, :, 2:4] = self.pillars[rows][together]
                controls[:, :, 4] = PILLAR_HEIGHT / 2
            reached, readings = self._together.run(len(together), steps=_STEPS)
            after[together] = reached[:, SUBSTEPS - 1]
            sensors[together] = readings[:, SUBSTEPS]
        failed = self._diverged(after, sensors)
        sensors = self._columns(sensors)
        after[:, 0] = 0.0
        if failed.any():
            sensors[failed] = 0.0
            after[failed] = states[failed]
            after[failed, self._velocities] = 0.0
        states[:] = after
        if len(together):
            speed = np.abs(self.movable_velocity[rows]).max(axis=1)
            self._moves[rows] = ~(speed <= _REST_SPEED)
        return sensors, failed

    def _near(self, rows: slice) -> np.ndarray:
        """(M,) bool, the robots that need the full model: not alone within the coming step."""
        position = self.position(rows)
        speed = lengths(*self.qvel[rows, : 2 if self.robot.is_planar else 3].T)
        needed = self.robot.reach + SUBSTEPS * self.robot.timestep * speed + _RESERVE
        movable = self.movable[rows]
        offset = position - movable[:, :3]
        # First the bounding sphere, which is fast, then the bounding box for those within. The
        # comparisons are written so that NaN counts as near.
        near = ~(lengths(*offset.T) > needed + self._around)
        close = near.nonzero()[0]
        if len(close):
            axes = matrix_of(movable[close, 3:])
            local = np.abs(np.einsum('ni,nij->nj', offset[close], axes))
            near[close] = ~(lengths(*np.maximum(local - self._extents, 0.0).T) > needed[close])
        if self.pillars.shape[1]:
            to_pillar = lengths(*(position[:, :2] - self.pillars[rows, 0]).T)
            near |= ~(to_pillar > needed + PILLAR_RADIUS)
        return near | self._moves[rows]

    def _diverged(self, states: np.ndarray, sensors: np.ndarray) -> np.ndarray:
        """(M,) bool, the robots that diverged: MuJoCo resets their state, or stops."""
        timestep = self.robot.timestep
        # A reset state has another time. A sum is finite only if all summands are.
        sums = states.sum(axis=1) + sensors.sum(axis=1)
        return (np.abs(states[:, 0] - SUBSTEPS * timestep) > timestep / 2) | ~np.isfinite(sums)

    def _columns(self, sensors: np.ndarray) -> np.ndarray:
        """Turn MuJoCo's sensor data into the sensor columns of the observation."""
        if not self.robot.rear_ball:
            return sensors
        ball = matrix_of(sensors[:, -4:]).reshape(len(sensors), 9)
        return np.concatenate([sensors[:, :-4], ball], axis=1)


class _Model:
    """A compiled model with the buffers through which ``mujoco.rollout`` steps a batch of it.

    Attributes:
        model: the compiled model.
        seconds: recent mean time per robot.
    """

    def __init__(self, mjcf: str, num_envs: int) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = mujoco.MjData(self.model)
        # No threads: the rest of a step, which is Python, would still run on one core.
        self._rollout = rollout.Rollout(nthread=0)
        spec = mujoco.mjtState.mjSTATE_CTRL
        if self.model.nmocap:
            spec = spec | mujoco.mjtState.mjSTATE_MOCAP_POS
        self._control_spec = int(spec)
        self.seconds = 1e-4
        size = mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._initial = np.zeros((num_envs, size))
        self._control = np.zeros(num_envs * _STEPS * mujoco.mj_stateSize(self.model, spec))
        self._states = np.zeros(num_envs * _STEPS * size)
        self._sensors = np.zeros(num_envs * _STEPS * self.model.nsensordata)

    def inputs(self, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the (count, 1 + nq + nv) states and (count, steps, c) controls to fill.

        The first column of the states is the clock. Controls are those of the two actuators, then
        the position of the pillar if there is one.
        """
        return self._initial[:count], self._shaped(self._control, count, steps)

    def run(self, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Step the first ``count`` inputs.

        Returns:
            (count, steps, 1 + nq + nv) states after each step and (count, steps, s) sensor data
            before it; the next run overwrites both.
        """
        states = self._shaped(self._states, count, steps)
        sensors = self._shaped(self._sensors, count, steps)
        initial, control = self.inputs(count, steps)
        start = time.perf_counter()
        # The shapes are right by construction, and checks can take longer than a step.
        self._rollout.rollout(
            [self.model] * count,
            [self._data],
            initial,
            control,
            control_spec=self._control_spec,
            skip_checks=True,
            nstep=steps,
            state=states,
            sensordata=sensors,
        )
        taken = (time.perf_counter() - start) / (count * steps) * _STEPS
        self.seconds += _LATEST * (taken - self.seconds)
        return states, sensors

    def _shaped(self, buffer: np.ndarray, count: int, steps: int) -> np.ndarray:
        width = len(buffer) // (len(self._initial) * _STEPS)
        return buffer[: count * steps * width].reshape(count, steps, width)
