# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Advantages against a naive sum, running statistics against those of all rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.agents.rollout import Normaliser, advantages


@st.composite
def rollouts(draw):
    """A rollout in which any state may be the last of its episode."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    steps, robots = draw(st.integers(1, 12)), draw(st.integers(1, 3))
    done = rng.random((steps + 1, robots)) < draw(st.sampled_from([0.0, 0.1, 0.5]))
    valid = ~done[:-1]
    terminated = valid & done[1:] & (rng.random((steps, robots)) < 0.5)
    signal = rng.normal(size=(steps, robots))
    values = rng.normal(size=(steps + 1, robots))
    return signal, values, terminated, done


@given(rollouts(), st.floats(0, 1), st.floats(0, 1))
def test_advantages_equal_the_sum_over_one_episode(rollout, gamma, lam):
    signal, values, terminated, done = rollout
    result = advantages(signal, values, terminated, ~done[:-1], gamma, lam)
    for t, n in np.ndindex(signal.shape):
        expected, weight = 0.0, 1.0
        for later in range(t, len(signal)):
            if done[later, n]:
                break
            following = 0.0 if terminated[later, n] else values[later + 1, n]
            expected += weight * (signal[later, n] + gamma * following - values[later, n])
            weight *= gamma * lam
        assert result[t, n] == pytest.approx(expected, abs=1e-9)


def test_a_time_limit_continues_with_the_last_value_and_an_end_with_zero():
    signal, values = np.ones((1, 2)), np.array([[0.0, 0.0], [10.0, 10.0]])
    result = advantages(signal, values, np.array([[False, True]]), np.ones((1, 2), bool), 0.9, 1.0)
    np.testing.assert_allclose(result, [[10.0, 1.0]])


@settings(max_examples=30)
@given(st.integers(0, 1000), st.lists(st.integers(1, 20), min_size=1, max_size=4))
def test_running_statistics_equal_those_of_all_rows(seed, sizes):
    rng = np.random.default_rng(seed)
    rows = [rng.normal(3.0, 2.0, (size, 2)) for size in sizes]
    normaliser = Normaliser(2)
    for part in rows:
        normaliser.fold(part)
    everything = np.concatenate(rows)
    np.testing.assert_allclose(normaliser.mean, everything.mean(axis=0))
    np.testing.assert_allclose(normaliser.variance, everything.var(axis=0), atol=1e-12)
