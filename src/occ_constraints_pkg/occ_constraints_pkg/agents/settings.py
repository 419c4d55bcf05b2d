# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Settings and metrics of the learner; importing them does not need torch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError

# More than this many make torch crash rather than refuse.
_MOST_THREADS = 1024


@dataclass(frozen=True)
class PPOLagrangianConfig:
    """The learner's settings; the defaults suit some 64 to 256 robots on a CPU.

    Attributes:
        lagrangian: ``False`` ignores the cost altogether: unconstrained PPO.
        cost_limit: allowed mean cost per episode, 0 or more.
        multiplier_init: Lagrange multiplier at the start, 0 or more.
        multiplier_rate: change of the multiplier's integral per update and unit of excess.
        multiplier_gain: proportional part of the multiplier per unit of excess.
        multiplier_band: share of the cost limit that makes one unit of excess.
        critic_updates: updates at the start in which the critics learn and the policy stays.
        cost_memory: episodes' worth of latest steps that the multiplier's cost is a mean of.
        rollout_steps: steps of each robot between updates.
        passes: maximum number of epochs over a rollout per update.
        minibatch: transitions per gradient step.
        actor_lr: Adam's learning rate for the policy.
        critic_lr: Adam's learning rate for both critics.
        decay_steps: robot steps of the whole training, over which learning rates fall linearly to a
            tenth and the bound on the noise falls to its end; 0: unknown, all stay as they are.
        gamma: discount per step, of reward and cost alike.
        lam: GAE's lambda, of reward and cost alike.
        clip: bound on the change of the probability ratio.
        target_kl: an update ends after the epoch in which the mean KL divergence of the new policy
            from the old one exceeds this.
        max_grad_norm: bound on the norm of the gradient, for each network separately.
        hidden: width of each hidden tanh layer, of all three networks.
        log_std_init: logarithm of the policy's initial standard deviation.
        log_std_end: an upper bound on this logarithm falls linearly from ``log_std_init`` to this
            value over the training; none where this is not below ``log_std_init``.
        observation_clip: bound on the normalised observation.
        window: number of the latest finished episodes that means are taken over.
        device: where updates are computed, ``cpu`` or ``cuda``; acting always uses the CPU.
        threads: CPU threads of torch, for the whole process. One is fastest whenever other
            processes use the cores: threads wait for one another at every small layer.
    """

    lagrangian: bool = True
    cost_limit: float = 25.0
    multiplier_init: float = 0.001
    multiplier_rate: float = 0.01
    multiplier_gain: float = 1.0
    multiplier_band: float = 1.0 / 3.0
    cost_memory: float = 50.0
    critic_updates: int = 0
    rollout_steps: int = 64
    passes: int = 5
    minibatch: int = 1024
    actor_lr: float = 1e-3
    critic_lr: float = 1e-3
    decay_steps: int = 0
    gamma: float = 0.99
    lam: float = 0.95
    clip: float = 0.2
    target_kl: float = 0.02
    max_grad_norm: float = 1.0
    hidden: tuple[int, ...] = (64, 64)
    log_std_init: float = -0.5
    log_std_end: float = -1.6
    observation_clip: float = 5.0
    window: int = 100
    device: str = 'cpu'
    threads: int = 1

    def __post_init__(self) -> None:
        """Refuse settings outside their range.

        Raises:
            ConfigurationError: the first such setting.
        """
        for name in (
            'cost_limit',
            'multiplier_init',
            'multiplier_rate',
            'multiplier_gain',
            'critic_updates',
            'decay_steps',
        ):
            self._require(name, getattr(self, name) >= 0, '0 or more')
        for name in ('rollout_steps', 'passes', 'minibatch', 'window', 'threads'):
            self._require(name, getattr(self, name) >= 1, '1 or more')
        for name in (
            'actor_lr',
            'critic_lr',
            'clip',
            'target_kl',
            'max_grad_norm',
            'multiplier_band',
            'cost_memory',
            'observation_clip',
        ):
            self._require(name, getattr(self, name) > 0, 'above 0')
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            # An infinite limit allows any cost; the other settings must be finite.
            if isinstance(value, float) and name != 'cost_limit':
                self._require(name, math.isfinite(value), 'a finite number')
        # Beyond, actions overflow.
        for name in ('log_std_init', 'log_std_end'):
            self._require(name, -20 <= getattr(self, name) <= 20, 'from -20 to 20')
        self._require('threads', self.threads <= _MOST_THREADS, f'{_MOST_THREADS} or fewer')
        for name in ('gamma', 'lam'):
            self._require(name, 0 <= getattr(self, name) <= 1, 'from 0 to 1')
        widths = all(type(width) is int and width >= 1 for width in self.hidden)
        self._require('hidden', widths, 'whole numbers of 1 or more')

    def check_steps(self, name: str, steps: int, robots: int) -> None:
        """Refuse a training that would end before the first update.

        Args:
            name: what the caller's users call the number of steps.
            steps: robot steps after which the training ends.
            robots: robots that make them.

        Raises:
            ConfigurationError: these are fewer than one rollout.
        """
        least = self.rollout_steps * robots
        if steps < least:
            raise ConfigurationError(
                f'{name} is {steps}, which ends a training before its first update; allowed is '
                f'{least} or more: rollout_steps {self.rollout_steps} x robots {robots}'
            )

    def _require(self, name: str, holds: bool, allowed: str) -> None:
        if not holds:
            raise ConfigurationError(
                f'learner setting {name} is {getattr(self, name)!r}; allowed is {allowed}'
            )


