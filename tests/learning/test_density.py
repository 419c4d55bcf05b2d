# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.learning.density import bandwidth, estimate
from scipy.stats import norm

# Of the largest density: sharing samples out between cells an eighth of a bandwidth wide, the
# interpolation between them, and the kernel cut off at four bandwidths.
TOLERANCE = 0.005


def test_bandwidth_is_the_articles():
    ordered = np.array([0.0, 1.0, 2.0, 3.0, 10.0])
    # The quartiles are 1 and 3, and 2 / 1.34 is less than the standard deviation, 3.96.
    assert bandwidth(ordered) == pytest.approx(0.9 * (2.0 / 1.34) * 5**-0.2)
    ordered = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0])
    assert bandwidth(ordered) == pytest.approx(0.9 * ordered.std(ddof=1) * 8**-0.2)
    ordered = np.array([-1.0, -1.0, 1.0, 1.0])
    assert bandwidth(ordered) == pytest.approx(0.9 * np.sqrt(4 / 3) * 4**-0.2)


@pytest.mark.parametrize('offset', [0.0, 5e6])
@pytest.mark.parametrize('scale', [1.0, 1e-6, 1e9])
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(2, 300), st.booleans())
def test_density_is_the_sum_of_gaussians(offset, scale, seed, rows, with_atom):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=rows) + 6.0 * (rng.random(rows) < 0.3)
    if with_atom:
        values[: rows // 3] = 0.0
    ordered = np.sort(scale * (values + offset))
    density = estimate(ordered)
    # Any cell, also where there is no sample.
    positions = rng.uniform(density.grid[0], density.grid[-1], size=200)
    positions = np.concatenate([positions, ordered])
    h = bandwidth(ordered)
    exact = h * norm.pdf(positions[:, None], loc=ordered, scale=h).mean(axis=1)
    assert density.bandwidth == h
    largest = max(exact.max(), density.values.max())
    np.testing.assert_allclose(density.at(positions), exact, rtol=0.0, atol=TOLERANCE * largest)


def test_density_integrates_to_one_and_lets_the_padding_fall_to_nothing():
    density = estimate(np.sort(np.random.default_rng(1).normal(size=5000)))
    step = density.grid[1] - density.grid[0]
    assert density.values.sum() * step / density.bandwidth == pytest.approx(1.0, abs=1e-4)
    assert density.values[[0, -1]].max() < 1e-4 * density.values.max()


@pytest.mark.parametrize('far', [1e3, 1e9, 1e250])
def test_one_value_far_out_costs_resolution_but_no_memory(far):
    ordered = np.sort(np.append(np.random.default_rng(2).normal(size=1000), far))
    density = estimate(ordered)
    assert len(density.grid) <= 16384
    assert np.isfinite(density.values).all()
    assert density.at(np.array([far / 2])) == 0.0
    assert (density.at(ordered) > 0.0).all()
