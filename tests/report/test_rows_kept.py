# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rows on a page: no violation is lost, and none that another bound would make."""

from dataclasses import replace

import numpy as np
import pytest
from judged_drives import drives
from occ_constraints_pkg.report.rows_kept import rows_kept


@pytest.mark.parametrize('most', [10, 500, 3000])
def test_every_violation_keeps_its_ends_and_its_worst_row(rule_set, most):
    timeline = drives(rule_set, samples=10_000)
    kept = rows_kept(timeline, rule_set, most)
    assert (np.diff(kept) > 0).all()
    essential = {
        row
        for item in timeline.violations + timeline.unknown
        for row in (item.samples[0], item.worst, item.samples[-1])
    }
    assert essential <= set(kept.tolist())
    assert len(kept) <= max(most, len(essential))


def test_few_rows_are_all_kept(rule_set):
    timeline = drives(rule_set)
    np.testing.assert_array_equal(rows_kept(timeline, rule_set, 10**6), np.arange(800))


@pytest.mark.parametrize('bound', [0.2, 0.8, 0.99])
def test_a_bound_moved_inwards_is_crossed_among_the_kept_rows(rule_set, bound):
    """Wherever a stretch of a recording violates the moved bound, a kept row of it does."""
    calm = replace(rule_set, rules=rule_set.rules[:1])
    timeline = drives(calm, samples=10_000)
    kept = rows_kept(timeline, calm, 3000)
    speed = timeline.data.values[:, 0]
    assert np.nanmax(speed[kept]) == np.nanmax(speed)
    crossed = np.flatnonzero(speed > bound)
    found = kept[speed[kept] > bound]
    # Stretches are some thirty rows long here.
    nearest = np.abs(found[np.searchsorted(found, crossed).clip(max=len(found) - 1)] - crossed)
    before = np.abs(found[(np.searchsorted(found, crossed) - 1).clip(min=0)] - crossed)
    assert np.minimum(nearest, before).max() < 60
