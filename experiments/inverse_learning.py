# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Baselines that learn a cost of states by training agents: inverse constrained learning.

Both alternate between training a policy under the present cost and making the cost higher where
that policy is and the demonstrations are not. They need the simulator and the reward, which rules
learned from demonstrations do not.

*ICRL* (Malik et al. 2021): a network ζ(s) in (0, 1) says how likely a state is allowed; its
likelihood on demonstrations is raised, and lowered on episodes of the policy, weighted by
importance so that several steps can be made with the same episodes. The policy is trained with
PPO-Lagrangian on the cost 1 - ζ, which may be 0 on average.

*MCE-ICRL-style*: our derivation from the principle of maximum causal entropy. Only the abstract of
the paper that it is named after (Baert et al. 2023) is public, so numbers are not that paper's.
The policy maximises reward - λ·φ(s) and its entropy; the dual step moves λ, and the network φ is
moved where expected features of policy and demonstrations differ most.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn


@dataclass(frozen=True)
class Episodes:
    """States of whole episodes, each in the order of time.

    Attributes:
        values: (n, k) states.
        episodes: (n,) the episode of each.
    """

    values: np.ndarray
    episodes: np.ndarray

    def weights(self, gamma: float) -> np.ndarray:
        """Return (n,) discounted weights of the states; those of an episode sum to 1 / episodes."""
        names, starts = np.unique(self.episodes, return_index=True)
        weights = np.zeros(len(self.values))
        for name in names:
            rows = np.flatnonzero(self.episodes == name)
            discounts = gamma ** np.arange(len(rows))
            weights[rows] = discounts / discounts.sum() / len(starts)
        return weights


