# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table

observer = pytest.importorskip('occ_constraints_pkg.demo.observer', exc_type=ImportError)


def test_agreement_pairs_costs_with_the_truth_of_the_same_step():
    heard = observer.Heard()
    with pytest.raises(OccError, match='no costs were received'):
        heard.agreement()
    heard.true_cost = {1: np.array([0.0, 1.0]), 2: np.array([1.0, 1.0]), 3: np.array([1.0, 0.0])}
    heard.costs = {
        2: Table(('cost',), np.array([[1.0], [0.0]])),
        1: Table(('cost',), np.array([[1.0], [1.0]])),
        7: Table(('cost',), np.array([[1.0], [1.0]])),
    }
    agreement = heard.agreement()
    assert (agreement['samples'], agreement['flagged'], agreement['costly']) == (4, 3, 3)
    assert agreement['precision'] == pytest.approx(2 / 3)
    assert agreement['recall'] == pytest.approx(2 / 3)
    assert agreement['iou'] == pytest.approx(0.5)
