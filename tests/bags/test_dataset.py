# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.bags.dataset import Dataset
from occ_constraints_pkg.errors import OccError


def dataset(episodes):
    rows = np.arange(len(episodes))
    return Dataset(('a',), rows[:, None] * 1.0, rows, np.array(episodes), rows * 2.0)


@pytest.mark.parametrize(('share', 'held'), [(0.01, 1), (0.25, 2), (0.5, 4), (0.99, 7)])
def test_split_keeps_episodes_whole(share, held):
    data = dataset(np.repeat(np.arange(8), 5))
    rest, held_out = data.split_episodes(np.random.default_rng(3), share)
    assert len(set(held_out.episodes)) == held
    assert not set(rest.episodes) & set(held_out.episodes)
    assert sorted([*rest.stamps_ns, *held_out.stamps_ns]) == list(range(40))
    np.testing.assert_array_equal(held_out.true_cost, held_out.values[:, 0] * 2)
    again, _ = data.split_episodes(np.random.default_rng(3), share)
    np.testing.assert_array_equal(rest.stamps_ns, again.stamps_ns)


def test_split_refuses():
    with pytest.raises(OccError, match='the data hold 1'):
        dataset([0, 0]).split_episodes(np.random.default_rng(0), 0.5)
    with pytest.raises(OccError, match='the share of held-out episodes is 1'):
        dataset([0, 1]).split_episodes(np.random.default_rng(0), 1)


def test_shapes_must_fit():
    with pytest.raises(OccError, match='got values of shape'):
        Dataset(('a', 'b'), np.zeros((3, 1)), np.zeros(3), np.zeros(3))
