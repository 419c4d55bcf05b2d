# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Runs that train a policy, by whatever cost, and judge it by the true one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.checkpoint import read_checkpoint, write_checkpoint
from occ_constraints_pkg.agents.evaluation import evaluate_driver
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.run import cost_limit
from occ_constraints_pkg.agents.settings import TrainingMetrics, learner_settings
from occ_constraints_pkg.agents.training import (
    CostSource,
    TrainingDirectory,
    TrueCost,
    read_metrics,
    train,
)
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.files import RESULTS, write_text
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.worlds.registry import make_world
from occ_constraints_pkg.worlds.stream import StepBatch

from experiments.baselines import HULL, STATIC, Flags, HullOfMeans
from experiments.inverse_learning import LEARNERS, Episodes, MCEStyle
from experiments.paper.demonstrations import RULES, demonstrated
from experiments.paper.stopping import StoppedError, is_stopped
from experiments.paper.watched import Reward, WatchedWorld
from experiments.states import demonstrate

EXPERT, FREE, OURS = 'expert', 'RL', 'ours'
METHODS = (EXPERT, FREE, OURS, *LEARNERS, *STATIC, HULL)
"""By which cost a policy can be trained."""

_EVALUATION_SEED = 30_000
_CURVE_POINTS = 100
# Improvements of a cost that is learned by training, and the most episodes for each.
_IMPROVEMENTS, _MOST_ROLLOUTS = 30, 32
# Weight of the entropy in the reward of maximum causal entropy.
_ENTROPY = 1e-3


def train_policy(
    folder: Path,
    needs: Mapping[str, Path],
    *,
    target: str,
    method: str,
    seed: int,
    steps: int,
    robots: int,
    episodes: int,
    limit: float | None = None,
    **_: Any,
) -> dict[str, Any]:
    """Train a policy, or go on with its training, and judge it.

    Args:
        folder: of the run; its ``training`` is as after ``occ train``.
        needs: ``rules``, a run that has written rules and, for methods that are not ``ours``,
            demonstrations.
        target: world of the training.
        method: of :data:`METHODS`.
        seed: of the training.
        steps: robot steps.
        robots: simulated at once.
        episodes: fresh episodes over which the policy is judged.
        limit: cost per episode that is allowed; ``None``: as demonstrated.
        **_: what else distinguishes the run: where its rules come from.

    Returns:
        Return and true cost of sampled and of mean actions, the curve of both during training, and
        of ``ours`` the counters of the rules.

    Raises:
        StoppedError: the run is to end; called again, it goes on.
    """
    training = _Training(folder / 'training', target, seed, steps, robots)
    result: dict[str, Any] = {}
    try:
        if method in LEARNERS:
            demonstrations = demonstrated(needs['rules'])
            _train_inversely(training, folder, method, demonstrations, seed, steps)
        else:
            cost = _cost_of(method, needs, training.world, limit)
            result['limit'] = cost.limit
            training.go_on(
                {'lagrangian': method != FREE, 'cost_limit': cost.limit}, cost.source, steps
            )
            if isinstance(cost.source, RuleCost):
                counts = cost.source.counts
                result['counts'] = {
                    rule.id: [int(evaluated), int(violated)]
                    for rule, evaluated, violated in zip(
                        cost.source.constraints.rules,
                        counts.evaluated,
                        counts.violated,
                        strict=True,
                    )
                }
    finally:
        training.close()
    policy = str(folder / 'training' / 'policy.npz')
    for name, explore in (('sampled', True), ('mean', False)):
        judged = evaluate_driver(
            policy, target, episodes=episodes, seed=_EVALUATION_SEED, explore=explore
        )
        result[name] = {key: _rounded(value) for key, value in judged.as_dict().items()}
    result['curve'], result['seconds'] = training.curve()
    return result


def _rounded(value: float) -> float | int | None:
    if isinstance(value, int):
        return value
    return round(value, 4) if math.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class _Cost:
    """A cost that does not change during training.

    Attributes:
        source: returns the cost of each state.
        limit: mean cost per episode that is allowed.
    """

    source: CostSource
    limit: float


