# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The physics of N robots, each on a floor of its own, stepped by MuJoCo."""

from __future__ import annotations

import time
from collections.abc import Callable

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
# Robots nearer than this to something, in m, count as about to touch it, besides what they can
# travel at their present speed within a step: they may speed up, and things are not that sharp.
_RESERVE = 0.02
# A vase or box slower than this, in m/s and rad/s, counts as at rest.
_REST_SPEED = 1e-6
# Share of the latest step in the mean time that a robot takes.
_LATEST = 0.05
_ALL = slice(None)
_MOVABLE_Q, _MOVABLE_V = 7, 6


class Physics:
    """Positions and velocities of N robots and their vases or boxes, and the steps they take.

    A robot that is too far from everything to touch it, while the vase or box is at rest, is
    stepped with a model of the robot alone, which is several times faster; the rest keeps its
    state meanwhile. The choice is made robot by robot from its own state, so it does not depend
    on the batch. One compiled model serves all robots: pillars are placed through ``mocap_pos``,
    which MuJoCo keeps with the state.

    Attributes:
        robot: what the robots are.
        qpos: (N, nq) the robots' positions as MuJoCo has them.
        qvel: (N, nv) the robots' velocities.
        movable: (N, 7) position in m and orientation quaternion of the vase or box.
        movable_velocity: (N, 6) as MuJoCo's free joint has it.
        pillars: (N, P, 2) x, y in m; P is 0 or 1.
        costs: (N,) about how long the last step of each robot took, in s: the mean of its kind.
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
            robot: what the robots are.
            movable: what each of them can push.
            pillars: number of pillars beside each, 0 or 1.
            num_envs: number of robots N.
            zeros: makes the arrays of the state, as ``numpy.zeros`` does.
        """
        self.robot = robot
        self._kind = movable
        self._around = float(np.sqrt((movable.half_extents**2).sum()))
        self._alone = _Model(scene_mjcf(robot), num_envs)
        self._together = _Model(scene_mjcf(robot, movable, pillar=pillars > 0), num_envs)
        # As MuJoCo has them, the clock first, which starts at 0 in every step.
        nq = len(robot.start)
        self._robots = zeros((num_envs, 1 + nq + robot.nv))
        self.qpos, self.qvel = self._robots[:, 1 : 1 + nq], self._robots[:, 1 + nq :]
        self._movables = zeros((num_envs, _MOVABLE_Q + _MOVABLE_V))
        self.movable, self.movable_velocity = np.split(self._movables, [_MOVABLE_Q], axis=1)
        # Where the two are in the state of both together.
        ends = np.cumsum([1 + nq, _MOVABLE_Q, robot.nv])
        parts = np.split(np.arange(ends[-1] + _MOVABLE_V), ends)
        self._robot_columns, self._movable_columns = np.r_[*parts[::2]], np.r_[*parts[1::2]]
        self.pillars = zeros((num_envs, pillars, 2))
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
        """Put some robots and what is around them somewhere, vase or box at rest.

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
        state[:] = self._robots[rows]
        control[:] = 0.0
        return self._columns(self._alone.run(len(rows), steps=1)[1][:, 0])

    def step(self, control: np.ndarray, rows: slice = _ALL) -> tuple[np.ndarray, np.ndarray]:
        """Advance some robots by ten substeps.

        Args:
            control: (M, 2) what their actuators shall do, within [-1, 1].
            rows: the M robots, in a row.

        Returns:
            ``(sensors, failed)``: (M, sensors) readings in the state just reached, and (M,) bool,
            the robots whose physics blew up. Those stay where they were, at rest, and their
            sensors read 0.
        """
        near = self._near(rows)
        self.costs[rows] = np.where(near, self._together.seconds, self._alone.seconds)
        robots, movables = self._robots[rows], self._movables[rows]
        sensors = np.empty((len(control), len(self.robot.sensors)))
        failed = np.empty(len(control), dtype=bool)
        together = near.nonzero()[0]
        count = len(near) - len(together)
        if count:
            # A slice, which is quicker, as long as it can be one.
            alone = (~near).nonzero()[0] if len(together) else _ALL
            state, controls = self._alone.inputs(count, steps=_STEPS)
            state[:] = robots[alone]
            controls[:] = control[alone, None]
            robots[alone], sensors[alone], failed[alone] = self._run(self._alone, count)
        if len(together):
            state, controls = self._together.inputs(len(together), steps=_STEPS)
            state[:, self._robot_columns] = robots[together]
            state[:, self._movable_columns] = movables[together]
            controls[:, :, :2] = control[together, None]
            if controls.shape[2] > 2:
                controls[:, :, 2:4] = self.pillars[rows][together]
                controls[:, :, 4] = PILLAR_HEIGHT / 2
            after, sensors[together], failed[together] = self._run(self._together, len(together))
            robots[together] = after[:, self._robot_columns]
            movables[together] = after[:, self._movable_columns]
            speed = np.abs(after[:, self._movable_columns[_MOVABLE_Q:]]).max(axis=1)
            self._moves[rows][together] = ~(speed <= _REST_SPEED)
        return sensors, failed

    def _near(self, rows: slice) -> np.ndarray:
        """(M,) bool, the robots that need the full model: not alone within the coming step."""
        position = self.position(rows)
        speed = lengths(self.qvel[rows, : 2 if self.robot.is_planar else 3])
        needed = self.robot.reach + SUBSTEPS * self.robot.timestep * speed + _RESERVE
        movable = self.movable[rows]
        offset = position - movable[:, :3]
        extents = self._kind.half_extents
        # The sphere around the thing is quick to tell; the box around it matters to those within.
        # Comparisons are written so that what is not a number counts as near.
        near = ~(lengths(offset) > needed + self._around)
        close = near.nonzero()[0]
        if len(close):
            axes = matrix_of(movable[close, 3:])
            local = np.abs(np.einsum('ni,nij->nj', offset[close], axes))
            near[close] = ~(lengths(np.maximum(local - extents, 0.0)) > needed[close])
        if self.pillars.shape[1]:
            to_pillar = lengths(position[:, :2] - self.pillars[rows, 0])
            near |= ~(to_pillar > needed + PILLAR_RADIUS)
        return near | self._moves[rows]

    def _run(self, model: _Model, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Step a model's inputs; return states, sensor columns and failures."""
        states, readings = model.run(count, steps=_STEPS)
        after, sensors = states[:, SUBSTEPS - 1], readings[:, SUBSTEPS]
        # When the numbers blow up MuJoCo resets the state, clock included, or stops. A sum is
        # finite only if all it adds up is, or if it is far beyond any state here.
        timestep = self.robot.timestep
        sums = after.sum(axis=1) + sensors.sum(axis=1)
        failed = (np.abs(after[:, 0] - SUBSTEPS * timestep) > timestep / 2) | ~np.isfinite(sums)
        after[:, 0] = 0.0
        sensors = self._columns(sensors)
        if failed.any():
            sensors[failed] = 0.0
            after[failed] = model.inputs(count, steps=_STEPS)[0][failed]
            after[failed, 1 + model.model.nq :] = 0.0
        return after, sensors, failed

    def _columns(self, sensors: np.ndarray) -> np.ndarray:
        """Turn MuJoCo's sensor data into the sensor columns of the observation, as a copy."""
        if not self.robot.rear_ball:
            return sensors.copy()
        ball = matrix_of(sensors[:, -4:]).reshape(len(sensors), 9)
        return np.concatenate([sensors[:, :-4], ball], axis=1)


class _Model:
    """A compiled model with the buffers through which ``mujoco.rollout`` steps a batch of it.

    Attributes:
        model: the compiled model.
        seconds: mean time that a robot took of late.
    """

    def __init__(self, mjcf: str, num_envs: int) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = mujoco.MjData(self.model)
        # Threads of its own would leave the rest of a step, which is Python, to one core.
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
        # Our shapes are right by construction, and checking them takes longer than some steps.
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
