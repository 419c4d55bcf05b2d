# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import pytest

pytest.importorskip('matplotlib')

from experiments.highway_results import markdown, summary, wilson


def line(seed, collisions, value):
    part = {'episodes': 100.0, 'collision': collisions, 'off_road': 0.0, 'return': value}
    return {'set': 'full', 'agent': 'ours', 'seed': seed, 'sampled': part, 'mean': part}


def test_the_interval_of_a_rate_is_that_of_wilson():
    # Newcombe 1998, table I: 81 of 263.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)


def test_seeds_are_summed_up():
    row = summary([line(0, 4, 20.0), line(1, 8, 24.0)])[0]
    assert row['collision'] == 0.06
    assert row['return'] == 22.0
    assert row['return_ci95'] == pytest.approx(12.706 * 2.0, rel=1e-3)
    assert '| full | ours | sampled | 22.0 ± 25.4 | 6.0 % (3.5 to 10.2) |' in markdown([row])
    assert summary([line(0, 4, 20.0)])[0]['return_ci95'] is None
