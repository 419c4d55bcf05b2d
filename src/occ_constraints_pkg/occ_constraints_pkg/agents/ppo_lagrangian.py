# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""PPO with a Lagrange multiplier on the cost of an episode, fed one step of many robots at a time.

The objective is to maximise the expected return subject to an expected cost per episode of at most
``cost_limit`` (Ray, Achiam and Amodei 2019, section 5.1; PPO: Schulman et al. 2017; advantages:
Schulman et al. 2016). The learner neither steps a world nor computes a cost: its caller passes in
both, so the same class serves a plain loop and a ROS node.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from occ_constraints_pkg.agents.checkpoint import read_checkpoint, with_arrays, write_checkpoint
from occ_constraints_pkg.agents.policy import GaussianPolicy, column_names
from occ_constraints_pkg.agents.rollout import (
    Episodes,
    Normaliser,
    Rollout,
    advantages,
    checked_cost,
)
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig, TrainingMetrics
from occ_constraints_pkg.archives import describe
from occ_constraints_pkg.errors import ConfigurationError, DataError, OccError
from occ_constraints_pkg.worlds.base import Column
from occ_constraints_pkg.worlds.stream import StepBatch

# Behaviour cloning: passes over the demonstrations, and more until there are enough steps; samples
# of a step, and its rate at the start.
_CLONING_PASSES, _CLONING_STEPS, _CLONING_BATCH, _CLONING_RATE = 20, 1000, 256, 2e-3


class Multiplier:
    """A proportional-integral controller (Stooke, Achiam and Abbeel 2020), bounded in both parts.

    It follows the cost of an episode of the present policy, which is not that of the episodes that
    have just ended: most of their steps were made by earlier policies. The cost per step of each
    rollout, times the length of an episode, is known at once; a mean over the latest rollouts takes
    out its noise.

    The excess of that cost over its limit counts in units of ``multiplier_band`` times the limit
    (of ``multiplier_band`` where the limit is below 1), clipped to 1 unit. A cost far above its
    limit, as at the start of training, thus raises the multiplier slowly enough for the reward to
    be learned at the same time, while the response to a cost near its limit is proportional.

    Attributes:
        integral: the integral part, 0 or more.
        value: the multiplier, 0 or more.
        cost: the mean cost per episode that it follows; NaN before the first.
    """

    def __init__(self, config: PPOLagrangianConfig) -> None:
        """Start with the integral alone, at ``multiplier_init``."""
        self._limit, self._rate = config.cost_limit, config.multiplier_rate
        self._gain, self._memory = config.multiplier_gain, config.cost_memory
        self._unit = config.multiplier_band * max(config.cost_limit, 1.0)
        self.integral = self.value = config.multiplier_init
        self.cost = math.nan

    def update(self, cost: float, episodes: float) -> None:
        """Follow the cost of a rollout.

        Args:
            cost: its mean cost per step times the mean length of an episode; NaN (no episode has
                ended yet) changes nothing.
            episodes: of how many episodes of that length its steps would be enough for.
        """
        if math.isnan(cost):
            return
        if math.isnan(self.cost):
            self.cost = cost
        self.cost += (1.0 - math.exp(-episodes / self._memory)) * (cost - self.cost)
        excess = min(1.0, max(-1.0, (self.cost - self._limit) / self._unit))
        self.integral = max(0.0, self.integral + self._rate * excess)
        self.value = max(0.0, self.integral + self._gain * excess)

    def state(self) -> list[float]:
        """Return everything needed to continue."""
        known = [] if math.isnan(self.cost) else [self.cost]
        return [self.integral, self.value, *known]

    def restore(self, state: Sequence[float]) -> None:
        """Continue from a state; an early one, or that of older checkpoints, has no mean cost."""
        self.integral, self.value, *cost = state
        self.cost = cost[0] if cost else math.nan


