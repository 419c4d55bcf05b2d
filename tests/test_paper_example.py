# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's two-dimensional example, from the recordings in bags/ down to its single rule."""

from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.density import bandwidth
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import RuleCounts, Verdict

BAGS = Path(__file__).resolve().parent.parent / 'bags'


@pytest.fixture(scope='module')
def learned():
    settings = OCTreeSettings(clip='density', alpha=0.5, max_depth=2, full_conditions=True)
    feature_map = load_feature_map('simple_nav')
    paths = [BAGS / 'simple_nav_expert']
    return learn_from_files(paths, feature_map, settings, rng=np.random.default_rng(0))


@pytest.fixture(scope='module')
def straight():
    return extract([BAGS / 'simple_nav_straight'], load_feature_map('simple_nav'))


def test_pruning_leaves_the_single_rule_of_the_paper(learned, straight):
    """x > 0.1 and x < 0.7 and y > 0.3, each bound within two bandwidths of the density."""
    rule_set = learned.rule_set
    counts = RuleCounts(rule_set)
    counts.add(rule_set.judge(straight.values))
    kept = prune(rule_set.with_counts(counts), 0.001).rule_set
    assert len(kept.order) == 1
    rule = kept.rules[kept.order[0]]
    found = {(literal.feature, literal.operator): literal.bound for literal in rule.literals}
    assert set(found) == {(0, '>='), (0, '<='), (1, '>')}
    values = extract([BAGS / 'simple_nav_expert'], load_feature_map('simple_nav')).values
    tolerance = [2 * bandwidth(np.sort(column)) for column in values.T]
    assert found[0, '>='] == pytest.approx(0.1, abs=tolerance[0])
    assert found[0, '<='] == pytest.approx(0.7, abs=tolerance[0])
    assert found[1, '>'] == pytest.approx(0.3, abs=tolerance[1])


def test_the_rules_agree_with_the_truth_on_the_unconstrained_driver(learned, straight):
    flagged = learned.rule_set.judge(straight.values).verdict == Verdict.VIOLATED
    costly = straight.true_cost > 0
    assert costly[flagged].mean() > 0.9
    assert flagged[costly].mean() > 0.85
