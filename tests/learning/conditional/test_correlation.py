# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull, gaussian_corner
from occ_constraints_pkg.learning.conditional.grid import make_grid
from occ_constraints_pkg.learning.conditional.rules import Feature
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Cut, make_units
from scipy.stats import multivariate_normal, norm


def sample_of(*columns):
    values = np.column_stack(columns)
    units = make_units(values, [Feature(f'x{number}') for number in range(values.shape[1])])
    columns = [unit.of(values) for unit in units]
    return Sample(units, columns, columns, np.zeros(len(values), bool), np.zeros(len(values)))


@pytest.mark.parametrize('rho', [-0.95, -0.3, 0.0, 0.6, 0.99])
def test_the_copula_is_that_of_the_normal_distribution(rho):
    lower, other = np.array([0.01, 0.3, 0.9]), np.array([0.05, 0.5])
    found = gaussian_corner(lower, other, rho)
    both = multivariate_normal([0, 0], [[1, rho], [rho, 1]], abseps=1e-10, releps=1e-10)
    for row, u in enumerate(lower):
        for column, v in enumerate(other):
            truth = both.cdf([norm.ppf(u), norm.ppf(v)])
            assert found[row, column] == pytest.approx(truth, abs=2e-5)


def test_a_correlation_explains_both_corners_and_a_rule_only_its_own():
    rng = np.random.default_rng(0)
    x = rng.normal(size=20_000)
    y = 0.8 * x + 0.6 * rng.normal(size=len(x))
    null = CorrelationNull(sample_of(x, y))
    assert null.correlation(0, 1) == pytest.approx(0.8, abs=0.02)
    for side, other in ((ABOVE, BELOW), (BELOW, ABOVE)):
        assert null.share_at(Cut(0, side, float(side)), Cut(1, other, float(other))) < 0.1
    u, v = rng.uniform(size=(2, 20_000))
    kept = ~((u > 0.7) & (v < 0.3))
    null = CorrelationNull(sample_of(u[kept], v[kept]))
    assert null.share_at(Cut(0, ABOVE, 0.7), Cut(1, BELOW, 0.3)) > 0.9


def test_scatter_that_grows_with_a_feature_empties_both_corners_and_a_rule_does_too():
    rng = np.random.default_rng(0)
    speed, turn = rng.uniform(0.2, 3, 20_000), rng.normal(size=20_000)
    null = CorrelationNull(sample_of(speed, speed * turn))
    for side in (BELOW, ABOVE):
        assert null.share_at(Cut(0, BELOW, 0.6), Cut(1, side, 2.0 * side)) == 0
    # No sharp turns at high speed, on either side.
    kept = ~((speed > 2) & (abs(turn) > 1))
    null = CorrelationNull(sample_of(speed[kept], turn[kept]))
    for side in (BELOW, ABOVE):
        assert null.share_at(Cut(0, ABOVE, 2.0), Cut(1, side, float(side))) > 0.9


def test_all_corners_at_once_are_as_one_by_one():
    rng = np.random.default_rng(1)
    x = rng.normal(size=5_000)
    sample = sample_of(x, 0.5 * x + rng.normal(size=len(x)))
    null, grids = CorrelationNull(sample), [make_grid(sample, unit, 8) for unit in (0, 1)]
    table = null.share(0, 1, *grids)
    for row, cut in enumerate(grids[0].cuts):
        for column, other in enumerate(grids[1].cuts):
            assert table[row, column] == pytest.approx(null.share_at(cut, other), abs=0.02)


def test_nothing_is_left_where_one_feature_determines_the_other():
    angle = np.random.default_rng(0).uniform(0, 2 * np.pi, 5_000)
    sample = sample_of(np.cos(angle), np.sin(angle))
    null = CorrelationNull(sample)
    assert null.is_determined(0, 1)
    assert null.share_at(Cut(0, ABOVE, 0.8), Cut(1, ABOVE, 0.8)) == 0
    grids = [make_grid(sample, unit, 8) for unit in (0, 1)]
    assert not null.share(0, 1, *grids).any()


def test_discrete_features_have_no_such_null():
    rng = np.random.default_rng(0)
    mode = rng.integers(0, 3, 1_000)
    null = CorrelationNull(sample_of(rng.normal(size=1_000), mode))
    assert null.share_at(Cut(0, ABOVE, 1.0), Cut(1, ABOVE, 2.0)) == 1
    assert not null.is_determined(0, 1)
