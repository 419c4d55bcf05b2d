# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Curves are drawn although values are not there yet, and seeds are of different lengths."""

import pytest

pytest.importorskip('matplotlib')

from matplotlib import image as mpl_image
from occ_constraints_pkg.agents.curves import draw_training


def lines(number, shift=0.0):
    first = {'steps': 1000, 'mean_return': None, 'mean_cost': None, 'multiplier': 0.0}
    rest = [
        {'steps': 1000 * i, 'mean_return': i + shift, 'mean_cost': 30.0 - i, 'multiplier': 0.1 * i}
        for i in range(2, number + 1)
    ]
    return [first, *rest]


@pytest.mark.parametrize('histories', [[lines(3)], [lines(3), lines(5, 1.0)], [lines(1)] * 3])
@pytest.mark.parametrize('limit', [25.0, None])
def test_one_or_several_trainings_are_drawn(tmp_path, histories, limit):
    draw_training(tmp_path / 'curves.png', histories, limit)
    assert mpl_image.imread(tmp_path / 'curves.png')[..., :3].std() > 0.01
