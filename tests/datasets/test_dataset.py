# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.errors import OccError


def dataset(episodes):
    rows = np.arange(len(episodes))
    return Dataset(('a',), rows[:, None] * 1.0, rows, np.array(episodes), rows * 2.0)


def test_select_takes_a_mask_or_numbers():
    data = dataset([0, 0, 1])
    for rows in (np.array([False, True, True]), np.array([1, 2])):
        chosen = data.select(rows)
        assert chosen.values.tolist() == [[1.0], [2.0]]
        assert chosen.true_cost.tolist() == [2.0, 4.0]
        assert chosen.times_ns is None


def test_shapes_must_fit():
    with pytest.raises(OccError, match='got values of shape'):
        Dataset(('a', 'b'), np.zeros((3, 1)), np.zeros(3), np.zeros(3))
