# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Odd samples are learned from as they are, or refused in one sentence; never a wrong box."""

import warnings

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict

RNG = np.random.default_rng(0)
UNIT = RNG.uniform(-1.0, 1.0, (500, 3))
ODD = {
    'constant': np.ones((500, 3)),
    'one constant': np.column_stack([UNIT, np.full(500, -0.0)]),
    'whole numbers': RNG.integers(0, 5, (500, 3)),
    'many whole numbers': RNG.integers(-(10**6), 10**6, (500, 3)),
    'whole numbers that float64 just holds': 2**52 + RNG.integers(0, 2000, (500, 3)),
    'truth values': RNG.random((500, 3)) > 0.3,
    'single precision': UNIT.astype(np.float32),
    'one row': UNIT[:1],
    'two rows': UNIT[:2],
    'two equal rows': UNIT[[0, 0]],
    'fewer rows than features': RNG.normal(size=(30, 60)),
    'duplicate rows': np.repeat(UNIT[:40], 25, axis=0),
    'one row many times and a few others': np.concatenate([UNIT[[0] * 960], UNIT[:40]]),
    'largest numbers': UNIT * 1.79e308,
    'large numbers': UNIT * 9e299,
    'both largest and ordinary': np.concatenate([UNIT, UNIT[:3] * 1.79e308]),
    'smallest numbers': UNIT * 2e-322,
    'small numbers': UNIT * 1e-310,
    'all scales': UNIT * [1e-300, 1.0, 1e300],
    'on far ground': 1e15 + UNIT,
    'two values far apart': np.where(UNIT > 0.99, 1e300, 0.0),
    'row by row backwards': np.asfortranarray(UNIT)[::-1, ::-1],
}
SETTINGS = {
    'defaults': OCTreeSettings(),
    'stated share': OCTreeSettings(contamination=0.1),
    'splits': OCTreeSettings(contamination=0.1, alpha=0.5),
    'article': OCTreeSettings.article(nu=0.2),
}
MOST_OUTSIDE = {'defaults': 0.05, 'stated share': 0.1, 'splits': 1.0, 'article': 0.2}


@pytest.mark.parametrize('settings', SETTINGS)
@pytest.mark.parametrize('name', ODD)
def test_odd_samples(name, settings):
    values = ODD[name]
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        tree = fit_safe_set(values, SETTINGS[settings])
    numbers = np.asarray(values, dtype=np.float64)
    inside = tree.contains(numbers)
    assert np.mean(~inside) <= MOST_OUTSIDE[settings] + 1e-12
    # Every bound is a sample's value, and the box of each leaf is filled.
    for box in tree.leaf_boxes(numbers.shape[1]):
        for feature, ends in enumerate(box):
            assert np.isin(ends[np.isfinite(ends)], numbers[:, feature]).all()
        assert ((numbers >= box[:, 0]) & (numbers <= box[:, 1])).all(axis=1).any()
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(numbers.shape[1])))
    learned = learn(
        numbers, np.zeros(len(numbers)), space, SETTINGS[settings], rng=np.random.default_rng(0)
    )
    verdict = learned.rule_set.judge(numbers).verdict
    np.testing.assert_array_equal(verdict == Verdict.SAFE, inside)
    beyond = np.nextafter(numbers.max(axis=0), np.inf)[None]
    assert learned.rule_set.judge(beyond).verdict[0] != Verdict.SAFE


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('settings', SETTINGS)
def test_values_that_are_not_finite_are_refused_with_their_place(bad, settings):
    values = UNIT.copy()
    values[77, 2] = bad
    with pytest.raises(OccError, match=f'sample 77, feature 2 is {bad}; learning takes finite'):
        fit_safe_set(values, SETTINGS[settings])


def test_finite_values_with_an_infinite_sum_are_fine():
    values = np.abs(UNIT) * 1.79e308
    assert fit_safe_set(values, OCTreeSettings()).contains(values).all()


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        ([['a', 'b']], 'learning needs numbers'),
        (UNIT + 1j, 'learning needs numbers'),
        ([[1.0, 2.0], [3.0]], 'learning needs numbers'),
        (UNIT[0], r'shape \(n, k\)'),
        (UNIT[None], r'shape \(n, k\)'),
    ],
)
def test_what_is_no_table_of_numbers_is_refused(values, sentence):
    with pytest.raises(OccError, match=sentence):
        fit_safe_set(values, OCTreeSettings())


@pytest.mark.parametrize(('rows', 'most'), [(3, 0.0), (25, 0.05)])
def test_a_hundred_thousand_columns(rows, most):
    columns = 100_000 if rows == 3 else 2_000
    values = np.random.default_rng(0).normal(size=(rows, columns))
    tree = fit_safe_set(values, OCTreeSettings())
    assert np.mean(~tree.contains(values)) <= most
