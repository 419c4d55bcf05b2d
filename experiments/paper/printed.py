# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers and rules that the paper prints."""

from __future__ import annotations

REWARD = {
    'PointGoal1': ('13.9 ± 1.7', '0.6 ± 0.3', '4.9 ± 2.1', '0.7 ± 0.3'),
    'PointPush1': ('0.5 ± 0.2', '0.6 ± 0.1', '0.1 ± 0.2', '0.4 ± 0.1'),
    'CarGoal1': ('12.2 ± 3.6', '0.9 ± 0.3', '15.1 ± 3.1', '0.7 ± 0.2'),
    'CarPush1': ('0.1 ± 0.1', '0.5 ± 0.1', '0.3 ± 0.3', '0.5 ± 0.1'),
}
"""Table 1: the source of the rules, to the targets in the order of the tasks."""

COST = {
    'PointGoal1': ('27.9 ± 5.0', '54.5 ± 16.7', '35.1 ± 11.6', '47.4 ± 9.3'),
    'PointPush1': ('4.5 ± 1.7', '26.2 ± 7.3', '6.5 ± 3.9', '18.7 ± 8.2'),
    'CarGoal1': ('41.0 ± 8.0', '50.3 ± 12.8', '33.7 ± 5.3', '48.7 ± 9.9'),
    'CarPush1': ('13.9 ± 4.4', '25.7 ± 8.3', '14.4 ± 3.5', '24.6 ± 10.6'),
}
"""Table 2, as table 1."""

SIMPLE_NAV = (
    'x below 0.1',
    'x above 0.9',
    'x between 0.1 and 0.7 and y below 0.1',
    'x between 0.1 and 0.7 and y above 0.3',
    'x between 0.7 and 0.9 and y below 0.1',
    'x between 0.7 and 0.9 and y above 0.9',
)
"""The formula of the example."""

SIMPLE_NAV_PRUNED = ('x between 0.1 and 0.7 and y above 0.3',)
"""The same after pruning."""

POINT_GOAL = (
    'a_x below -5.42',
    'v_y below -1.05',
    'v_x above 1.46',
    'd_l0 above 0.88',
    'd_l3 above 1.0',
    'd_l5 above 0.99',
    'd_l0 from 0.0 to 0.22 and d_l1 above 0.81',
    'd_l0 from 0.22 to 0.88 and d_l7 above 0.87',
    'd_l0 from 0.0 to 0.22 and d_l1 from 0.0 to 0.27 and d_l15 above 0.66',
    'd_l0 from 0.0 to 0.22 and d_l1 from 0.27 to 0.81 and d_l15 above 0.81',
    'd_l0 from 0.22 to 0.88 and d_l7 from 0.0 to 0.27 and d_l6 above 0.85',
    'd_l0 from 0.22 to 0.88 and d_l7 from 0.27 to 0.87 and d_l14 above 0.94',
    'three conditions on d_l0, d_l1, d_l15 and d_l2 above 0.83',
    'three conditions on d_l0, d_l1, d_l15 and d_l14 above 0.94',
    'three conditions on d_l0, d_l7, d_l6 and d_l8 above 0.78',
    'three conditions on d_l0, d_l7, d_l6 and d_l8 above 0.89',
    'three conditions on d_l0, d_l7, d_l14 and d_l13 above 0.94',
    'three conditions on d_l0, d_l7, d_l14 and d_l4 above 0.94',
)
"""The appendix's rules of PointGoal after pruning; the longest are told in short."""

HIGHWAY = (
    'v_y below -0.95',
    'v_y above 0.96',
    'v_x below 20.67',
    'v_x above 47.47',
    'p_rel1 below 18.83',
    'p_rel4 below 18.83',
    'd_left_edge below 4.42',
    'd_right_edge below 2.02',
    'd_right_edge from 4.65 to 7.38 and p_rel1 from 18.83 to 328.76 and p_rel0 below 236.11',
    'd_right_edge from 4.65 to 7.38 and p_rel1 from 328.76 to 500 and p_rel0 below 155.9',
    'two conditions more on p_rel1 and p_rel0, and p_rel3 below 235.66',
    'two conditions more on p_rel1 and p_rel0, and p_rel3 below 136.43',
    'd_right_edge from 2.02 to 4.65 and p_rel0 up to 325.83 and p_rel3 up to 332.09 '
    'and p_rel4 below 26.81',
    'd_right_edge from 2.02 to 4.65 and p_rel0 at least 325.83 and p_rel1 from 33.84 to 219.6 '
    'and p_rel4 below 29.48',
    'd_right_edge from 2.02 to 4.65 and p_rel0 at least 325.83 and p_rel1 at least 219.6 '
    'and p_rel3 above 344.91',
)
"""The appendix's rules of highD after pruning; those with v_y within -0.95 to 0.96 without it."""
