# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Traffic as the demonstrator: what every vehicle of a scene sees while nobody is controlled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from occ_constraints_pkg.worlds.highway import Highway
from occ_constraints_pkg.worlds.highway_features import features
from occ_constraints_pkg.worlds.highway_scenarios import TRAFFIC, scenario
from occ_constraints_pkg.worlds.highway_traffic import IDENTITY, Traffic


def traffic_episodes(
    numbers: Sequence[int], steps: int = Highway.max_episode_steps
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the traffic of some scenarios, the car whose place the ego takes included.

    As in the recordings of highD each vehicle is a demonstrator, and others are its neighbours.

    Args:
        numbers: of the scenarios.
        steps: for how long, in steps of 0.2 s.

    Returns:
        (n, 10) float32, the ten features of each vehicle at each step, the first state included,
        in the order of time; (n,) int64, the episode of each, one per vehicle.
    """
    vehicles, scenes = TRAFFIC + 1, len(numbers)
    traffic = Traffic(scenes, vehicles, controlled=False)
    traffic.start(np.arange(scenes), [scenario(number) for number in numbers])
    rows, columns = np.divmod(np.arange(vehicles * scenes), scenes)
    states, episodes = [], []
    for step in range(steps + 1):
        if step:
            traffic.step()
        states.append(features(traffic, rows, columns).astype(np.float32))
        episodes.append(columns * vehicles + traffic.whole[IDENTITY][rows, columns])
    return np.concatenate(states), np.concatenate(episodes)
