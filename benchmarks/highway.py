# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The batched highway beside highway-env on the same scenarios."""

from __future__ import annotations

import itertools
import time
from typing import Any

import gymnasium
import highway_env
import numpy as np
from occ_constraints_pkg.worlds.highway import STEERING_RANGE, Highway
from occ_constraints_pkg.worlds.highway_scenarios import TRAFFIC, scenario
from occ_constraints_pkg.worlds.highway_traffic import STEP_SECONDS
from occ_constraints_pkg.worlds.stream import EpisodeStream

from experiments.highway_fidelity import compare
from experiments.highway_reference import ReferenceHighway

ROBOTS = (64, 256)
# Of each form before the next has its turn, so that a change of load meets all of them.
_BATCHED, _REFERENCE, _SHIPPED = 20, 20, 4
# Scenarios in which positions are compared, over so many steps.
_COMPARED, _WHOLE = 5, Highway.max_episode_steps
# Random steering as strong as this keeps most cars on the road for a while.
_STEERING = 0.05


def run(seconds: float = 10.0) -> dict[str, Any]:
    """Measure the world with 64 and 256 robots, and highway-env, by turns, in one thread.

    All forms drive the same 21 vehicles, resets included, under the same kind of random actions.
    ``reference`` is highway-env with our scenarios, continuous actions and five decisions a second:
    a step of it is a step of ours, 0.2 s in one step of integration. ``shipped`` is
    ``highway-fast-v0`` as it comes, with one decision a second: a step of it is five of ours.

    ``position_difference_m`` is the largest difference of any vehicle's position within 40 s,
    without and with an ego that acts at random.

    Args:
        seconds: least processor time of each form.
    """
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (_WHOLE, _COMPARED, 2)) * (0.2, _STEERING)
    alone = compare(range(_COMPARED))
    driven = compare(range(_COMPARED), actions=actions)
    forms = {
        **{f'{count}_robots': _Batched(count) for count in ROBOTS},
        'reference': _Reference(),
        'shipped': _Shipped(),
    }
    while min(form.seconds for form in forms.values()) < seconds:
        for form in forms.values():
            begun = time.process_time()
            form.steps += form.work()
            form.seconds += time.process_time() - begun
    rates = {name: form.steps / form.seconds for name, form in forms.items()}
    substeps = {'shipped': round(1 / STEP_SECONDS)}
    peers = {
        f'highway_env_{name}_env_steps_per_s': rates[name] for name in ('reference', 'shipped')
    }
    metrics = {
        'position_difference_m': max(alone.position, driven.position),
        'steps_compared': alone.steps + driven.steps,
        'lane_changes_compared': alone.lane_changes + driven.lane_changes,
        'drives_that_end_otherwise': alone.ends_differ + driven.ends_differ,
    }
    for count in ROBOTS:
        rate = rates[f'{count}_robots']
        metrics[f'{count}_robots_env_steps_per_s'] = rate
        for name in ('reference', 'shipped'):
            alike = rates[name] * substeps.get(name, 1)
            metrics[f'{count}_robots_per_{name}_simulated_time_ratio'] = rate / alike
    return {
        'metrics': metrics,
        'peers': peers,
        'settings': {'vehicles': TRAFFIC + 1, 'step_s': STEP_SECONDS, 'seconds': seconds},
    }


class _Form:
    """Counts steps and the processor time that they take."""

    def __init__(self) -> None:
        self.steps, self.seconds = 0, 0.0
        self._rng = np.random.default_rng(0)

    def _actions(self, shape: tuple[int, ...]) -> np.ndarray:
        return self._rng.uniform(-1.0, 1.0, (*shape, 2)) * (1.0, _STEERING)

    def work(self) -> int:
        """Make some steps and return how many."""
        raise NotImplementedError


class _Batched(_Form):
    """The world, robots side by side."""

    def __init__(self, robots: int) -> None:
        super().__init__()
        self._robots = robots
        self._stream = EpisodeStream(Highway(robots), seed=0)
        self._stream.reset()

    def work(self) -> int:
        for action in self._actions((_BATCHED, self._robots)):
            self._stream.step(action)
        return _BATCHED * self._robots


class _Reference(_Form):
    """highway-env with our scenarios, one after another."""

    def __init__(self) -> None:
        super().__init__()
        self._numbers = itertools.count()
        self._begin()

    def _begin(self) -> None:
        self._env = ReferenceHighway(
            scenario(next(self._numbers)),
            steering_range=STEERING_RANGE,
            duration=Highway.max_episode_steps * STEP_SECONDS,
        )

    def work(self) -> int:
        for action in self._actions((_REFERENCE,)):
            *_, terminated, truncated, _ = self._env.step(action)
            if terminated or truncated:
                self._begin()
        return _REFERENCE


class _Shipped(_Form):
    """``highway-fast-v0`` with its own actions."""

    def __init__(self) -> None:
        super().__init__()
        gymnasium.register_envs(highway_env)
        self._env = gymnasium.make('highway-fast-v0')
        self._env.reset(seed=0)

    def work(self) -> int:
        for action in self._rng.integers(5, size=_SHIPPED):
            *_, terminated, truncated, _ = self._env.step(int(action))
            if terminated or truncated:
                self._env.reset()
        return _SHIPPED