def _cost_of(
    method: str, needs: Mapping[str, Path], world: WatchedWorld, limit: float | None
) -> _Cost:
    if method in (EXPERT, FREE):
        return _Cost(TrueCost(), 25.0 if limit is None else limit)
    if method == OURS:
        constraints = load_constraints(needs['rules'] / RULES)
        given = 'demonstrations' if limit is None else limit
        return _Cost(RuleCost(constraints, world), cost_limit(given, constraints))
    demonstrations = demonstrated(needs['rules'])
    values, episodes = demonstrations.values, demonstrations.episodes
    places = feature_places(world)
    if method == HULL:
        hull = HullOfMeans.of(values, episodes)
        flagged = hull.flags(values, episodes)
        source: CostSource = _HullCost(hull, world, places)
    else:
        flags = STATIC[method](values)
        flagged = flags(values)
        source = _FlagCost(flags, places)
    shown = flagged.sum() / len(np.unique(episodes))
    return _Cost(source, float(shown) if limit is None else limit)


def feature_places(world: WatchedWorld) -> list[int]:
    """Return the columns of a world's observation that its feature map names, in its order."""
    names = [column.name for column in world.columns]
    return [names.index(str(source.column)) for source in load_feature_map(world.name).features]


class _FlagCost:
    """Costs 1 where a state is flagged."""

    def __init__(self, flags: Flags, places: list[int]) -> None:
        self._flags, self._places = flags, places

    def __call__(self, batch: StepBatch) -> np.ndarray:
        return self._flags(batch.observation[:, self._places].astype(np.float64)).astype(float)


class _HullCost:
    """Costs 1 while the mean of an episode so far lies outside the hull."""

    def __init__(self, hull: HullOfMeans, world: WatchedWorld, places: list[int]) -> None:
        self._hull, self._world, self._places = hull, world, places

    def __call__(self, _batch: StepBatch) -> np.ndarray:
        return self._hull.outside(self._world.observation_means[:, self._places]).astype(float)


class _LearnedCost:
    """The cost of a learner that has states of its own."""

    def __init__(self, learner: Any, places: list[int]) -> None:
        self._learner, self._places = learner, places

    def __call__(self, batch: StepBatch) -> np.ndarray:
        return self._learner.cost(batch.observation[:, self._places])


class _Training:
    """A training whose true cost is watched; it goes on from its checkpoint."""

    def __init__(self, path: Path, target: str, seed: int, steps: int, robots: int) -> None:
        self.path, self.target, self.seed, self._steps = path, target, seed, steps
        config = learner_settings({})
        config.check_steps('steps', steps, robots)
        self.rollout = config.rollout_steps * robots
        self.world = WatchedWorld(make_world(target, robots, processes=1))
        self._log = path.parent / 'watched.jsonl'

    def go_on(
        self,
        settings: Mapping[str, Any],
        source: CostSource,
        until: int,
        reward: Any = None,
    ) -> None:
        """Train until so many robot steps have been made since the beginning.

        Args:
            settings: of the learner.
            source: the cost.
            until: robot steps.
            reward: makes what the learner is given as reward, from the learner; None: the world's.

        Raises:
            StoppedError: the run is to end; all is saved.
        """
        directory = TrainingDirectory(self.path, {'world': self.target, 'seed': self.seed})
        resumed = None
        if directory.has_checkpoint:
            learner, resumed = directory.resume(decay_steps=self._steps)
            kept = [x for x in read_metrics(self._log) if x['updates'] <= learner.updates]
            write_text(self._log, RESULTS, ''.join(json.dumps(line) + '\n' for line in kept))
        else:
            config = learner_settings({**settings, 'decay_steps': self._steps})
            world = self.world
            learner = PPOLagrangian(
                config, world.columns, world.action_columns, world.name, self.seed
            )
            directory.begin()
            self._log.unlink(missing_ok=True)
        self.world.reward = None if reward is None else reward(learner)
        train(
            self.world,
            learner,
            source,
            seed=self.seed,
            total_steps=until,
            progress=self._note,
            directory=directory,
            resumed=resumed,
            is_stopped=is_stopped,
        )
        if learner.steps < until:
            raise StoppedError

    def _note(self, metrics: TrainingMetrics) -> None:
        """Append what was counted until an update."""
        line = {'updates': metrics.updates, 'steps': metrics.steps}
        recent = self.world.recent()
        if recent is not None:
            line |= {'return': round(recent[0], 3), 'cost': round(recent[1], 3)}
        with self._log.open('a', encoding='utf-8') as file:
            file.write(json.dumps(line) + '\n')

    def curve(self) -> tuple[dict[str, list[float]], float]:
        """Return return, true cost and multiplier over steps, and the seconds of the training."""
        watched = {x['updates']: x for x in read_metrics(self._log) if 'return' in x}
        metrics = read_metrics(self.path / 'metrics.jsonl')
        seconds, before = 0.0, 0
        for line in metrics:
            seconds += (line['steps'] - before) / line['steps_per_s'] if line['steps_per_s'] else 0
            before = line['steps']
        multipliers = {line['updates']: line['multiplier'] for line in metrics}
        kept = sorted(watched.keys() & multipliers.keys())
        if len(kept) > _CURVE_POINTS:
            kept = [kept[n] for n in np.linspace(0, len(kept) - 1, _CURVE_POINTS).astype(int)]
        return {
            'steps': [watched[n]['steps'] for n in kept],
            'return': [watched[n]['return'] for n in kept],
            'cost': [watched[n]['cost'] for n in kept],
            'multiplier': [round(multipliers[n], 4) for n in kept],
        }, seconds

    def close(self) -> None:
        self.world.close()


