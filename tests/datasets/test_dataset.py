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


def test_episodes_at_the_same_time_depend_on_each_other():
    def independent(times, recordings=(0, 0, 0, 0, 1, 1), sources=2):
        rows = len(times)
        return Dataset(
            ('x',),
            np.zeros((rows, 1)),
            np.arange(rows),
            np.array([4, 4, 7, 7, 9, 9]),
            times_ns=np.array(times),
            recordings=np.array(recordings),
            sources=tuple({'name': str(number)} for number in range(sources)),
        ).independent.tolist()

    one_after_the_other = [0, 5, 6, 9, 0, 9]
    at_once = [0, 5, 3, 9, 0, 9]
    assert independent(one_after_the_other) == [0, 0, 1, 1, 2, 2]
    assert independent(at_once) == [0, 0, 0, 0, 2, 2]
    # One recording by itself can only be counted by episodes.
    assert independent(at_once, [0] * 6, 1) == [0, 0, 1, 1, 2, 2]
    assert dataset([3, 3, 5]).independent.tolist() == [0, 0, 1]
