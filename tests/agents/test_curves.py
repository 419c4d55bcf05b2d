# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Curves are drawn although values are not there yet, and seeds are of different lengths."""

import pytest

pytest.importorskip('matplotlib')

from matplotlib import image as mpl_image
from matplotlib import pyplot as plt
from occ_constraints_pkg.agents.curves import draw_training, training_figure


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


def test_seeds_are_lines_and_nothing_is_below_what_is_possible():
    # An interval from two such different seeds would reach below 0.
    wild = [lines(5), lines(5, 50.0)]
    for number, line in enumerate(wild[1], start=1):
        line['mean_cost'], line['multiplier'] = 200.0 * number, 5.0 * number
    figure = training_figure(wild, 25.0)
    figure.draw_without_rendering()
    _, cost, multiplier = figure.axes
    assert [len(axis.lines) for axis in figure.axes] == [3, 4, 3]
    assert not any(axis.collections for axis in figure.axes)
    assert cost.get_ylim()[0] == multiplier.get_ylim()[0] == 0.0
    assert {axis.get_xlim() for axis in figure.axes} == {(0.0, 0.005)}
    assert {axis.get_xlabel() for axis in figure.axes} == {'million robot steps'}
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        'mean of 2 seeds',
        'each seed',
        'cost limit',
    ]
    for axis in figure.axes:
        assert not legend.get_window_extent().overlaps(axis.get_window_extent())
    plt.close(figure)
