# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.learning.conditional.margins import outward_margins

EPISODES = np.repeat(np.arange(50), 100)


def test_levels_of_their_own_need_a_margin_and_a_common_edge_needs_none():
    rng = np.random.default_rng(0)
    level = np.repeat(rng.normal(size=50), 100) + rng.normal(0, 0.01, 5_000)
    edge = np.maximum(rng.normal(size=5_000), -0.5)
    margins = outward_margins(np.column_stack([level, edge]), EPISODES, [], 0.01)
    assert margins[0].min() > 0.2
    assert margins[1, 0] == 0


def test_fresh_episodes_hardly_go_beyond():
    rng = np.random.default_rng(1)

    def draw():
        return np.repeat(rng.normal(size=50), 100)[:, None] + rng.normal(0, 0.1, (5_000, 1))

    beyond = []
    for _ in range(20):
        values = draw()
        low, high = outward_margins(values, EPISODES, [], 0.01)[0]
        fresh = draw()
        beyond.append(((fresh < values.min() - low) | (fresh > values.max() + high)).mean())
    assert np.mean(beyond) < 0.01


def test_a_family_shares_its_margin():
    rng = np.random.default_rng(0)
    values = np.column_stack([np.repeat(rng.normal(size=50), 100) for _ in range(3)])
    margins = outward_margins(values, EPISODES, [(0, 2)], 0.01)
    np.testing.assert_array_equal(margins[0], margins[2])
    alone = outward_margins(np.minimum(values[:, :1], values[:, 2:]), EPISODES, [], 0.01 / 2)
    np.testing.assert_allclose(margins[0, 0], alone[0, 0])


def test_too_few_episodes_and_discrete_features_have_none():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(200, 1))
    assert not outward_margins(values, np.repeat([0, 1], 100), [], 0.01).any()
    levels = np.repeat(rng.normal(size=50), 100)[:, None]
    assert not outward_margins(levels, EPISODES, [], 0.01, discrete=[0]).any()
    assert outward_margins(levels, EPISODES, [], 0.01).any()
