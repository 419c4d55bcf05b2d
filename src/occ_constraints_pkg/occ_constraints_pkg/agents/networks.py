# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The learner's networks and the formulas of its Gaussian policy, in torch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from occ_constraints_pkg.errors import ConfigurationError


def torch_device(name: str) -> torch.device:
    """Return the device.

    Args:
        name: ``cpu`` or ``cuda``.

    Raises:
        OccError: this machine does not have it.
    """
    if name not in ('cpu', 'cuda') or (name == 'cuda' and not torch.cuda.is_available()):
        here = 'cpu, cuda' if torch.cuda.is_available() else 'cpu'
        raise ConfigurationError(f'learner setting device is {name!r}; this machine has {here}')
    return torch.device(name)


def mlp(widths: Sequence[int], last_gain: float, rng: np.random.Generator) -> nn.Sequential:
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


def log_probability(
    action: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor
) -> torch.Tensor:
    """Return the log density of a diagonal Gaussian, (rows,)."""
    z = (action - mean) * torch.exp(-log_std)
    return (-0.5 * z.square() - log_std - 0.5 * math.log(2.0 * math.pi)).sum(dim=1)


def divergence(
    mean: torch.Tensor, log_std: torch.Tensor, other: torch.Tensor, other_log_std: torch.Tensor
) -> torch.Tensor:
    """Return the mean over rows of KL(first || other) of two diagonal Gaussians, a scalar."""
    spread = torch.exp(2.0 * (log_std - other_log_std))
    shift = ((mean - other) * torch.exp(-other_log_std)).square()
    return (other_log_std - log_std + 0.5 * (spread + shift - 1.0)).sum(dim=1).mean()


def numbers(tensor: torch.Tensor) -> np.ndarray:
    """Return a copy on the CPU that later steps of an optimiser do not change."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy()).copy()
