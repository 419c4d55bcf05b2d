# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.learning.conditional.evidence import (
    cluster_evidence,
    needed_evidence,
    visit_evidence,
)


def evidence(counts, seen=0.0):
    counts = np.array([counts], dtype=float)
    shares = np.full(counts.shape[1], 1 / counts.shape[1])
    return visit_evidence(counts, shares, seen)


def test_what_is_as_often_as_expected_proves_nothing():
    assert evidence([5, 5, 5, 5], seen=20) == 0
    assert evidence([0, 0, 0, 0]) == 0
    assert cluster_evidence(np.array([[5, 0, 5, 0]]), 0.5) == 0


def test_the_same_time_in_few_episodes_proves_less():
    spread = [10] * 40
    gathered = [100] * 4 + [0] * 36
    assert evidence(spread) > 3 * evidence(gathered)
    assert cluster_evidence(np.array([spread]), 0.0) > 3 * cluster_evidence(
        np.array([gathered]), 0.0
    )


def test_the_more_is_seen_the_less_is_proven():
    found = [evidence([10] * 40, seen) for seen in (0, 10, 100, 200, 400)]
    assert all(one > other for one, other in zip(found, found[1:], strict=False))


def test_ten_episodes_do_not_prove_a_rule():
    needed = needed_evidence(1000, 0.01)
    assert evidence([10] * 4) < needed
    assert cluster_evidence(np.full((1, 4), 10), 0.0) < needed


def test_the_binomial_bound_is_exact_for_none_of_all():
    counts = np.full((1, 9), 3)
    assert cluster_evidence(counts, 0.0) == pytest.approx(-9 * np.log(1 - 0.9))


def test_however_steady_a_few_clusters_prove_little():
    needed = needed_evidence(1000, 0.01)
    assert evidence([10_000] * 4) <= 4 * np.log(5)
    assert evidence([10_000] * 4) < needed < evidence([10_000] * 8)


def test_more_looks_need_more_evidence():
    assert needed_evidence(1000, 0.01) == pytest.approx(np.log(1e5))
    assert needed_evidence(0, 0.5) == pytest.approx(np.log(2))
