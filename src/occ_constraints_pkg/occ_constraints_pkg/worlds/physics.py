# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The physics of N robots, each on a floor of its own, stepped by MuJoCo's threads."""

from __future__ import annotations

import os

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
from occ_constraints_pkg.worlds.rotation import matrix_of, matrix_of_yaw, quaternion_of_yaw

SUBSTEPS = 10
# Robots nearer than this to something, in m, count as about to touch it, besides what they can
# travel at their present speed within a step: they may speed up, and things are not that sharp.
_RESERVE = 0.02
# A vase or box slower than this, in m/s and rad/s, counts as at rest.
_REST_SPEED = 1e-6
# Below this many robots a thread costs more than it brings.
_ROBOTS_PER_THREAD = 16
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
    """

    def __init__(
        self, robot: Robot, movable: Movable, *, pillars: int, num_envs: int, threads: int = 0
    ) -> None:
        """Start with everything at the origin; :meth:`place` it before use.

        Args:
            robot: what the robots are.
            movable: what each of them can push.
            pillars: number of pillars beside each, 0 or 1.
            num_envs: number of robots N.
            threads: number of threads; 0 means one per core, fewer for small batches.
        """
        if threads == 0:
            threads = min(len(os.sched_getaffinity(0)), num_envs // _ROBOTS_PER_THREAD)
        threads = max(threads, 1)
        self.robot = robot
        self._kind = movable
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._alone = _Model(scene_mjcf(robot), num_envs, threads)
        scene = scene_mjcf(robot, movable, pillar=pillars > 0)
        self._together = _Model(scene, num_envs, threads)
        # One array as MuJoCo's state of both together, and views of its parts.
        ends = np.cumsum([len(robot.start), _MOVABLE_Q, robot.nv, _MOVABLE_V])
        self._state = np.zeros((num_envs, ends[-1]))
        parts = np.split(self._state, ends[:-1], axis=1)
        self.qpos, self.movable, self.qvel, self.movable_velocity = parts
        everything = np.arange(ends[-1])
        self._both_columns = everything
        self._alone_columns = np.concatenate(np.split(everything, ends[:-1])[::2])
        self.pillars = np.zeros((num_envs, pillars, 2))
        self._moves = np.zeros(num_envs, dtype=bool)

    @property
    def model(self) -> mujoco.MjModel:
        """The model of a robot with everything that it can touch."""
        return self._together.model

    @property
    def position(self) -> np.ndarray:
        """(N, 3) centres of the robots, in m."""
        if self.robot.is_planar:
            position = np.empty((len(self.qpos), 3))
            position[:, :2], position[:, 2] = self.qpos[:, :2], POINT_HEIGHT
            return position
        return self.qpos[:, :3]

    @property
    def axes(self) -> np.ndarray:
        """(N, 3, 3) axes of the robots' bodies as columns, world frame."""
        if self.robot.is_planar:
            return matrix_of_yaw(self.qpos[:, 2])
        return matrix_of(self.qpos[:, 3:7])

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
        state[:, 1:] = self._state[rows[:, None], self._alone_columns]
        control[:] = 0.0
        _, sensors = self._alone.run(self._pool, len(rows), steps=1)
        return self._columns(sensors[:, 0])

    def step(self, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance every robot by ten substeps.

        Args:
            control: (N, 2) what the actuators shall do, within [-1, 1].

        Returns:
            ``(sensors, failed)``: (N, sensors) readings in the state just reached, and (N,) bool,
            the robots whose physics blew up. Those stay where they were, at rest, and their
            sensors read 0.
        """
        # Written so that a gap that is not a number goes to the full model.
        near = ~(self._gap() > 0.0) | self._moves
        sensors = np.zeros((len(control), len(self.robot.sensors)))
        failed = np.zeros(len(control), dtype=bool)
        rows = np.flatnonzero(~near)
        if len(rows):
            done = self._advance(self._alone, self._alone_columns, rows, control)
            sensors[rows], failed[rows] = done
        rows = np.flatnonzero(near)
        if len(rows):
            done = self._advance(self._together, self._both_columns, rows, control)
            sensors[rows], failed[rows] = done
            speed = np.abs(self.movable_velocity[rows]).max(axis=1)
            self._moves[rows] = ~(speed <= _REST_SPEED)
        if failed.any():
            self.qvel[failed] = 0.0
            self.movable_velocity[failed] = 0.0
        return sensors, failed

    def close(self) -> None:
        """Stop the threads."""
        self._pool.close()

    def _gap(self) -> np.ndarray:
        """(N,) free way, in m, beyond what each robot may travel before it touches something."""
        position = self.position
        linear = 2 if self.robot.is_planar else 3
        speed = np.sqrt((self.qvel[:, :linear] ** 2).sum(axis=1))
        needed = self.robot.reach + SUBSTEPS * self.robot.timestep * speed + _RESERVE
        offset = position - self.movable[:, :3]
        extents = self._kind.half_extents
        free = np.sqrt((offset**2).sum(axis=1)) - np.sqrt((extents**2).sum())
        # The sphere around the thing is quick to tell; the box around it matters to those within.
        close = np.flatnonzero(~(free > needed))
        if len(close):
            axes = matrix_of(self.movable[close, 3:])
            local = np.abs(np.einsum('ni,nij->nj', offset[close], axes))
            free[close] = np.sqrt((np.maximum(local - extents, 0.0) ** 2).sum(axis=1))
        if self.pillars.shape[1]:
            to_pillar = np.hypot(*(position[:, :2] - self.pillars[:, 0]).T) - PILLAR_RADIUS
            free = np.minimum(free, to_pillar)
        return free - needed

    def _advance(
        self, model: _Model, columns: np.ndarray, rows: np.ndarray, control: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Step some robots; return the sensors there, and which of them failed.

        Args:
            model: steps them.
            columns: those of the state that the model knows, in its order.
            rows: (M,) the robots.
            control: (N, 2) of all robots.
        """
        # MuJoCo computes sensors before it integrates, so the readings that belong to the state
        # after ten substeps, under the same control, are those of an eleventh.
        initial, controls = model.inputs(len(rows), steps=SUBSTEPS + 1)
        initial[:, 1:] = self._state[rows[:, None], columns]
        controls[:, :, :2] = control[rows, None]
        if controls.shape[2] > 2:
            controls[:, :, 2:4] = self.pillars[rows]
            controls[:, :, 4] = PILLAR_HEIGHT / 2
        states, readings = model.run(self._pool, len(rows), steps=SUBSTEPS + 1)
        after, sensors = states[:, SUBSTEPS - 1], readings[:, SUBSTEPS]
        # When the numbers blow up MuJoCo resets the state, clock included, or stops. A sum is
        # finite only if all it adds up is, or if it is far beyond any state here.
        timestep = self.robot.timestep
        sums = after.sum(axis=1) + sensors.sum(axis=1)
        failed = (np.abs(after[:, 0] - SUBSTEPS * timestep) > timestep / 2) | ~np.isfinite(sums)
        readings = self._columns(sensors)
        if failed.any():
            readings[failed] = 0.0
            rows, after = rows[~failed], after[~failed]
        self._state[rows[:, None], columns] = after[:, 1:]
        return readings, failed

    def _columns(self, sensors: np.ndarray) -> np.ndarray:
        """Turn MuJoCo's sensor data into the sensor columns of the observation, as a copy."""
        if not self.robot.rear_ball:
            return sensors.copy()
        ball = matrix_of(sensors[:, -4:]).reshape(len(sensors), 9)
        return np.concatenate([sensors[:, :-4], ball], axis=1)


class _Model:
    """A compiled model with the buffers through which ``mujoco.rollout`` steps a batch of it."""

    def __init__(self, mjcf: str, num_envs: int, threads: int) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = [mujoco.MjData(self.model) for _ in range(threads)]
        spec = mujoco.mjtState.mjSTATE_CTRL
        if self.model.nmocap:
            spec = spec | mujoco.mjtState.mjSTATE_MOCAP_POS
        self._control_spec = int(spec)
        size = mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        steps = SUBSTEPS + 1
        self._initial = np.zeros((num_envs, size))
        self._control = np.zeros(num_envs * steps * mujoco.mj_stateSize(self.model, spec))
        self._states = np.zeros(num_envs * steps * size)
        self._sensors = np.zeros(num_envs * steps * self.model.nsensordata)

    def inputs(self, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the (count, 1 + nq + nv) states and (count, steps, c) controls to fill.

        The first column of the states is the clock and stays 0. Controls are those of the two
        actuators, then the position of the pillar if there is one.
        """
        return self._initial[:count], self._shaped(self._control, count, steps)

    def run(self, pool: rollout.Rollout, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Step the first ``count`` initial states.

        Returns:
            (count, steps, 1 + nq + nv) states after each step and (count, steps, s) sensor data
            before it; the next call overwrites both.
        """
        states = self._shaped(self._states, count, steps)
        sensors = self._shaped(self._sensors, count, steps)
        # Our shapes are right by construction, and checking them takes longer than some steps.
        pool.rollout(
            [self.model] * count,
            self._data,
            self._initial[:count],
            self._shaped(self._control, count, steps),
            control_spec=self._control_spec,
            skip_checks=True,
            nstep=steps,
            state=states,
            sensordata=sensors,
        )
        return states, sensors

    def _shaped(self, buffer: np.ndarray, count: int, steps: int) -> np.ndarray:
        width = len(buffer) // (len(self._initial) * (SUBSTEPS + 1))
        return buffer[: count * steps * width].reshape(count, steps, width)
