# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Evaluation counts every episode once, and the same number of each robot."""

import numpy as np
import pytest
from line_world import LineWorld
from occ_constraints_pkg.agents.evaluation import evaluate, half_width
from occ_constraints_pkg.errors import OccError


def right(observation):
    return np.ones((len(observation), 1))


def left(observation):
    return -np.ones((len(observation), 1))


@pytest.mark.parametrize('episodes', [1, 3, 4, 11])
def test_sums_of_a_known_course(episodes):
    """Going right from x0, step t ends at min(1, x0 + t / 10)."""
    result = evaluate(LineWorld(4), right, episodes=episodes, seed=2)
    rng = np.random.default_rng(2)
    starts = np.concatenate([rng.uniform(0.1, 0.5, 4) for _ in range(3)])[:episodes]
    places = np.minimum(1.0, starts[:, None] + 0.1 * np.arange(1, 21))
    np.testing.assert_allclose(result.returns, places.sum(axis=1))
    np.testing.assert_array_equal(result.costs, (places > 0.7).sum(axis=1))
    np.testing.assert_array_equal(result.lengths, 20)


def test_short_episodes_are_not_favoured():
    """Robots that walk off the cliff start again at once, yet each gives as many episodes."""

    def half_left(observation):
        return np.where(np.arange(4)[:, None] < 2, left(observation), right(observation))

    result = evaluate(LineWorld(4, cliff=True), half_left, episodes=12, seed=0)
    assert (result.lengths.reshape(3, 4)[:, :2] <= 5).all()
    assert (result.lengths.reshape(3, 4)[:, 2:] == 20).all()


def test_another_cost_source():
    result = evaluate(
        LineWorld(2), right, episodes=2, seed=0, cost_source=lambda batch: np.full(2, 0.5)
    )
    np.testing.assert_allclose(result.costs, 10.0)
    assert result.as_dict()['cost'] == pytest.approx(10.0)


def test_interval_of_a_known_sample():
    # t(0.975, 3 degrees of freedom) = 3.182446, s = sqrt(5 / 3), n = 4
    assert half_width(np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(
        3.182446 * (5 / 3) ** 0.5 / 2
    )
    assert np.isnan(half_width(np.array([1.0])))


def test_no_episodes_are_refused():
    with pytest.raises(OccError, match='episodes = 0'):
        evaluate(LineWorld(2), right, episodes=0, seed=0)
