# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Features of one family, such as the sectors of a lidar, get the same bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from occ_constraints_pkg.rules.constraints_file import parse_constraints


def sectors(rng, samples, members=4):
    """Mostly empty sectors; the first one is seldom seen close up."""
    values = rng.beta(2, 4, (samples, members)) * (rng.uniform(size=(samples, members)) < 0.5)
    values[:, 0] *= 0.5
    return values


def space(members=4, **changes):
    features = [Feature(f'd_{i}', low=0.0, high=1.0, family='lidar') for i in range(members)]
    return FeatureSpace((Feature('v', 'm/s', **changes), *features))


@pytest.fixture(scope='module')
def learned():
    rng = np.random.default_rng(1)
    values = np.column_stack([rng.normal(size=20000), sectors(rng, 20000)])
    constraints = learn(
        values, np.zeros(20000), space(), OCTreeSettings(contamination=0.01), rng=rng
    )
    return values, constraints


def test_all_members_get_one_rule_and_empty_sectors_no_lower_one(learned):
    rule_set = learned[1].rule_set
    (rule,) = (rule for rule in rule_set.rules if rule.literals[0].members != (0,))
    (literal,) = rule.literals
    assert (literal.feature, literal.operator) == ((1, 2, 3, 4), '>')
    assert rule.formula(rule_set.space) == f'any lidar > {literal.bound!r}'


def test_the_share_outside_keeps_within_the_contamination(learned):
    values, constraints = learned
    outside = np.mean(constraints.rule_set.judge(values).verdict != Verdict.SAFE)
    assert 0.002 < outside <= 0.01


def test_a_direction_that_was_hardly_shown_is_not_bounded_tighter(learned):
    """Alone, the first sector would be cut at about half of the others' bound."""
    values, constraints = learned
    alone = fit_safe_set(values[:, 1:], OCTreeSettings()).leaf_boxes(4)[0, :, 1]
    together = fit_safe_set(values[:, 1:], OCTreeSettings(), families=[range(4)]).leaf_boxes(4)[
        0, :, 1
    ]
    assert alone[0] < 0.7 * alone[1]
    assert len(set(together)) == 1
    assert together[0] > alone[0]


def test_the_article_knows_no_families():
    values = sectors(np.random.default_rng(2), 2000)
    faithful = OCTreeSettings(clip='density')
    assert fit_safe_set(values, faithful, families=[range(4)]) == fit_safe_set(values, faithful)


@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 0.2), sides=st.sampled_from('ulb'))
@settings(max_examples=60)
def test_no_more_than_the_share_is_left_outside(seed, share, sides):
    """Whether the family has an upper spike, a lower one, or both."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(300, 3))
    if sides in 'lb':
        values = np.maximum(values, -0.2)
    if sides in 'ub':
        values = np.minimum(values, 0.3)
    tree = fit_safe_set(values, OCTreeSettings(contamination=share), families=[range(3)])
    assert np.mean(~tree.contains(values)) <= share + 1e-12
    boxes = tree.leaf_boxes(3)
    assert len(boxes) == 1
    assert (boxes[0] == boxes[0, 0]).all()


def test_members_share_unit_and_bounds():
    with pytest.raises(OccError, match="'a' and 'b' of family 'f' differ in unit or bounds"):
        FeatureSpace((Feature('a', 'm', family='f'), Feature('b', 's', family='f')))
    assert FeatureSpace((Feature('a', family='f'), Feature('b'))).families == ()


def test_families_are_kept_in_the_files(learned):
    constraints = learned[1]
    assert (
        parse_constraints(constraints.dumps(), 'file').rule_set.space == constraints.rule_set.space
    )
    feature_map = load_feature_map('PointGoal1')
    again = type(feature_map).from_document(feature_map.to_document(), 'map')
    assert again.space.families == (tuple(range(4, 20)),)


@pytest.mark.parametrize('contamination', [None, 0.02])
def test_families_are_bounded_alike_where_other_features_split(contamination):
    rng = np.random.default_rng(4)
    lanes = rng.normal(size=4000) + 20.0 * rng.integers(0, 2, 4000)
    values = np.column_stack([lanes, sectors(rng, 4000)])
    options = OCTreeSettings(alpha=0.5, contamination=contamination)
    tree = fit_safe_set(values, options, families=[range(1, 5)], limits=space_limits())
    boxes = tree.leaf_boxes(5)
    assert len(boxes) == 2
    for box in boxes:
        assert len({tuple(ends) for ends in box[1:]}) == 1
    assert np.mean(~tree.contains(values)) <= 0.05


def space_limits():
    return np.stack([space().lows, space().highs], axis=1)