def penalised(advantage: np.ndarray, cost: np.ndarray, multiplier: float) -> np.ndarray:
    """Return the advantage of reward and cost together, on one scale whatever the multiplier.

    Args:
        advantage: (n,) of the reward; counts in units of its standard deviation.
        cost: (n,) of the cost. It is not normalised: that would inflate a rare cost to the scale
            of the reward.
        multiplier: the price of the cost, 0 or more.

    Returns:
        (n,) of mean 0.
    """
    gain = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    return (gain - multiplier * (cost - cost.mean())) / (1.0 + multiplier)


def torch_device(name: str) -> torch.device:
    """Return the device.

    Args:
        name: ``cpu`` or ``cuda``.

    Raises:
        ConfigurationError: this machine does not have it.
    """
    if name not in ('cpu', 'cuda') or (name == 'cuda' and not torch.cuda.is_available()):
        here = 'cpu, cuda' if torch.cuda.is_available() else 'cpu'
        raise ConfigurationError(f'learner setting device is {name!r}; this machine has {here}')
    return torch.device(name)


def _mlp(widths: Sequence[int], last_gain: float, rng: np.random.Generator) -> nn.Sequential:
    """Return a tanh network with orthogonal weights and zero biases.

    Args:
        widths: of the input, the hidden layers and the output.
        last_gain: scale of the last layer's weights.
        rng: draws the weights.
    """
    layers: list[nn.Module] = []
    for inputs, outputs in zip(widths[:-1], widths[1:], strict=True):
        layer = nn.Linear(inputs, outputs)
        gain = last_gain if len(layers) == 2 * (len(widths) - 2) else math.sqrt(2.0)
        square = rng.standard_normal((max(inputs, outputs), min(inputs, outputs)))
        basis, triangle = np.linalg.qr(square)
        basis = basis * np.sign(np.diag(triangle))
        weight = gain * (basis if outputs >= inputs else basis.T)
        with torch.no_grad():
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.zero_()
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def _log_probability(
    action: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor
) -> torch.Tensor:
    """Return the log density of a diagonal Gaussian, (rows,)."""
    z = (action - mean) * torch.exp(-log_std)
    return (-0.5 * z.square() - log_std - 0.5 * math.log(2.0 * math.pi)).sum(dim=1)


def _kl_divergence(
    mean: torch.Tensor, log_std: torch.Tensor, other: torch.Tensor, other_log_std: torch.Tensor
) -> torch.Tensor:
    """Return the mean over rows of KL(first || other) of two diagonal Gaussians, a scalar."""
    spread = torch.exp(2.0 * (log_std - other_log_std))
    shift = ((mean - other) * torch.exp(-other_log_std)).square()
    return (other_log_std - log_std + 0.5 * (spread + shift - 1.0)).sum(dim=1).mean()


