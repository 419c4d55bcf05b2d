# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The multiplier answers an excess in proportion and remembers it, both within bounds."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.agents.multiplier import Multiplier
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig


def make(limit=25.0, start=1.0):
    return Multiplier(
        PPOLagrangianConfig(
            cost_limit=limit,
            multiplier_init=start,
            multiplier_rate=0.05,
            multiplier_gain=0.5,
            multiplier_band=0.2,
        )
    )


def test_a_known_course():
    multiplier = make()
    # One unit is a fifth of the limit: 5.
    for cost, integral, value in [
        (27.5, 1.025, 1.275),
        (125.0, 1.075, 1.575),
        (25.0, 1.075, 1.075),
        (24.0, 1.065, 0.965),
        (0.0, 1.015, 0.515),
    ]:
        multiplier.update(cost)
        assert multiplier.integral == pytest.approx(integral)
        assert multiplier.value == pytest.approx(value)


def test_nothing_is_known_before_the_first_episode():
    multiplier = make()
    multiplier.update(math.nan)
    assert (multiplier.integral, multiplier.value) == (1.0, 1.0)


@given(
    st.floats(0, 1e3),
    st.lists(st.floats(0, 1e6), min_size=1, max_size=50),
)
def test_it_is_never_negative_and_moves_by_bounded_steps(limit, costs):
    multiplier = make(limit)
    for cost in costs:
        before = multiplier.integral
        multiplier.update(cost)
        assert multiplier.value >= 0.0
        assert 0.0 <= multiplier.integral <= before + 0.05 + 1e-12
        assert abs(multiplier.value - multiplier.integral) <= 0.5 + 1e-9


def test_it_settles_where_the_cost_meets_its_limit():
    """A cost that falls as the multiplier rises, with some delay."""
    multiplier, cost, costs = make(start=0.001), 60.0, []
    for _ in range(600):
        cost += 0.1 * (60.0 - 12.0 * multiplier.value - cost)
        multiplier.update(cost)
        costs.append(cost)
    np.testing.assert_allclose(costs[-100:], 25.0, atol=0.1)
    assert min(costs) > 20.0
