# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The physics of N Point robots, each with a vase on its own floor, stepped by MuJoCo's threads."""

from __future__ import annotations

import os

import mujoco
import numpy as np
from mujoco import rollout

SUBSTEPS = 10
TIMESTEP = 0.002
SENSORS = 12

# Values after Safety-Gym's Point robot and vase. The vase stands slightly sunk into the soft
# floor. Contact bits: robot and floor each meet the vase; robot and floor never meet, since the
# robot slides in the plane and just touches the floor without force.
_MJCF = """
<mujoco model="point">
  <option timestep="{timestep}">{flags}</option>
  <default>
    <geom condim="6" density="1" contype="0" conaffinity="0"/>
    <motor ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-.05 .05"/>
    <velocity ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-.05 .05"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" contype="1"/>
    <body name="robot" pos="0 0 .1">
      <joint name="x" type="slide" axis="1 0 0" damping=".01"/>
      <joint name="y" type="slide" axis="0 1 0" damping=".01"/>
      <joint name="yaw" type="hinge" axis="0 0 1" damping=".005"/>
      <geom name="ball" type="sphere" size=".1" friction="1 .01 .01" contype="1"/>
      <geom name="pointer" type="box" pos=".1 0 0" size=".05 .05 .05" contype="1"/>
      <site name="robot"/>
    </body>
    {vase}
  </worldbody>
  <actuator>
    <motor name="forward" site="robot" gear=".3 0 0 0 0 0"/>
    <velocity name="turn" joint="yaw" gear=".3"/>
  </actuator>
  <sensor>
    <accelerometer site="robot"/>
    <velocimeter site="robot"/>
    <gyro site="robot"/>
    <magnetometer site="robot"/>
  </sensor>
</mujoco>
"""
_VASE = """
    <body name="vase" pos="0 0 {height}">
      <freejoint/>
      <geom name="vase" type="box" size=".1 .1 .1" density=".001" conaffinity="1"/>
    </body>
"""
_VASE_HEIGHT = 0.1 - 4e-5
# Robot and vase centres further apart than this cannot touch within one step: the robot reaches
# out 0.158 m, the vase's corner 0.173 m, and the robot's terminal speed of 1.5 m/s takes it
# 0.03 m; the rest is reserve.
_NEAR = 0.4
# A vase slower than this, in m/s and rad/s, counts as at rest: friction stops it in milliseconds.
_REST_SPEED = np.array([1e-3] * 3 + [1e-2] * 3)
# Below this many robots a thread costs more than it brings.
_ROBOTS_PER_THREAD = 16
# Rows of mjtState.mjSTATE_FULLPHYSICS of the two models: time, then positions, then velocities.
_ROBOT_Q, _ROBOT_V = 3, 3
_VASE_Q, _VASE_V = 7, 6