def _to_numpy(tensor: torch.Tensor) -> np.ndarray:
    """Return a copy on the CPU that later optimiser steps do not change."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy()).copy()


class _TrainingData(NamedTuple):
    """A batch of n transitions.

    Attributes:
        observation: (n, k) as the networks see them.
        action: (n, a) that was taken.
        advantage: (n,) of reward and cost together.
        target: (n,) regression target of the critic.
        cost_target: (n,) regression target of the cost critic.
    """

    observation: torch.Tensor
    action: torch.Tensor
    advantage: torch.Tensor
    target: torch.Tensor
    cost_target: torch.Tensor


def _improve(
    networks: nn.ModuleDict,
    optimiser: torch.optim.Optimizer,
    data: _TrainingData,
    config: PPOLagrangianConfig,
    rng: np.random.Generator,
    *,
    learns_actor: bool = True,
) -> dict[str, Any]:
    """Run the gradient steps of one update: clipped surrogate, squared errors for both critics.

    Epochs over the batch end once the KL divergence from the old policy exceeds ``target_kl``.

    Args:
        networks: ``actor`` with its ``log_std``, ``critic`` and ``cost_critic``.
        optimiser: of all their parameters.
        data: what to learn from.
        config: the settings.
        rng: shuffles the minibatches.
        learns_actor: whether the policy changes; else only the critics do.

    Returns:
        Means over the last epoch, and the number of epochs; see ``TrainingMetrics``.

    Raises:
        ConfigurationError: the weights are no longer finite.
    """
    actor, critic, cost_critic = (networks[name] for name in ('actor', 'critic', 'cost_critic'))
    observation, action, advantage, target, cost_target = data
    rows, device = len(observation), observation.device
    log_std = actor.get_parameter('log_std')
    with torch.no_grad():
        old_mean = actor(observation)
        old_log_std = log_std.clone()
        old_log_prob = _log_probability(action, old_mean, old_log_std)
    epochs, moved = 0, False
    while epochs < config.passes and not moved:
        order = torch.from_numpy(rng.permutation(rows)).to(device)
        sums = torch.zeros(4, device=device)
        for index in torch.split(order, config.minibatch):
            x = observation[index]
            mean = actor(x)
            ratio = torch.exp(_log_probability(action[index], mean, log_std) - old_log_prob[index])
            clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
            gain = advantage[index]
            policy_loss = -torch.min(ratio * gain, clipped * gain).mean()
            value_loss = (critic(x)[:, 0] - target[index]).square().mean()
            cost_loss = (cost_critic(x)[:, 0] - cost_target[index]).square().mean()
            optimiser.zero_grad()
            loss = value_loss + cost_loss
            (loss + policy_loss if learns_actor else loss).backward()
            for network in networks.values():
                nn.utils.clip_grad_norm_(network.parameters(), config.max_grad_norm)
            optimiser.step()
            with torch.no_grad():
                kl = _kl_divergence(old_mean[index], old_log_std, mean, log_std)
                figures = torch.stack([kl, policy_loss, value_loss, cost_loss])
                sums += figures * (len(index) / rows)
        epochs += 1
        moved = bool(sums[0] > config.target_kl)
    if not all(weights.isfinite().all() for weights in networks.parameters()):
        raise ConfigurationError(
            'training has diverged: weights of the networks are no longer finite; allowed are '
            f'smaller learning rates than actor_lr {config.actor_lr:g} and critic_lr '
            f'{config.critic_lr:g}, or rewards and costs of a smaller size'
        )
    kl, policy_loss, value_loss, cost_value_loss = sums.tolist()
    log_std_sum = log_std.sum().item()
    return {
        'kl': kl,
        'passes': epochs,
        'entropy': log_std_sum + 0.5 * action.shape[1] * math.log(2.0 * math.pi * math.e),
        'policy_loss': policy_loss,
        'value_loss': value_loss,
        'cost_value_loss': cost_value_loss,
    }


# Share of the initial learning rate that remains at the end of its decay, and after it.
_MIN_LEARNING_RATE = 0.1


class PPOLagrangian:
    """The learner: pass it each step of a stream, and it returns the next action.

    Attributes:
        config: its settings.
        columns: names of the observation columns.
        action_columns: names of the action columns.
        world_name: the world that its policies belong to.
        steps: transitions learned from or collected, summed over robots.
        updates: updates made.
        metrics: of the last update; ``None`` before the first.
        time_share: share of the training's wall time that is over, from 0 to 1, where that ends it:
            schedules follow this or the share of steps, whichever is larger.
    """

    def __init__(
        self,
        config: PPOLagrangianConfig,
        columns: Sequence[Column | str],
        action_columns: Sequence[Column | str],
        world_name: str,
        seed: int,
    ) -> None:
        """Make a learner with fresh networks.

        Args:
            config: the settings.
            columns: the observation's columns.
            action_columns: the action's columns.
            world_name: stored in policy files.
            seed: of the networks' first weights, of exploration and of minibatches.

        Raises:
            ConfigurationError: this machine does not have the device.
        """
        self.config = config
        self.columns = column_names(columns)
        self.action_columns = column_names(action_columns)
        self.world_name = world_name
        self.steps = 0
        self.updates = 0
        self.metrics: TrainingMetrics | None = None
        self.time_share = 0.0
        # The only source of randomness, so that a checkpoint holds no other generator's state and
        # CPU and GPU draw the same numbers.
        self._rng = np.random.default_rng(seed)
        self._device = torch_device(config.device)
        torch.set_num_threads(config.threads)
        k, a = len(self.columns), len(self.action_columns)
        self._actor = _mlp((k, *config.hidden, a), 0.01, self._rng)
        self._critic = _mlp((k, *config.hidden, 1), 1.0, self._rng)
        self._cost_critic = _mlp((k, *config.hidden, 1), 1.0, self._rng)
        self._actor.register_parameter(
            'log_std', nn.Parameter(torch.full((a,), float(config.log_std_init)))
        )
        self._networks = nn.ModuleDict(
            {'actor': self._actor, 'critic': self._critic, 'cost_critic': self._cost_critic}
        ).to(self._device)
        critics = [*self._critic.parameters(), *self._cost_critic.parameters()]
        self._optimiser = torch.optim.Adam(
            [
                {'params': list(self._actor.parameters()), 'lr': config.actor_lr},
                {'params': critics, 'lr': config.critic_lr},
            ],
            fused=True,
        )
        self._multiplier = Multiplier(config)
        self._normaliser = Normaliser(k)
        self._policy = self.policy()
        self._rollout: Rollout | None = None
        self._episodes: Episodes | None = None
        self._open, self._begins_whole = False, True
        self._last_done: np.ndarray | None = None
        self._chosen: tuple[StepBatch, np.ndarray] | None = None
        self._clock, self._steps_then = time.perf_counter(), 0

    def choose(self, batch: StepBatch) -> None:
        """Choose the next action before the cost of ``batch`` is known.

        Does nothing if an update comes first. :meth:`act` returns the same actions either way.
        """
        rollout = self._rollout
        if rollout is not None and rollout.filled + self._open < self.config.rollout_steps:
            self._chosen = batch, self._policy.act(batch.observation, self._rng)

    def act(self, batch: StepBatch, cost: np.ndarray) -> np.ndarray:
        """Learn what the last action led to, and choose the next.

        Updates the policy first when the rollout is full. A call that raises changes nothing.

        Args:
            batch: the states just reached, the successors of those of the call before unless
                :meth:`interrupt` came between.
            cost: (N,) cost of those states, 0 or 1 (ignored where a state is the first of its
                episode, which no step led to).

        Returns:
            (N, a) float32 actions.

        Raises:
            DataError: another number of robots or columns than before, or a number that is not
                finite: a missing cost is never taken for 0.
        """
        robots = None if self._rollout is None else self._rollout.reward.shape[1]
        cost = checked_cost(batch, cost, robots, len(self.columns))
        if self._rollout is None:
            self._allocate(len(cost))
        rollout, _ = self._buffers()
        if self._open:
            self._close(batch, cost)
        if rollout.filled == self.config.rollout_steps:
            rollout.observation[-1] = batch.observation
            self._update()
        t = rollout.filled
        if self._chosen is not None and self._chosen[0] is batch:
            action = self._chosen[1]
        else:
            action = self._policy.act(batch.observation, self._rng)
        self._chosen = None
        rollout.observation[t] = batch.observation
        rollout.action[t] = action
        self._last_done = batch.done
        self._open = True
        return action

    def clone(self, observations: np.ndarray, actions: np.ndarray) -> float:
        """Learn to act as demonstrated, by behaviour cloning, before anything else is learned.

        The mean of the policy is fitted to the actions by least squares; its noise stays as it is.

        Args:
            observations: (n, k) demonstrated states, at least one.
            actions: (n, a) what was done in them; clipped to the range of actions, -1 to 1.

        Returns:
            The mean squared error that is left, per action.

        Raises:
            DataError: the shapes do not fit, or a number is not finite.
            ConfigurationError: the learner has already learned.
        """
        if self.updates or self._rollout is not None:
            raise ConfigurationError(
                'demonstrations can only be cloned before training; allowed is a new learner'
            )
        n, expected = len(observations), (len(self.columns), len(self.action_columns))
        if not n or observations.shape != (n, expected[0]) or actions.shape != (n, expected[1]):
            raise DataError(
                f'demonstrations of shapes {observations.shape} and {actions.shape} cannot be '
                f'cloned; allowed are (n, {expected[0]}) observations and (n, {expected[1]}) '
                'actions, n at least 1'
            )
        if not (np.isfinite(observations).all() and np.isfinite(actions).all()):
            raise DataError('demonstrations hold numbers that are not finite; allowed are others')
        self._normaliser.fold(observations)
        self._policy = self.policy()
        x = self._normalised(np.asarray(observations, dtype=np.float32)).to(self._device)
        y = torch.from_numpy(np.clip(actions, -1.0, 1.0).astype(np.float32)).to(self._device)
        weights = [weight for name, weight in self._actor.named_parameters() if name != 'log_std']
        optimiser = torch.optim.Adam(weights, lr=_CLONING_RATE)
        each = -(-n // _CLONING_BATCH)
        passes = max(_CLONING_PASSES, -(-_CLONING_STEPS // each))
        schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.05, passes * each)
        for _ in range(passes):
            order = torch.from_numpy(self._rng.permutation(n)).to(self._device)
            total = 0.0
            for index in torch.split(order, _CLONING_BATCH):
                loss = (self._actor(x[index]) - y[index]).square().mean()
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                schedule.step()
                total += loss.item() * len(index)
        self._policy = self.policy()
        return total / n

    def interrupt(self, *, new_episodes: bool = True) -> None:
        """Drop the open transition: its successor will not arrive.

        Args:
            new_episodes: the next batch shows first states of episodes (the simulator started
                anew). ``False``: it shows later states of running episodes after missed steps;
                these episodes are learned from but left out of the means.
        """
        if self._open:
            # The state stays in the rollout as the successor of the previous transition.
            rollout, _ = self._buffers()
            rollout.valid[rollout.filled] = False
            rollout.filled += 1
            self._open = False
        self._begins_whole = new_episodes
        if self._episodes is not None:
            self._episodes.sums[:] = 0.0
            self._episodes.whole[:] = new_episodes

    def policy(self) -> GaussianPolicy:
        """Return the policy as it now acts, as plain numbers."""
        layers = [layer for layer in self._actor if isinstance(layer, nn.Linear)]
        return GaussianPolicy(
            world=self.world_name,
            columns=self.columns,
            action_columns=self.action_columns,
            observation_mean=self._normaliser.mean.astype(np.float32),
            observation_variance=self._normaliser.floored_variance.astype(np.float32),
            observation_clip=self.config.observation_clip,
            weights=tuple(_to_numpy(layer.weight.T) for layer in layers),
            biases=tuple(_to_numpy(layer.bias) for layer in layers),
            log_std=_to_numpy(self._actor.get_parameter('log_std')),
        )

    @property
    def multiplier(self) -> float:
        """The Lagrange multiplier, 0 or more."""
        return self._multiplier.value

    def _allocate(self, robots: int) -> None:
        k, a = len(self.columns), len(self.action_columns)
        self._rollout = Rollout(self.config.rollout_steps, robots, k, a)
        self._episodes = Episodes(robots, self.config.window)
        self._episodes.whole[:] = self._begins_whole

    def _buffers(self) -> tuple[Rollout, Episodes]:
        """Return what :meth:`_allocate` has made."""
        assert self._rollout is not None
        assert self._episodes is not None
        return self._rollout, self._episodes

    def _close(self, batch: StepBatch, cost: np.ndarray) -> None:
        """Complete the open transition."""
        rollout, episodes = self._buffers()
        assert self._last_done is not None
        t, valid = rollout.filled, ~self._last_done
        rollout.reward[t] = batch.reward
        rollout.cost[t] = cost
        rollout.terminated[t] = batch.terminated
        rollout.valid[t] = valid
        rollout.filled += 1
        self.steps += int(valid.sum())
        episodes.add(batch.reward, cost, valid, batch.done)
        self._open = False

    def _update(self) -> None:
        """Learn from the full rollout and empty it."""
        self._chosen = None
        config, (rollout, episodes) = self.config, self._buffers()
        if not rollout.valid.any():
            rollout.filled = 0
            return
        started = time.perf_counter()
        mean_return, mean_cost, mean_length = episodes.means()
        cost_rate = float(rollout.cost.mean(where=rollout.valid))
        if config.lagrangian:
            episodes_worth = np.count_nonzero(rollout.valid) / mean_length
            self._multiplier.update(cost_rate * mean_length, episodes_worth)
        # The statistics change between rollouts only. There were none during the first rollout, so
        # its own are used at once; the mean of an untrained policy is about 0 everywhere anyway.
        first = self._normaliser.count == 0
        if first:
            self._normaliser.fold(rollout.observation[:-1])
            self._policy = self.policy()
        progress = self._progress()
        if progress:
            left = max(_MIN_LEARNING_RATE, 1.0 - progress)
            actor, critics = self._optimiser.param_groups
            actor['lr'], critics['lr'] = left * config.actor_lr, left * config.critic_lr
        losses = _improve(
            self._networks,
            self._optimiser,
            self._training_data(),
            config,
            self._rng,
            learns_actor=self.updates >= config.critic_updates,
        )
        if config.log_std_end < config.log_std_init:
            bound = config.log_std_init + progress * (config.log_std_end - config.log_std_init)
            with torch.no_grad():
                self._actor.get_parameter('log_std').clamp_(max=bound)
        if not first:
            self._normaliser.fold(rollout.observation[:-1])
        self._policy = self.policy()
        rollout.filled = 0
        self.updates += 1
        now = time.perf_counter()
        self.metrics = TrainingMetrics(
            steps=self.steps,
            updates=self.updates,
            episodes=episodes.finished,
            mean_return=mean_return,
            mean_cost=mean_cost,
            mean_length=mean_length,
            cost_rate=cost_rate,
            multiplier=self.multiplier if config.lagrangian else 0.0,
            steps_per_s=(self.steps - self._steps_then) / (now - self._clock),
            update_s=now - started,
            **losses,
        )
        self._clock, self._steps_then = now, self.steps

    def _progress(self) -> float:
        """Return the share of the training that is over, from 0 to 1, as far as it is known."""
        steps = self.config.decay_steps
        return min(1.0, max(self.time_share, self.steps / steps if steps else 0.0))

    def _training_data(self) -> _TrainingData:
        """Return the valid transitions with their advantages and targets."""
        config, (rollout, _) = self.config, self._buffers()
        shape = rollout.observation.shape[:2]
        observation = self._normalised(rollout.observation).to(self._device)
        with torch.no_grad():
            values = _to_numpy(self._critic(observation)).reshape(shape)
            cost_values = _to_numpy(self._cost_critic(observation)).reshape(shape)
        valid = rollout.valid
        ends = (rollout.terminated, valid, config.gamma, config.lam)
        estimate = advantages(rollout.reward, values, *ends)[valid]
        cost_estimate = advantages(rollout.cost, cost_values, *ends)[valid]
        advantage = penalised(
            estimate, cost_estimate, self.multiplier if config.lagrangian else 0.0
        )
        action = torch.from_numpy(rollout.action[valid])
        targets = estimate + values[:-1][valid], cost_estimate + cost_values[:-1][valid]
        return _TrainingData(
            observation.reshape(*shape, -1)[:-1][torch.from_numpy(valid).to(self._device)],
            action.to(self._device),
            *(
                torch.from_numpy(x.astype(np.float32)).to(self._device)
                for x in (advantage, *targets)
            ),
        )

    def _normalised(self, observation: np.ndarray) -> torch.Tensor:
        """Return the rows (..., k) as the networks see them, (rows, k)."""
        policy = self._policy
        x = (observation - policy.observation_mean) / np.sqrt(policy.observation_variance)
        np.clip(x, -policy.observation_clip, policy.observation_clip, out=x)
        return torch.from_numpy(x.reshape(-1, x.shape[-1]))

    def save(self, path: Path | str, **companions: Any) -> None:
        """Write everything that an exact continuation needs, replacing the file atomically.

        Args:
            path: the file.
            **companions: what else the caller needs to continue, such as the state of its world:
                nested mappings and lists of numbers, texts and arrays.

        Raises:
            ConfigurationError: it cannot be written; the previous file stays.
        """
        write_checkpoint(path, {'learner': self._state(), 'companions': companions})

    @classmethod
    def load(cls, path: Path | str, **changes: Any) -> PPOLagrangian:
        """Read a checkpoint; nothing in it is executed.

        The learner expects the batch that follows the last one it was given. Call
        :meth:`interrupt` first when another one will come.

        Args:
            path: a file written by :meth:`save`.
            **changes: settings that replace those of the checkpoint, such as ``device``.

        Raises:
            DataError: no such file, or not a checkpoint.
        """
        return cls.load_all(path, **changes)[0]

    @classmethod
    def load_all(cls, path: Path | str, **changes: Any) -> tuple[PPOLagrangian, dict[str, Any]]:
        """Read a checkpoint as :meth:`load` does; return the learner and the companions."""
        document = read_checkpoint(path)
        try:
            state = document['learner']
            # Older checkpoints know no bound on the noise, so theirs goes on without one.
            unbounded = {'log_std_end': state['config']['log_std_init']}
            settings = {**unbounded, **state['config'], **changes}
            settings['hidden'] = tuple(settings['hidden'])
            _check_sizes(settings['hidden'], state)
            learner = cls(
                PPOLagrangianConfig(**settings),
                state['columns'],
                state['action_columns'],
                state['world_name'],
                seed=0,
            )
            learner._restore(state)
            return learner, with_arrays(document['companions'])
        except OccError:
            raise
        except (
            *(ArithmeticError, AttributeError, LookupError, MemoryError),
            *(TypeError, ValueError, RuntimeError),
        ) as error:
            raise DataError(
                f'checkpoint {path} is damaged ({type(error).__name__}: {describe(error)}); '
                'allowed is what a training has saved'
            ) from error

    def _state(self) -> dict[str, Any]:
        """Return everything as nested plain values, arrays and tensors."""
        state: dict[str, Any] = {
            'config': asdict(self.config),
            'columns': list(self.columns),
            'action_columns': list(self.action_columns),
            'world_name': self.world_name,
            'steps': self.steps,
            'updates': self.updates,
            'metrics': None if self.metrics is None else self.metrics.as_dict(),
            'rng': json.dumps(self._rng.bit_generator.state),
            'networks': self._networks.state_dict(),
            'optimiser': self._optimiser.state_dict(),
            'multiplier': self._multiplier.state(),
            'normaliser': vars(self._normaliser),
            'stream': None,
        }
        if self._rollout is not None:
            rollout, episodes = self._buffers()
            state['stream'] = {
                'robots': len(episodes.whole),
                # Right after an update this is next to nothing.
                'rollout': rollout.state(rollout.filled + self._open),
                'episodes': episodes.state(),
                'open': self._open,
                'last_done': self._last_done,
            }
        return state

    def _restore(self, state: dict[str, Any]) -> None:
        """Restore everything but the settings from a checkpoint."""
        self.steps, self.updates = state['steps'], state['updates']
        self._steps_then = self.steps
        if state['metrics'] is not None:
            self.metrics = TrainingMetrics(**state['metrics'])
        self._rng.bit_generator.state = json.loads(state['rng'])
        self._networks.load_state_dict(state['networks'])
        self._optimiser.load_state_dict(state['optimiser'])
        self._multiplier.restore(state['multiplier'])
        vars(self._normaliser).update(with_arrays(state['normaliser']))
        self._policy = self.policy()
        stream = with_arrays(state['stream'])
        if stream is None:
            return
        self._allocate(stream['robots'])
        rollout, episodes = self._buffers()
        rollout.restore(stream['rollout'])
        episodes.restore(stream['episodes'])
        self._open, self._last_done = stream['open'], stream['last_done']


def _check_sizes(hidden: Sequence[int], state: dict[str, Any]) -> None:
    """Refuse hidden layers whose weights the checkpoint does not hold.

    Raises:
        ValueError: a small file describes networks that would fill the memory.
    """
    k, a = len(state['columns']), len(state['action_columns'])
    widths = (k, *hidden, a)
    asked = sum(n * m for n, m in zip(widths[:-1], widths[1:], strict=True))
    held = sum(tensor.untyped_storage().nbytes() for tensor in state['networks'].values())
    if 4 * asked > held:
        raise ValueError(f'hidden layers {hidden} take {4 * asked} bytes, and it holds {held}')
