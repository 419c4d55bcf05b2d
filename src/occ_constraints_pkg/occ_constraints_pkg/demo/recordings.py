# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of simulated episodes, made by the nodes sim, policy and recorder."""

from __future__ import annotations

from pathlib import Path

from occ_constraints_pkg.demo.processes import nodes_running

_SECONDS = 300.0


def record_episodes(
    bag: Path,
    logs: Path,
    domain: int,
    *,
    world: str,
    driver: str,
    robots: int,
    episodes: int,
    seed: int = 0,
) -> None:
    """Record episodes of a driver to a new bag.

    Args:
        bag: directory of the new bag.
        logs: directory for what the nodes say.
        domain: ROS domain id.
        world: name of the simulated task.
        driver: a policy file or the name of a driver; a trained policy explores, as published
            returns and costs are measured.
        robots: robots that drive at once.
        episodes: episodes of each robot.
        seed: of the simulation and the driver.

    Raises:
        OccError: a node failed or did not end in time.
    """
    nodes = {
        'recorder': {'output': bag, 'topics': ['observation', 'action']},
        'policy': {'policy': driver, 'explore': True, 'seed': seed},
        'sim': {
            'world': world,
            'num_robots': robots,
            'episodes': episodes,
            'seed': seed,
            'wait_for_subscribers': 2,
        },
    }
    with nodes_running(nodes, logs, domain) as running:
        running['sim'].wait(_SECONDS, *running.values())
