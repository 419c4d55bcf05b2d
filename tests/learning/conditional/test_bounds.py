# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.learning.conditional.bounds import (
    demonstrated_ranges,
    fit_box,
    inside_box,
)
from occ_constraints_pkg.learning.conditional.rules import Feature
from occ_constraints_pkg.learning.conditional.table import Table
from occ_constraints_pkg.learning.conditional.units import make_units

EPISODES = np.repeat(np.arange(60), 100)
FREE = [-np.inf, np.inf]


def fit(values, bounds=None, *, family=False, limits=FREE, outside=0.005, cuts_stay=False):
    names = range(values.shape[1])
    features = [Feature(f'x{name}', family='f' * family) for name in names]
    table = Table(values, make_units(values, features), np.arange(len(values)), EPISODES)
    groups = [tuple(names)] if family else [(name,) for name in names]
    demonstrated = demonstrated_ranges(values, groups)
    bounds = demonstrated if bounds is None else np.array(bounds)
    limits = np.broadcast_to(limits, (values.shape[1], 2))
    box, is_bad = fit_box(table, bounds, demonstrated, limits, outside, cuts_stay=cuts_stay)
    return demonstrated, box, is_bad


def levels(seed=0, features=1):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.normal(size=(60, features)), 100, axis=0)


def test_extremes_move_outward_but_not_beyond_physical_bounds():
    demonstrated, box, _ = fit(levels())
    assert box[0, 0] < demonstrated[0, 0]
    assert box[0, 1] > demonstrated[0, 1]
    highest = demonstrated[0, 1] + 1e-3
    _, box, _ = fit(levels(), limits=[-np.inf, highest])
    assert demonstrated[0, 1] < box[0, 1] < highest
    demonstrated, box, _ = fit(levels(), outside=None)
    np.testing.assert_array_equal(box, demonstrated)


def test_bounds_that_leave_many_outside_stay():
    _, box, _ = fit(levels(), [[-1.0, 1.0]])
    assert box.tolist() == [[-1.0, 1.0]]


def test_bounds_that_leave_few_good_samples_outside_are_taken_back():
    rng = np.random.default_rng(0)
    values = np.cumsum(rng.normal(size=(60, 100)), axis=1).reshape(-1, 1)
    nearly = np.sort(values[:, 0])[-6]
    demonstrated, box, _ = fit(values, [[values.min(), nearly]])
    assert box[0, 1] >= demonstrated[0, 1]


def test_cut_bounds_stay_in_noise_and_where_bad_samples_are_known_of():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(6_000, 1))
    cut = np.sort(noise[:, 0])[-6]
    demonstrated, box, _ = fit(noise, [[noise.min(), cut]])
    assert box[0, 1] == cut
    assert box[0, 0] < demonstrated[0, 0]
    walk = np.cumsum(rng.normal(size=(60, 100)), axis=1).reshape(-1, 1)
    cut = np.sort(walk[:, 0])[-6]
    demonstrated, box, _ = fit(walk, [[walk.min(), cut]], cuts_stay=True)
    assert box[0, 1] == cut
    assert box[0, 0] < demonstrated[0, 0]


def test_bounds_that_leave_glitches_outside_stay():
    rng = np.random.default_rng(0)
    values = np.sin(np.cumsum(rng.normal(0, 0.05, (60, 100)), axis=1)).reshape(-1, 1)
    values[50::997, 0] = 9.0
    _, box, _ = fit(values, [[values.min(), 1.0]])
    assert box[0, 1] == 1.0


def test_rows_with_several_glitches_are_bad():
    rng = np.random.default_rng(0)
    values = np.sin(np.cumsum(rng.normal(0, 0.05, (60, 100, 3)), axis=1)).reshape(-1, 3)
    values[50::997, :2] = 9.0
    values[70::997, 2] = 9.0
    _, _, is_bad = fit(values)
    assert np.flatnonzero(is_bad).tolist() == list(range(50, 6_000, 997))


def test_a_family_shares_its_bounds():
    demonstrated, box, _ = fit(levels(features=3), family=True)
    assert len(np.unique(box, axis=0)) == 1
    assert (box[:, 0] < demonstrated[:, 0]).all()


def test_inside_is_inside_whether_a_feature_is_looked_at_or_not():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(500, 3))
    box = np.array([[-1.0, 1.0], [-9.0, 9.0], [-9.0, 0.5]])
    expected = ((values >= box[:, 0]) & (values <= box[:, 1])).all(axis=1)
    found = inside_box(values, box, demonstrated_ranges(values, [(0,), (1,), (2,)]))
    np.testing.assert_array_equal(found, expected)
