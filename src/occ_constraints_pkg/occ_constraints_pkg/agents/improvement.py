# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gradient steps of one update: PPO's clipped surrogate, and squared errors for the critics."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from occ_constraints_pkg.agents.networks import divergence, log_probability
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.errors import ConfigurationError


class TrainingData(NamedTuple):
    """The transitions to learn from, n of them.

    Attributes:
        observation: (n, k) as the networks see them.
        action: (n, a) that was taken.
        advantage: (n,) of reward and cost together.
        target: (n,) what the critic should have said.
        cost_target: (n,) what the cost critic should have said.
    """

    observation: torch.Tensor
    action: torch.Tensor
    advantage: torch.Tensor
    target: torch.Tensor
    cost_target: torch.Tensor


def improve(
    networks: nn.ModuleDict,
    optimiser: torch.optim.Optimizer,
    data: TrainingData,
    config: PPOLagrangianConfig,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Improve the networks, pass by pass, until the policy has moved far enough.

    Args:
        networks: ``actor`` with its ``log_std``, ``critic`` and ``cost_critic``.
        optimiser: of all their parameters.
        data: what to learn from.
        config: the settings.
        rng: shuffles the minibatches.

    Returns:
        Means over the last pass, and the number of passes; see ``TrainingMetrics``.

    Raises:
        OccError: weights have become infinite, or no numbers at all.
    """
    actor, critic, cost_critic = (networks[name] for name in ('actor', 'critic', 'cost_critic'))
    observation, action, advantage, target, cost_target = data
    rows, device = len(observation), observation.device
    with torch.no_grad():
        old_mean = actor(observation)
        old_log_std = actor.log_std.clone()
        old_log_prob = log_probability(action, old_mean, old_log_std)
    passes, moved = 0, False
    while passes < config.passes and not moved:
        order = torch.from_numpy(rng.permutation(rows)).to(device)
        sums = torch.zeros(4, device=device)
        for index in order.split(config.minibatch):
            x = observation[index]
            mean, log_std = actor(x), actor.log_std
            ratio = torch.exp(log_probability(action[index], mean, log_std) - old_log_prob[index])
            clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
            gain = advantage[index]
            policy_loss = -torch.min(ratio * gain, clipped * gain).mean()
            value_loss = (critic(x)[:, 0] - target[index]).square().mean()
            cost_loss = (cost_critic(x)[:, 0] - cost_target[index]).square().mean()
            optimiser.zero_grad()
            (policy_loss + value_loss + cost_loss).backward()
            for network in networks.values():
                nn.utils.clip_grad_norm_(network.parameters(), config.max_grad_norm)
            optimiser.step()
            with torch.no_grad():
                kl = divergence(old_mean[index], old_log_std, mean, log_std)
                figures = torch.stack([kl, policy_loss, value_loss, cost_loss])
                sums += figures * (len(index) / rows)
        passes += 1
        moved = bool(sums[0] > config.target_kl)
    if not all(weights.isfinite().all() for weights in networks.parameters()):
        raise ConfigurationError(
            'training has diverged: weights of the networks are no longer finite; allowed are '
            f'smaller step sizes than actor_lr {config.actor_lr:g} and critic_lr '
            f'{config.critic_lr:g}, or rewards and costs of a smaller size'
        )
    kl, policy_loss, value_loss, cost_value_loss = sums.tolist()
    log_std_sum = actor.log_std.sum().item()
    return {
        'kl': kl,
        'passes': passes,
        'entropy': log_std_sum + 0.5 * action.shape[1] * math.log(2.0 * math.pi * math.e),
        'policy_loss': policy_loss,
        'value_loss': value_loss,
        'cost_value_loss': cost_value_loss,
    }
