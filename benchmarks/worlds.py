# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Steps of the Safety-Gym tasks beside a bare loop of MuJoCo steps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from occ_constraints_pkg.worlds.physics import SUBSTEPS
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.safety_gym import SafetyGymWorld
from occ_constraints_pkg.worlds.stream import EpisodeStream

TASKS = ('PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1')
ROBOTS = 64
# Forms run by turns, so that a change of the machine's load meets all of them.
_STEPS_AT_ONCE = 100
_RESETS = 20


def run(seconds: float = 10.0) -> dict[str, Any]:
    """Measure each task in one process, in two, and as a bare loop, by turns.

    Robots act at random. Every form is measured over whole episodes, resets included, and for at
    least this long. Rates of one process are per second of processor time, which other processes
    do not take part in; the comparison of two processes with one is by the clock on the wall.

    Args:
        seconds: least time of each form.
    """
    metrics: dict[str, float] = {}
    peers: dict[str, float] = {}
    for task in TASKS:
        one, two, bare = _Stepping(task, 1), _Stepping(task, 2), _BareLoop(task)
        steps = one.stream.world.max_episode_steps + 1
        while min(one.wall, two.wall, bare.wall) < seconds or one.steps < steps * ROBOTS:
            for form in (one, two, bare):
                form.measure()
        rate = one.steps / one.processor
        metrics |= {
            f'{task}_env_steps_per_s': rate,
            f'{task}_env_steps_per_bare_step_ratio': rate * bare.processor / bare.steps,
            f'{task}_two_per_one_process_ratio': two.steps / two.wall * one.wall / one.steps,
            f'{task}_reset_us': _reset_seconds(one.stream.world) * 1e6,
        }
        peers[f'{task}_bare_mujoco_env_steps_per_s'] = bare.steps / bare.processor
        for form in (one, two):
            form.stream.world.close()
    return {
        'metrics': metrics,
        'peers': peers,
        'settings': {'robots': ROBOTS, 'substeps': SUBSTEPS, 'seconds': seconds},
    }


class _Form:
    """Counts steps and the time they take, by the wall and of the processor."""

    def __init__(self) -> None:
        self.steps, self.wall, self.processor = 0, 0.0, 0.0

    def _timed(self, work: Callable[[], int]) -> None:
        wall, processor = time.perf_counter(), time.process_time()
        self.steps += work()
        self.wall += time.perf_counter() - wall
        self.processor += time.process_time() - processor


class _Stepping(_Form):
    """A batch of robots that act at random, episode after episode."""

    def __init__(self, task: str, processes: int) -> None:
        super().__init__()
        self.stream = EpisodeStream(make_world(task, ROBOTS, processes=processes), seed=0)
        self.stream.reset()
        self._rng = np.random.default_rng(0)

    def measure(self) -> None:
        actions = self._rng.uniform(-1.0, 1.0, (_STEPS_AT_ONCE, ROBOTS, 2))

        def work() -> int:
            for action in actions:
                self.stream.step(action)
            return len(actions) * ROBOTS

        self._timed(work)


class _BareLoop(_Form):
    """MuJoCo alone: one robot with all that it can touch, ten steps for each of ours."""

    def __init__(self, task: str) -> None:
        super().__init__()
        self._world = make_world(task, 1, processes=1)
        self._rng = np.random.default_rng(0)
        self._layouts = [np.random.default_rng(1)]
        self._data = mujoco.MjData(self._model)

    @property
    def _model(self) -> mujoco.MjModel:
        return self._world.physics.model

    def measure(self) -> None:
        # A new layout each time, for what it costs depends on what touches what.
        self._world.start(np.array([0]), self._world.rules.sample_layout(self._layouts))
        physics = self._world.physics
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = np.concatenate([physics.qpos[0], physics.movable[0]])
        if self._model.nmocap:
            data.mocap_pos[0, :2] = physics.pillars[0, 0]
        actions = self._rng.uniform(-1.0, 1.0, (_STEPS_AT_ONCE, 2))

        def work() -> int:
            for action in actions:
                data.ctrl[:] = action
                mujoco.mj_step(self._model, data, SUBSTEPS)
            return len(actions)

        self._timed(work)


def _reset_seconds(world: SafetyGymWorld) -> float:
    """Return the processor time of a new layout, per robot."""
    before = time.process_time()
    for _ in range(_RESETS):
        world.reset()
    return (time.process_time() - before) / (_RESETS * world.num_envs)
