# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A training in one process, from settings to files, as in ``occ train``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.settings import (
    AFTER_CLONING,
    PPOLagrangianConfig,
    TrainingMetrics,
    learner_settings,
)
from occ_constraints_pkg.agents.training import CostSource, TrainingDirectory, TrueCost, train
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.worlds.registry import make_world, world_class

if TYPE_CHECKING:
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

_DEMONSTRATIONS = 'demonstrations'


@dataclass(frozen=True)
class RunSettings:
    """The settings of a training.

    Attributes:
        world: name of the world.
        cost: ``true`` for the cost of the world, ``none`` for unconstrained training, else a
            constraints file.
        cost_limit: allowed mean cost per episode, or ``demonstrations``: see :func:`cost_limit`.
        steps: robot steps after which it ends; at least one update.
        robots: robots simulated at once.
        seed: of the world, of weights, exploration and minibatches.
        device: where updates are computed, ``cpu`` or ``cuda``.
        processes: processes that step the world, this one included; 0: one per core.
        learner: settings of the learner that differ from the defaults, by name.
        cloned: whether the policy is first cloned from demonstrations, which has other defaults.
    """

    world: str
    cost: str = 'true'
    cost_limit: float | str = 25.0
    steps: int = 1_000_000
    robots: int = 64
    seed: int = 0
    device: str = 'cpu'
    processes: int = 0
    learner: Mapping[str, Any] = field(default_factory=dict)
    cloned: bool = False


@dataclass(frozen=True)
class RunResult:
    """The state of a training at its end.

    Attributes:
        learner: the learner.
        cost_limit: the limit as a number.
        history: the metrics of all updates, including those before a resumption.
    """

    learner: PPOLagrangian
    cost_limit: float
    history: list[dict[str, float]]


def cost_limit(given: float | str, constraints: Constraints | None) -> float:
    """Return the allowed mean cost per episode as a number.

    Args:
        given: a number, or ``demonstrations`` for the mean cost per episode of the demonstrations
            under the rules learned from them.
        constraints: the rules that define the cost; ``None`` for another cost.

    Raises:
        ConfigurationError: ``demonstrations`` without rules, or with a file without their cost.
    """
    if given != _DEMONSTRATIONS:
        return float(given)
    if constraints is None:
        raise ConfigurationError(
            f'the cost limit is {given!r}, but no rules were learned from demonstrations here; '
            'allowed is a number, or a constraints file as cost'
        )
    limit = constraints.coverage.get('cost_per_episode')
    if limit is None:
        raise ConfigurationError(
            f'the cost limit is {given!r}, but the constraints file has no '
            'coverage.cost_per_episode; allowed is a number, or a file written by occ learn'
        )
    return float(limit)


def check(settings: RunSettings) -> float:
    """Refuse settings that no training could start with; return the cost limit as a number.

    Raises:
        ConfigurationError: a setting is wrong.
    """
    from occ_constraints_pkg.agents.ppo_lagrangian import torch_device

    torch_device(settings.device)
    kind = world_class(settings.world)
    constraints = _constraints(settings)
    if constraints is not None:
        RuleCost(constraints, kind)
    return _config(settings, constraints).cost_limit


def run(
    settings: RunSettings,
    output: str | Path,
    *,
    resume: bool = False,
    demonstrated: Callable[[], tuple[np.ndarray, np.ndarray]] | None = None,
    progress: Callable[[TrainingMetrics], None] | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda sentence: None,
) -> RunResult:
    """Train a policy.

    Args:
        settings: what to train.
        output: directory for policy, metrics, checkpoint and counted rules.
        resume: continue from the checkpoint there, if there is one, exactly as if the training had
            not been interrupted; ``steps``, ``device`` and ``processes`` may differ.
        demonstrated: returns the observations and actions that a new policy is cloned from; needed
            exactly where ``settings.cloned``.
        progress: called after each update.
        is_stopped: called before each step; ``True`` saves and ends the training.
        say: called with messages for the user.

    Raises:
        ConfigurationError: a setting is wrong, or does not fit the training to resume.
    """
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

    constraints = _constraints(settings)
    config = _config(settings, constraints)
    limit = config.cost_limit
    world = make_world(settings.world, settings.robots, processes=settings.processes)
    try:
        source: CostSource = TrueCost() if constraints is None else RuleCost(constraints, world)
        directory = TrainingDirectory(output, _fixed(settings, constraints, limit))
        inputs = [] if constraints is None else [settings.cost]
        resumed = None
        if resume and directory.has_checkpoint:
            directory.keep_apart(inputs)
            learner, resumed = directory.resume(device=settings.device, decay_steps=settings.steps)
            say(f'resumed at {learner.steps} steps')
        else:
            learner = PPOLagrangian(
                config, world.columns, world.action_columns, world.name, settings.seed
            )
            if resume:
                say(f'there is no checkpoint in {output}, so training starts anew')
            earlier = directory.begin()
            if earlier:
                say(f'an earlier training is now in {earlier}')
            if demonstrated is not None:
                observations, actions = demonstrated()
                error = learner.clone(observations, actions)
                say(
                    f'the policy is cloned from {len(actions)} demonstrated actions, '
                    f'mean squared error {error:.3f}'
                )
        train(
            world,
            learner,
            source,
            seed=settings.seed,
            total_steps=settings.steps,
            progress=progress,
            directory=directory,
            resumed=resumed,
            is_stopped=is_stopped,
        )
    finally:
        world.close()
    return RunResult(learner, limit, directory.history())


def _constraints(settings: RunSettings) -> Constraints | None:
    return None if settings.cost in ('true', 'none') else load_constraints(settings.cost)


def _config(settings: RunSettings, constraints: Constraints | None) -> PPOLagrangianConfig:
    chosen = {
        'cost_limit': cost_limit(settings.cost_limit, constraints),
        'lagrangian': settings.cost != 'none',
        'decay_steps': settings.steps,
        'device': settings.device,
    }
    for name in settings.learner:
        if name in chosen:
            raise ConfigurationError(
                f'learner setting {name} is not set by itself here: it follows from the cost, cost '
                'limit, steps or device of the training; allowed is to give that'
            )
    defaults = AFTER_CLONING if settings.cloned else {}
    config = learner_settings({**defaults, **settings.learner, **chosen})
    config.check_steps('steps', settings.steps, settings.robots)
    return config


def _fixed(settings: RunSettings, constraints: Constraints | None, limit: float) -> dict[str, Any]:
    """Return the settings that a resumed training must share."""
    fixed = {**asdict(settings), 'cost_limit': limit}
    for free in ('steps', 'device', 'processes'):
        del fixed[free]
    # A file may be moved; its rules may not change.
    if constraints is not None:
        fixed['cost'] = f'rule set {constraints.rule_set.fingerprint}'
    return fixed
