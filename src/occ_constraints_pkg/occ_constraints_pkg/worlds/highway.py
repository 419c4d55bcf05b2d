# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Highway driving in traffic, after the driving experiment of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.worlds.base import Column, World
from occ_constraints_pkg.worlds.highway_features import FAR, NAMES, surroundings
from occ_constraints_pkg.worlds.highway_scenarios import FULL, RESTRICTED, TRAFFIC, scenario
from occ_constraints_pkg.worlds.highway_traffic import STEP_SECONDS, Traffic
from occ_constraints_pkg.worlds.robots import checked_action, robot_generators, selected_rows

ACCELERATION_RANGE = 5.0
# At 30 m/s this is 9 m/s^2 of lateral acceleration, about the limit of tyres.
STEERING_RANGE = 0.05
# Reward grows from the first of these speeds to the second, as in highway-env; in m/s.
_REWARDED_SPEEDS = (20.0, 30.0)
_SECONDS = 40.0
_SIXTH = range(6)
# Gap in m with a nearness of one half.
_HALF_NEAR = 10.0


class Highway(World):
    """Drive fast for 40 s, without a collision and without leaving the road.

    Observations are the ten features of the paper, then the relative speeds of the neighbours and
    their nearness 10 / (10 + gap), because a network sees gaps scaled by their spread of hundreds
    of metres. Actions are acceleration and steering, as in ``ContinuousAction`` of highway-env;
    positive is forward and left. The reward per second is 0 up to 20 m/s along the road, 1 from
    30 m/s on and linear between, as the high-speed term of highway-env: at most 40 per episode.
    Collisions, and leaving the road with the centre of the car, terminate the episode and cost 1.
    """

    name = 'highway'
    scenarios = FULL
    columns = (
        Column('v_x', 'm/s'),
        Column('v_y', 'm/s'),
        *(Column(name, 'm', 0.0, FAR) for name in NAMES[2:8]),
        Column('d_left', 'm'),
        Column('d_right', 'm'),
        *(Column(f'v_rel{i}', 'm/s') for i in _SIXTH),
        *(Column(f'near{i}', '1', 0.0, 1.0) for i in _SIXTH),
    )
    action_columns = (
        Column('acceleration', low=-1.0, high=1.0),
        Column('steering', low=-1.0, high=1.0),
    )
    step_seconds = STEP_SECONDS
    max_episode_steps = round(_SECONDS / STEP_SECONDS)
    state_names = (
        '_rngs',
        '_steps',
        *(
            f'traffic.{name}'
            for name in (
                'real',
                'whole',
                'lanes',
                'ahead',
                'behind',
                'colliding',
                'about_to_collide',
                'cos',
                'sin',
            )
        ),
    )

    def __init__(self, num_envs: int, *, processes: int = 0) -> None:
        self.num_envs = num_envs
        self.traffic = Traffic(num_envs, TRAFFIC + 1)
        self._rngs = robot_generators(None, num_envs)
        self._rows = np.arange(num_envs)
        self._steps = np.zeros(num_envs, dtype=np.int64)

    @property
    def steps_left(self) -> np.ndarray:
        """(N,) int, steps that each robot has left of its 40 s."""
        return self.max_episode_steps - self._steps

    def reset(
        self, *, seed: int | None = None, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in scenarios drawn at random; see :meth:`World.reset`."""
        rows = selected_rows(mask, self.num_envs)
        if seed is not None:
            self._rngs = robot_generators(seed, self.num_envs)
        return self.start(rows, [int(self._rngs[row].integers(self.scenarios)) for row in rows])

    def start(self, rows: np.ndarray, numbers: list[int]) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes in given scenarios.

        Args:
            rows: (n,) int, the robots.
            numbers: n numbers of scenarios.

        Returns:
            As :meth:`reset`.
        """
        self.traffic.start(rows, [scenario(number) for number in numbers])
        self._steps[rows] = 0
        return self._seen()

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one step; see :meth:`World.step`.

        ``info`` also says why an episode was terminated: ``collision`` and ``off_road``, (N,) bool.
        """
        chosen = checked_action(action, self.num_envs, ('acceleration', 'steering'))
        # To highway-env the right is positive.
        self.traffic.step(ACCELERATION_RANGE * chosen[:, 0], -STEERING_RANGE * chosen[:, 1])
        self._steps += 1
        observation, info = self._seen()
        low, high = _REWARDED_SPEEDS
        speed = observation[:, 0].astype(np.float64)
        reward = STEP_SECONDS * np.clip((speed - low) / (high - low), 0.0, 1.0)
        terminated = info['collision'] | info['off_road']
        truncated = ~terminated & (self._steps >= self.max_episode_steps)
        return observation, reward, terminated, truncated, info

    def _seen(self) -> tuple[np.ndarray, dict[str, Any]]:
        traffic, rows = self.traffic, self._rows
        ego = traffic.ego
        known, relative = surroundings(traffic, ego, rows)
        observation = observed(known, relative)
        collision = traffic.colliding.copy()
        off_road = (known[:, 8:] < 0.0).any(axis=1)
        return observation, {
            'true_cost': (collision | off_road).astype(np.float64),
            'collision': collision,
            'off_road': off_road,
        }


def observed(known: np.ndarray, relative: np.ndarray) -> np.ndarray:
    """Return observations, (n, 22) float32.

    Args:
        known: (n, 10) the features of the paper.
        relative: (n, 6) speeds of the neighbours relative to the robot's own, in m/s.
    """
    nearness = _HALF_NEAR / (_HALF_NEAR + known[:, 2:8])
    return np.column_stack([known, relative, nearness]).astype(np.float32)


class RestrictedHighway(Highway):
    """The same with the first 52 scenarios only, the paper's restricted set."""

    name = 'highway_restricted'
    scenarios = RESTRICTED