class _Network:
    """A network on standardised states with outputs in (0, 1)."""

    def __init__(self, demonstrated: np.ndarray, hidden: int, outputs: int, lr: float, seed: int):
        self._mean = demonstrated.mean(axis=0)
        self._scale = demonstrated.std(axis=0) + 1e-6
        rng = np.random.default_rng(seed)
        widths = demonstrated.shape[1], hidden, outputs
        layers = [nn.Linear(n, m) for n, m in zip(widths[:-1], widths[1:], strict=True)]
        with torch.no_grad():
            for layer in layers:
                size = layer.weight.shape
                drawn = rng.standard_normal(size) / np.sqrt(size[1])
                layer.weight.copy_(torch.from_numpy(drawn))
                layer.bias.zero_()
        self.net = nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Sigmoid())
        self.optimiser = torch.optim.Adam(self.net.parameters(), lr=lr)

    def __call__(self, values: np.ndarray) -> torch.Tensor:
        scaled = np.clip((values - self._mean) / self._scale, -10.0, 10.0)
        return self.net(torch.from_numpy(scaled.astype(np.float32)))

    def numbers(self, values: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return self(values).numpy().astype(np.float64)

    def state(self) -> dict[str, Any]:
        return {'net': self.net.state_dict(), 'optimiser': self.optimiser.state_dict()}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.net.load_state_dict(state['net'])
        # Otherwise both would write to the same moments.
        self.optimiser.load_state_dict(deepcopy(state['optimiser']))


class ICRL:
    """The cost 1 - ζ(s) of Malik et al., with their settings for the larger environments.

    Args:
        demonstrations: what the expert did.
        seed: of the network's weights.
    """

    steps, epsilon_forward, epsilon_reverse, regulariser = 10, 10.0, 2.5, 0.5
    threshold = 0.5

    def __init__(self, demonstrations: Episodes, seed: int) -> None:
        self._demonstrations = demonstrations.values
        self._zeta = _Network(demonstrations.values, 20, 1, 0.01, seed)

    def cost(self, values: np.ndarray) -> np.ndarray:
        """Return (n,) costs in (0, 1) of (n, k) states."""
        return 1.0 - self._zeta.numbers(values)[:, 0]

    def improve(self, policy: Episodes) -> None:
        """Lower ζ where the policy is, and raise it where the demonstrations are.

        Stops before the importance weights say that the cost has moved too far from the one under
        which the episodes were made.

        Args:
            policy: episodes of the policy that was trained under the present cost.
        """
        names, inverse = np.unique(policy.episodes, return_inverse=True)
        count = np.bincount(inverse)
        old = np.log(self._zeta.numbers(policy.values)[:, 0] + 1e-9)
        for _ in range(self.steps):
            now = np.log(self._zeta.numbers(policy.values)[:, 0] + 1e-9)
            # Per episode, of a mean state: a product over a thousand steps would be 0 or infinite.
            log_ratio = np.bincount(inverse, now - old) / count
            weight = np.exp(log_ratio)
            mean = weight.mean()
            if (
                2 * np.log(mean) >= self.epsilon_forward
                or np.mean((weight - mean) * log_ratio) / mean >= self.epsilon_reverse
            ):
                break
            weights = torch.from_numpy((weight / mean)[inverse].astype(np.float32))
            expert = self._zeta(self._demonstrations)[:, 0]
            nominal = self._zeta(policy.values)[:, 0]
            loss = (
                -torch.log(expert + 1e-9).mean()
                + (weights * torch.log(nominal + 1e-9)).mean()
                + self.regulariser * ((1 - expert).mean() + (1 - nominal).mean())
            )
            self._zeta.optimiser.zero_grad()
            loss.backward()
            self._zeta.optimiser.step()

    def state(self) -> dict[str, Any]:
        """Return what :meth:`restore` needs."""
        return self._zeta.state()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue where another one was when it returned ``state``."""
        self._zeta.restore(state)


class MCEStyle:
    """The cost λ·φ(s) of the derivation above.

    Args:
        demonstrations: what the expert did.
        seed: of the network's weights.
    """

    features, gamma = 8, 0.99
    multiplier_init, multiplier_rate, slack = 0.01, 0.02, 0.01
    steps, decay = 10, 1e-3

    def __init__(self, demonstrations: Episodes, seed: int) -> None:
        self._demonstrations = demonstrations
        self._phi = _Network(demonstrations.values, 32, self.features, 3e-3, seed)
        self.multipliers = np.full(self.features, self.multiplier_init)

    @property
    def threshold(self) -> float:
        """The cost above which a state counts as flagged: half of the largest possible one."""
        return 0.5 * float(self.multipliers.sum())

    def cost(self, values: np.ndarray) -> np.ndarray:
        """Return (n,) costs of (n, k) states, in the unit of the reward."""
        return self._phi.numbers(values) @ self.multipliers

    def improve(self, policy: Episodes) -> None:
        """Make one dual step, and a few steps of the features.

        Args:
            policy: episodes of the policy that was trained under the present cost.
        """
        expert = self._demonstrations
        ours, theirs = policy.weights(self.gamma), expert.weights(self.gamma)
        excess = ours @ self._phi.numbers(policy.values)
        excess -= theirs @ self._phi.numbers(expert.values)
        self.multipliers = np.maximum(
            0.0, self.multipliers + self.multiplier_rate * (excess - self.slack)
        )
        multipliers = torch.from_numpy(self.multipliers.astype(np.float32))
        ours_, theirs_ = (torch.from_numpy(w.astype(np.float32)) for w in (ours, theirs))
        for _ in range(self.steps):
            difference = ours_ @ self._phi(policy.values) - theirs_ @ self._phi(expert.values)
            size = sum(weights.square().sum() for weights in self._phi.net.parameters())
            # Scaled, so that the step does not vanish with the multipliers.
            gain = multipliers @ difference / (multipliers.sum() + 1e-9)
            loss = self.decay * size - gain
            self._phi.optimiser.zero_grad()
            loss.backward()
            self._phi.optimiser.step()

    def state(self) -> dict[str, Any]:
        """Return what :meth:`restore` needs."""
        return {**self._phi.state(), 'multipliers': torch.from_numpy(self.multipliers)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue where another one was when it returned ``state``."""
        self._phi.restore(state)
        self.multipliers = state['multipliers'].numpy()


LEARNERS: dict[str, type[ICRL] | type[MCEStyle]] = {'ICRL': ICRL, 'MCE-ICRL-style': MCEStyle}
"""The two by name."""
