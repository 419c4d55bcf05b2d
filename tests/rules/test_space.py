# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace


def test_names_bounds_and_positions():
    space = FeatureSpace((Feature('a'), Feature('b', 'm', 0.0, 2.0)))
    assert len(space) == 2
    assert space.names == ('a', 'b')
    assert space.lows.tolist() == [-np.inf, 0.0]
    assert space.highs.tolist() == [np.inf, 2.0]
    assert space.index('b') == 1
    with pytest.raises(OccError, match="no feature 'c'; there are a, b"):
        space.index('c')


@pytest.mark.parametrize(
    ('features', 'sentence'),
    [
        ((), 'at least one feature'),
        ((Feature('a'), Feature('b'), Feature('a')), "'a' is named twice"),
        ((Feature('a', '1', 1.0, 0.0),), r"'a' has bounds \[1.0, 0.0\]"),
        ((Feature('a', '1', np.nan, 0.0),), r"'a' has bounds \[nan, 0.0\]"),
        ((Feature('a', '1', 0.0, np.nan),), r"'a' has bounds \[0.0, nan\]"),
        ((Feature('a', '1', np.inf, np.inf),), r"'a' has bounds \[inf, inf\]"),
        ((Feature('a', '1', -np.inf, -np.inf),), r"'a' has bounds \[-inf, -inf\]"),
    ],
)
def test_spaces_that_make_no_sense(features, sentence):
    with pytest.raises(OccError, match=sentence):
        FeatureSpace(features)


def test_rows_become_float64():
    space = FeatureSpace((Feature('a'),))
    rows = space.check_rows(np.array([[0.1]], dtype=np.float32))
    assert rows.dtype == np.float64
    assert rows[0, 0] == np.float32(0.1)