class PointPhysics:
    """Positions and velocities of N robots and their vases, and the steps that change them.

    A robot far from a vase at rest is stepped with a model of the robot alone, which is exact and
    several times faster; the vase keeps its state meanwhile. The choice is made robot by robot
    from its own state, so it does not depend on the batch.

    Attributes:
        robot: (N, 3) x, y in m and yaw in rad.
        robot_velocity: (N, 3) in m/s and rad/s, world frame.
        vase: (N, 7) position in m and orientation quaternion.
        vase_velocity: (N, 6) as MuJoCo's free joint has it.
    """

    def __init__(self, num_envs: int, *, threads: int = 0) -> None:
        """Start with every robot and vase at the origin; :meth:`place` them before use.

        Args:
            num_envs: number of robots N.
            threads: number of threads; 0 means one per core, fewer for small batches.
        """
        if threads == 0:
            threads = min(len(os.sched_getaffinity(0)), num_envs // _ROBOTS_PER_THREAD)
        threads = max(threads, 1)
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._alone = _Model(_mjcf(with_vase=False), num_envs, threads)
        self._both = _Model(_mjcf(with_vase=True), num_envs, threads)
        self.robot = np.zeros((num_envs, _ROBOT_Q))
        self.robot_velocity = np.zeros((num_envs, _ROBOT_V))
        self.vase = np.zeros((num_envs, _VASE_Q))
        self.vase_velocity = np.zeros((num_envs, _VASE_V))
        self._vase_moves = np.zeros(num_envs, dtype=bool)

    def place(
        self,
        rows: np.ndarray,
        robot: np.ndarray,
        vase: np.ndarray,
        robot_velocity: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Put some robots and their vases somewhere, the vases at rest.

        Args:
            rows: (M,) indices of the robots.
            robot: (M, 3) x, y in m and yaw in rad.
            vase: (M, 3) x, y in m and yaw in rad.
            robot_velocity: (M, 3) in m/s and rad/s, world frame.

        Returns:
            (M, 12) what the sensors read there while both actuators are off.
        """
        self.robot[rows] = robot
        self.robot_velocity[rows] = robot_velocity
        self.vase[rows, :2] = vase[:, :2]
        self.vase[rows, 2] = _VASE_HEIGHT
        self.vase[rows, 3:] = 0.0
        self.vase[rows, 3] = np.cos(vase[:, 2] / 2)
        self.vase[rows, 6] = np.sin(vase[:, 2] / 2)
        self.vase_velocity[rows] = 0.0
        self._vase_moves[rows] = False
        state, control = self._alone.inputs(len(rows), steps=1)
        state[:, 1:] = np.concatenate([self.robot[rows], self.robot_velocity[rows]], axis=1)
        control[:] = 0.0
        _, sensors = self._alone.run(self._pool, len(rows), steps=1)
        return sensors[:, 0].copy()

    def step(self, control: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance every robot by ten substeps of 2 ms.

        Args:
            control: (N, 2) thrust and turn, within [-1, 1].

        Returns:
            ``(sensors, failed)``: (N, 12) readings in the state just reached, and (N,) bool, the
            robots whose physics blew up. Those stay where they were, at rest, and their sensors
            read 0.
        """
        distance = np.hypot(*(self.robot[:, :2] - self.vase[:, :2]).T)
        # Written so that a distance that is not a number goes to the full model.
        near = ~(distance > _NEAR) | self._vase_moves
        sensors = np.zeros((len(control), SENSORS))
        failed = np.zeros(len(control), dtype=bool)

        rows = np.flatnonzero(~near)
        if len(rows):
            before = np.concatenate([self.robot[rows], self.robot_velocity[rows]], axis=1)
            after, sensors[rows], failed[rows] = self._advance(self._alone, before, control[rows])
            self.robot[rows], self.robot_velocity[rows] = after[:, :3], after[:, 3:]

        rows = np.flatnonzero(near)
        if len(rows):
            parts = (self.robot, self.vase, self.robot_velocity, self.vase_velocity)
            before = np.concatenate([part[rows] for part in parts], axis=1)
            after, sensors[rows], failed[rows] = self._advance(self._both, before, control[rows])
            self.robot[rows], self.vase[rows] = after[:, :3], after[:, 3:10]
            self.robot_velocity[rows], self.vase_velocity[rows] = after[:, 10:13], after[:, 13:]
            self._vase_moves[rows] = (np.abs(after[:, 13:]) > _REST_SPEED).any(axis=1)
        self.robot_velocity[failed] = 0.0
        self.vase_velocity[failed] = 0.0
        self._vase_moves[failed] = False
        return sensors, failed

    def close(self) -> None:
        """Stop the threads."""
        self._pool.close()

    def _advance(
        self, model: _Model, before: np.ndarray, control: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the states after ten substeps, the sensors there, and which robots failed."""
        # MuJoCo computes sensors before it integrates, so the readings that belong to the state
        # after ten substeps, under the same control, are those of an eleventh.
        initial, controls = model.inputs(len(before), steps=SUBSTEPS + 1)
        initial[:, 1:] = before
        controls[:] = control[:, None]
        states, readings = model.run(self._pool, len(before), steps=SUBSTEPS + 1)
        after, sensors = states[:, SUBSTEPS - 1], readings[:, SUBSTEPS].copy()
        # When the numbers blow up MuJoCo resets the state, clock included, or stops.
        failed = np.abs(after[:, 0] - SUBSTEPS * TIMESTEP) > TIMESTEP / 2
        failed |= ~np.isfinite(after).all(axis=1) | ~np.isfinite(sensors).all(axis=1)
        after = np.where(failed[:, None], before, after[:, 1:])
        sensors[failed] = 0.0
        return after, sensors, failed


class _Model:
    """A compiled model with the buffers through which ``mujoco.rollout`` steps a batch of it."""

    def __init__(self, mjcf: str, num_envs: int, threads: int) -> None:
        self._model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        steps = SUBSTEPS + 1
        self._initial = np.zeros((num_envs, size))
        self._control = np.zeros(num_envs * steps * self._model.nu)
        self._states = np.zeros(num_envs * steps * size)
        self._sensors = np.zeros(num_envs * steps * SENSORS)

    def inputs(self, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the (count, 1 + nq + nv) initial states and (count, steps, 2) controls to fill.

        The first column of the states is the clock and stays 0.
        """
        return self._initial[:count], self._shaped(self._control, count, steps)

    def run(self, pool: rollout.Rollout, count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Step the first ``count`` initial states.

        Returns:
            (count, steps, 1 + nq + nv) states after each step and (count, steps, 12) sensors
            before it; the next call overwrites both.
        """
        states = self._shaped(self._states, count, steps)
        sensors = self._shaped(self._sensors, count, steps)
        pool.rollout(
            self._model,
            self._data,
            self._initial[:count],
            self._shaped(self._control, count, steps),
            nstep=steps,
            state=states,
            sensordata=sensors,
        )
        return states, sensors

    def _shaped(self, buffer: np.ndarray, count: int, steps: int) -> np.ndarray:
        width = len(buffer) // (len(self._initial) * (SUBSTEPS + 1))
        return buffer[: count * steps * width].reshape(count, steps, width)


def _mjcf(*, with_vase: bool) -> str:
    """Return the model of the robot with its vase, or of the robot alone without any contact."""
    flags = '' if with_vase else '<flag contact="disable" constraint="disable"/>'
    vase = _VASE.format(height=_VASE_HEIGHT) if with_vase else ''
    return _MJCF.format(timestep=TIMESTEP, flags=flags, vase=vase)
