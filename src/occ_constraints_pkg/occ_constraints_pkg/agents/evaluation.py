# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of policies: return, cost and length of fresh episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from occ_constraints_pkg.agents.drivers import check_driver, find_driver
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.training import CostSource, TrueCost
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import EpisodeStream

_MOST_ROBOTS = 64


def half_width(values: np.ndarray) -> float:
    """Half the width of the 95 % confidence interval of the mean, after Student's t.

    Args:
        values: (n,) independent numbers.

    Returns:
        The half width; NaN for fewer than two values.
    """
    n = len(values)
    if n < 2:
        return float('nan')
    return float(stdtrit(n - 1, 0.975) * np.std(values, ddof=1) / np.sqrt(n))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The results of each episode.

    Attributes:
        returns: (E,) float64, undiscounted sum of rewards.
        costs: (E,) float64, sum of costs of the states reached by a step.
        lengths: (E,) int64, steps.
    """

    returns: np.ndarray
    costs: np.ndarray
    lengths: np.ndarray

    def as_dict(self) -> dict[str, float]:
        """Return means and the half widths of their 95 % intervals, flat."""
        return {
            'episodes': len(self.returns),
            'return': float(np.mean(self.returns)),
            'return_ci95': half_width(self.returns),
            'cost': float(np.mean(self.costs)),
            'cost_ci95': half_width(self.costs),
            'length': float(np.mean(self.lengths)),
        }


def evaluate(
    world: World,
    act: Callable[[np.ndarray], np.ndarray],
    *,
    episodes: int,
    seed: int,
    cost_source: CostSource | None = None,
) -> Evaluation:
    """Run fresh episodes and sum up reward and cost.

    The first episodes of every robot count, equally many per robot (one more for the first robots
    if the number does not divide): counting those that end first would favour short ones.

    Args:
        world: the task.
        act: maps an observation (N, k) to an action (N, a), for example ``policy.act``.
        episodes: number of episodes E, at least 1.
        seed: of the world's generators.
        cost_source: returns the cost of each state; ``None`` for the cost of the world.

    Raises:
        ConfigurationError: ``episodes`` is below 1.
    """
    if episodes < 1:
        raise ConfigurationError(f'evaluation got episodes = {episodes}; allowed is 1 or more')
    cost_source = cost_source or TrueCost()
    n = world.num_envs
    robot = np.arange(n)
    returns, costs = np.zeros(episodes), np.zeros(episodes)
    lengths = np.zeros(episodes, dtype=np.int64)
    finished = np.zeros(episodes, dtype=bool)
    stream = EpisodeStream(world, seed=seed)
    batch = stream.reset()
    cost_source(batch)
    while not finished.all():
        was_done = batch.done
        batch = stream.step(act(batch.observation))
        cost = cost_source(batch)
        slot = batch.episode * n + robot
        real = ~was_done & (slot < episodes)
        slot = slot[real]
        returns[slot] += batch.reward[real]
        costs[slot] += cost[real]
        lengths[slot] += 1
        finished[slot] = batch.done[real]
    return Evaluation(returns, costs, lengths)


def evaluate_driver(
    name: str,
    world: str,
    *,
    episodes: int,
    seed: int,
    explore: bool = False,
    constraints: Constraints | None = None,
) -> Evaluation:
    """Run fresh episodes of a world with a policy or a scripted driver.

    Args:
        name: the driver, see :func:`~occ_constraints_pkg.agents.drivers.find_driver`.
        world: name of the world.
        episodes: number of episodes, at least 1.
        seed: of the world and of the driver's random choices.
        explore: sample the actions of a trained policy instead of taking their mean.
        constraints: rules that define the cost; ``None`` for the cost of the world.

    Raises:
        ConfigurationError: ``episodes`` is below 1, there is no such driver, or the policy or the
            rules do not belong to the world.
    """
    check_driver(world, name)
    simulated = make_world(world, max(1, min(episodes, _MOST_ROBOTS)))
    try:
        driver = find_driver(simulated, name, np.random.default_rng(seed), explore=explore)
        return evaluate(
            simulated,
            driver,
            episodes=episodes,
            seed=seed,
            cost_source=None if constraints is None else RuleCost(constraints, simulated),
        )
    finally:
        simulated.close()


def over_policies(evaluations: Sequence[Mapping[str, float]]) -> dict[str, float | None]:
    """Return the mean return and cost of several policies with 95 % intervals over policies.

    Args:
        evaluations: :meth:`Evaluation.as_dict` of each.
    """
    summary: dict[str, float | None] = {'policies_evaluated': len(evaluations)}
    for name in ('return', 'cost'):
        values = np.array([item[name] for item in evaluations])
        half = half_width(values)
        summary[name] = float(values.mean())
        summary[f'{name}_ci95'] = half if np.isfinite(half) else None
    return summary