AFTER_CLONING: Mapping[str, Any] = {
    'multiplier_init': 4.0,
    'multiplier_rate': 0.02,
    'critic_updates': 3,
    'minibatch': 4096,
    'log_std_init': -1.2,
    'log_std_end': -2.0,
}
"""Other defaults for a policy that was cloned from demonstrations before it is trained.

It drives well from the start, so there is little to explore, and a price of the cost that begins
near its final value keeps it from learning to be careless first.
"""


def learner_settings(values: Mapping[str, Any]) -> PPOLagrangianConfig:
    """Return the defaults with some settings changed.

    Args:
        values: settings by name; whole numbers are accepted for floats, lists for tuples.

    Raises:
        ConfigurationError: there is no such setting, or its value has another type or is out of
            range.
    """
    allowed: dict[str, Any] = {item.name: item.default for item in fields(PPOLagrangianConfig)}
    changed: dict[str, Any] = {}
    for name, value in values.items():
        if name not in allowed:
            hint = did_you_mean(name, allowed) or ';'
            raise ConfigurationError(
                f'there is no learner setting {name!r}{hint} there are {", ".join(allowed)}'
            )
        default = allowed[name]
        if isinstance(default, float) and isinstance(value, int):
            value = float(value)
        if isinstance(default, tuple) and isinstance(value, list):
            value = tuple(value)
        if type(value) is not type(default):
            raise ConfigurationError(
                f'learner setting {name} is {value!r}; allowed is something like {default!r}'
            )
        changed[name] = value
    return PPOLagrangianConfig(**changed)


@dataclass(frozen=True)
class TrainingMetrics:
    """State of training after an update; a mean over no episodes is NaN.

    Attributes:
        steps: transitions learned from, summed over robots.
        updates: updates made.
        episodes: episodes finished.
        mean_return: mean undiscounted return of the last ``window`` episodes.
        mean_cost: their mean cost.
        mean_length: their mean number of steps.
        cost_rate: mean cost per step in the rollout just learned from.
        multiplier: the Lagrange multiplier used.
        kl: mean KL divergence of the new policy from the old one, over the last epoch.
        passes: epochs run in this update.
        entropy: of the policy, in nats.
        policy_loss: mean over the last epoch.
        value_loss: mean squared error of the reward critic over the last epoch.
        cost_value_loss: mean squared error of the cost critic over the last epoch.
        steps_per_s: transitions per second of wall time since the update before.
        update_s: seconds that this update took.
    """

    steps: int
    updates: int
    episodes: int
    mean_return: float
    mean_cost: float
    mean_length: float
    cost_rate: float
    multiplier: float
    kl: float
    passes: int
    entropy: float
    policy_loss: float
    value_loss: float
    cost_value_loss: float
    steps_per_s: float
    update_s: float

    def as_dict(self) -> dict[str, float]:
        """Return the metrics by name, in this order."""
        return asdict(self)
