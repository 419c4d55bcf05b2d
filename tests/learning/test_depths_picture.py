# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Shares from 0 to 100 %, whole depths, and lines that show where they coincide."""

import numpy as np
import pytest
from occ_constraints_pkg.learning.depths import DepthResult
from occ_constraints_pkg.rules import Feature, FeatureSpace, RuleSet

pytest.importorskip('matplotlib')

from matplotlib import pyplot as plt
from occ_constraints_pkg.learning.depths_picture import depths_figure

RULES = RuleSet(FeatureSpace((Feature('x'),)), (), np.array([[0.0, 1.0]]))


@pytest.mark.parametrize('depths', [1, 4])
def test_axes_end_where_their_numbers_do(depths):
    results = [
        DepthResult(depth, RULES, rules=3, literals=3, training=1.0, held_out=1.0, score=None)
        for depth in range(depths)
    ]
    figure = depths_figure(results)
    figure.draw_without_rendering()
    coverage, sizes = figure.axes
    assert coverage.get_ylim() == (0.0, 1.0)
    assert sizes.get_ylim()[0] == 0.0
    assert coverage.get_xlim() == (-0.5, depths - 0.5)
    assert all(tick == int(tick) for tick in coverage.get_xticks())
    assert coverage.yaxis.get_major_formatter()(0.5) == '50%'
    for axis in figure.axes:
        below, above = axis.lines
        assert (below.get_marker(), above.get_marker()) == ('o', 's')
        assert below.get_markersize() > above.get_markersize()
        assert not axis.get_legend().get_window_extent().overlaps(axis.get_window_extent())
    plt.close(figure)
