# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The Lagrange multiplier on the cost, as a controller that holds the cost at its limit."""

from __future__ import annotations

import math

from occ_constraints_pkg.agents.settings import PPOLagrangianConfig


class Multiplier:
    """A proportional-integral controller (Stooke, Achiam and Abbeel 2020), bounded in both parts.

    The excess of the cost over its limit counts in units of ``multiplier_band`` times the limit (of
    ``multiplier_band`` where the limit is below 1), and as at most 1 unit: a cost far above its
    limit, as there is before anything is learned, then raises the multiplier no faster than a
    reward can be learned beside it, while a cost near its limit is answered in proportion.

    Attributes:
        integral: the part that remembers, 0 or more.
        value: the multiplier, 0 or more.
    """

    def __init__(self, config: PPOLagrangianConfig) -> None:
        """Start with the integral alone, at ``multiplier_init``."""
        self._limit, self._rate = config.cost_limit, config.multiplier_rate
        self._gain = config.multiplier_gain
        self._unit = config.multiplier_band * max(config.cost_limit, 1.0)
        self.integral = self.value = config.multiplier_init

    def update(self, cost: float) -> None:
        """Follow the mean cost of recent episodes; NaN, before there are any, changes nothing."""
        if math.isnan(cost):
            return
        excess = min(1.0, max(-1.0, (cost - self._limit) / self._unit))
        self.integral = max(0.0, self.integral + self._rate * excess)
        self.value = max(0.0, self.integral + self._gain * excess)
