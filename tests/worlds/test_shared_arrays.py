# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import os

import numpy as np
import pytest
from occ_constraints_pkg.worlds.shared_arrays import SharedArrays

SHAPES = [((3, 2), np.float64), (5000, np.int64), ((4, 0, 2), np.float64), (7, bool)]


def test_who_asks_in_the_same_order_gets_the_same_arrays():
    mine = SharedArrays(100_000)
    theirs = SharedArrays(100_000, os.dup(mine.descriptor))
    first = [mine.zeros(shape, dtype) for shape, dtype in SHAPES]
    second = [theirs.zeros(shape, dtype) for shape, dtype in SHAPES]
    mine.close()
    theirs.close()
    for number, (a, b) in enumerate(zip(first, second, strict=True)):
        assert a.shape == b.shape
        assert a.dtype == b.dtype
        assert not a.any()
        a[...] = number + 1
        np.testing.assert_array_equal(b, a)
        b[...] = 0
        assert not a.any()
    assert first[1].nbytes == 40_000
    assert [array.size for array in first] == [6, 5000, 0, 7]


def test_arrays_do_not_overlap():
    arrays = SharedArrays(50_000)
    made = [arrays.zeros(shape) for shape in (1, 511, 512, 513, 3)]
    arrays.close()
    arrays.close()
    for number, array in enumerate(made):
        array[:] = number
    for number, array in enumerate(made):
        assert (array == number).all()


def test_room_is_limited():
    arrays = SharedArrays(1000)
    arrays.zeros(125)
    with pytest.raises(TypeError):
        arrays.zeros(1)
    arrays.close()