def _train_inversely(
    training: _Training,
    folder: Path,
    method: str,
    demonstrations: Episodes,
    seed: int,
    steps: int,
) -> None:
    """Alternate between training under a cost and improving it with episodes of the policy.

    The cost is saved after each improvement, with the number of steps after which the next one is
    due, so a run that was cut goes on with the cost that the training had.
    """
    learner = LEARNERS[method](demonstrations, seed)
    saved = folder / 'cost.pt'
    # At least one update between two improvements.
    forward = max(steps // _IMPROVEMENTS, training.rollout)
    rollouts = min(_MOST_ROLLOUTS, len(np.unique(demonstrations.episodes)))
    due = min(forward, steps)
    if saved.exists():
        state = read_checkpoint(saved)
        due = state['due']
        learner.restore(state['cost'])
    places = feature_places(training.world)
    source: CostSource
    if isinstance(learner, MCEStyle):
        settings: dict[str, Any] = {'lagrangian': False}
        source = TrueCost()

        def reward(agent: PPOLagrangian) -> Reward:
            return _entropic_reward(agent, learner, places)
    else:
        # As in the article: nothing is allowed, and the multiplier starts at 1.
        settings = {'cost_limit': 0.0, 'multiplier_init': 1.0}
        source, reward = _LearnedCost(learner, places), None
    while True:
        training.go_on(settings, source, due, reward)
        if due >= steps:
            return
        policy = str(training.path / 'policy.npz')
        learner.improve(Episodes(*demonstrate(training.target, policy, rollouts, seed=seed + due)))
        due = min(due + forward, steps)
        write_checkpoint(saved, {'due': due, 'cost': learner.state()})


def _entropic_reward(agent: PPOLagrangian, learner: MCEStyle, places: list[int]) -> Reward:
    """Return the reward less the learned cost and the logarithm of the action's probability."""
    policy: GaussianPolicy | None = None
    updates = -1

    def reward(
        before: np.ndarray, action: np.ndarray, after: np.ndarray, given: np.ndarray
    ) -> np.ndarray:
        nonlocal policy, updates
        if policy is None or updates != agent.updates:
            policy, updates = agent.policy(), agent.updates
        z = (action - policy.act(before)) * np.exp(-policy.log_std)
        log_density = -(0.5 * z**2 + policy.log_std + 0.5 * np.log(2 * np.pi)).sum(axis=1)
        return given - learner.cost(after[:, places]) - _ENTROPY * log_density

    return reward
