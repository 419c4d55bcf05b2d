# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The batched highway step by step beside highway-env."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.worlds.highway import (
    ACCELERATION_RANGE,
    STEERING_RANGE,
    Highway,
    observed,
)
from occ_constraints_pkg.worlds.highway_features import surroundings
from occ_constraints_pkg.worlds.highway_scenarios import TRAFFIC, scenario
from occ_constraints_pkg.worlds.highway_traffic import (
    HEADING,
    IDENTITY,
    SPEED,
    STEP_SECONDS,
    TARGET,
    Traffic,
    X,
    Y,
)

from experiments.highway_reference import ReferenceHighway


@dataclass(frozen=True)
class Fidelity:
    """How far apart the two are.

    Attributes:
        steps: steps compared, over all scenarios.
        position: largest difference of any vehicle's position, in m.
        surroundings: largest difference of what the ego knows: speeds, gaps, edges; in m and m/s.
        ends_differ: scenarios in which the ego's drive ended at another step or otherwise.
        lane_changes: lane changes that began in the traffic.
        collisions: episodes that ended with a collision in both.
        off_road: episodes that ended off the road in both.
    """

    steps: int
    position: float
    surroundings: float
    ends_differ: int
    lane_changes: int
    collisions: int
    off_road: int


def compare(
    numbers: Sequence[int],
    *,
    actions: np.ndarray | None = None,
    steps: int = Highway.max_episode_steps,
) -> Fidelity:
    """Drive the same scenarios in both.

    Args:
        numbers: of the n scenarios.
        actions: (steps, n, 2) of the ego, within [-1, 1], positive ahead and to the left; ``None``:
            it is traffic like the others.
        steps: how long, in steps of 0.2 s; shorter where the ego's drive ends.
    """
    controlled, n = actions is not None, len(numbers)
    scenes = np.arange(n)
    traffic = Traffic(n, TRAFFIC + 1, controlled=controlled)
    traffic.start(scenes, [scenario(number) for number in numbers])
    references = [
        ReferenceHighway(
            scenario(number),
            controlled=controlled,
            steering_range=STEERING_RANGE,
            duration=steps * STEP_SECONDS,
        )
        for number in numbers
    ]
    compared, differences, ends = 0, [(0.0, 0.0)], []
    changes, open_scenes = 0, set(range(n))
    for step in range(steps):
        aimed = _by_identity(traffic, traffic.whole[TARGET])
        if controlled:
            scale = ACCELERATION_RANGE, -STEERING_RANGE
            traffic.step(*(actions[step] * scale).T)
        else:
            traffic.step()
        changes += int((_by_identity(traffic, traffic.whole[TARGET]) != aimed).sum())
        states = np.stack(
            [_by_identity(traffic, traffic.real[i]) for i in (X, Y, HEADING, SPEED)], axis=-1
        )
        known, relative = surroundings(traffic, traffic.ego, scenes)
        off_road = (known[:, 8:] < 0.0).any(axis=1)
        known = np.concatenate([known, relative], axis=1)
        for index in sorted(open_scenes):
            reference = references[index]
            if controlled:
                reference.step(actions[step, index] * (1.0, -1.0))
            else:
                reference.let_traffic_drive()
            ours = bool(traffic.colliding[index]), bool(off_road[index])
            theirs = bool(reference.vehicle.crashed), not reference.vehicle.on_road
            if any(ours) or any(theirs):
                # highway-env pushes vehicles that have collided: there is nothing to compare.
                ends.append((ours, theirs))
                open_scenes.discard(index)
                continue
            compared += 1
            apart = np.abs(states[:, index] - reference.states())[:, :2].max()
            seen = np.concatenate(reference.surroundings())
            differences.append((apart, np.abs(known[index] - seen).max()))
    position, known_apart = np.max(differences, axis=0)
    return Fidelity(
        compared,
        float(position),
        float(known_apart),
        sum(ours != theirs for ours, theirs in ends),
        changes,
        sum(ours == theirs and ours[0] for ours, theirs in ends),
        sum(ours == theirs and ours[1] for ours, theirs in ends),
    )


@dataclass(frozen=True)
class Ends:
    """How episodes of a policy end in highway-env.

    Attributes:
        drives: number of episodes.
        alike: those that end after the same step and for the same reason in the batched world.
        collision: episodes that end with a collision in highway-env.
        off_road: episodes that end off the road in highway-env.
    """

    drives: int
    alike: int
    collision: int
    off_road: int


def drive_both(policy: GaussianPolicy, numbers: Sequence[int]) -> Ends:
    """Let a policy drive, by the mean of its actions, in highway-env and in the batched world.

    Args:
        policy: of the world ``highway``.
        numbers: of the scenarios, driven to the end.
    """
    n = len(numbers)
    world = Highway(n)
    observation, _ = world.start(np.arange(n), list(numbers))
    ours: dict[int, tuple[int, bool, bool]] = {}
    for step in range(1, Highway.max_episode_steps + 1):
        observation, _, terminated, truncated, info = world.step(policy.act(observation))
        for row in np.flatnonzero(terminated | truncated):
            end = step, bool(info['collision'][row]), bool(info['off_road'][row])
            ours.setdefault(int(row), end)
    alike = collisions = left = 0
    for row, number in enumerate(numbers):
        reference = ReferenceHighway(
            scenario(number),
            steering_range=STEERING_RANGE,
            duration=Highway.max_episode_steps * STEP_SECONDS,
        )
        step, ended = 0, False
        while step < Highway.max_episode_steps and not ended:
            seen = observed(*(part[None] for part in reference.surroundings()))
            *_, ended, _, _ = reference.step(policy.act(seen)[0] * (1.0, -1.0))
            step += 1
        end = step, bool(reference.vehicle.crashed), not reference.vehicle.on_road
        alike += end == ours[row]
        collisions, left = collisions + end[1], left + end[2]
    return Ends(n, alike, collisions, left)


def _by_identity(traffic: Traffic, values: np.ndarray) -> np.ndarray:
    """Return (V, N) values in the order of identities instead of the order of the road."""
    return np.take_along_axis(values, np.argsort(traffic.whole[IDENTITY], axis=0), axis=0)
