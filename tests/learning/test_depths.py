# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import settings as effort
from occ_constraints_pkg.learning.depths import ablate_depth
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from strategies import fit_settings, samples


@effort(max_examples=40)
@given(samples(), fit_settings())
def test_a_tree_that_is_cut_is_the_tree_of_that_depth(values, settings):
    family = tuple(range(values.shape[1] - 1))
    families = (family,) if len(family) > 1 else ()
    heeded = families if settings.clip == 'mass' else ()
    tree = fit_safe_set(values, replace(settings, max_depth=6), families=families)
    deepest = tree.levels(heeded)
    assert deepest <= 6
    assert tree.cut(deepest, heeded) == tree
    for depth in range(deepest):
        limited = fit_safe_set(values, replace(settings, max_depth=depth), families=families)
        assert tree.cut(depth, heeded) == limited
        assert limited.levels(heeded) == depth


def drives():
    """Return episodes in an L-shaped room, and the space of its two features and a family."""
    rng = np.random.default_rng(0)
    rows = rng.random((6000, 4))
    rows = rows[(rows[:, :2] < 0.4).any(axis=1)]
    features = Feature('x'), Feature('y'), Feature('l0', family='l'), Feature('l1', family='l')
    return rows, np.arange(len(rows)) // 200, FeatureSpace(features)


def test_every_depth_is_what_learning_to_that_depth_gives():
    rows, episodes, space = drives()
    settings = OCTreeSettings(alpha=0.9, contamination=0.05, max_depth=5)
    points = np.random.default_rng(1).uniform(-0.1, 1.1, (3000, 4))
    costly = (points[:, :2] > 0.4).all(axis=1).astype(np.float64)
    done = []
    results = ablate_depth(
        rows,
        episodes,
        space,
        settings,
        rng=np.random.default_rng(7),
        truth=(points, costly),
        progress=lambda *numbers: done.append(numbers),
    )
    assert [item.depth for item in results] == list(range(len(results)))
    assert len(results) > 2
    assert done == [(depth + 1, len(results)) for depth in range(len(results))]
    inside = np.ones(len(points), dtype=bool)
    for item in results:
        limited = replace(settings, max_depth=item.depth)
        learned = learn(rows, episodes, space, limited, rng=np.random.default_rng(7))
        assert item.rule_set.rules == learned.rule_set.rules
        assert item.training == learned.coverage['training']
        assert item.held_out == learned.coverage['held_out']
        assert item.rules == len(learned.rule_set.rules) <= item.literals
        safe = item.rule_set.judge(points).verdict == Verdict.SAFE
        assert not (safe & ~inside).any()
        inside = safe
        assert item.score.flagged == (~safe).sum()
        assert item.score.costly == costly.sum()
    assert results[0].training == 1.0


def test_without_truth_and_with_few_episodes():
    rows, _, space = drives()
    results = ablate_depth(
        rows, np.zeros(len(rows)), space, OCTreeSettings(), rng=np.random.default_rng(0)
    )
    assert all(item.held_out is None and item.score is None for item in results)
