# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.conditional.forest import group_rules, safe_forest, safe_tree
from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, Literal

COARSE = st.integers(-4, 4).map(lambda number: number / 2)
OPERATORS = ('<', '<=', '>', '>=')
FEATURES = 6
FAMILIES = {'near': (2, 3), 'far': (4, 5)}


def literals(bounds):
    single = st.builds(
        Literal,
        st.integers(0, FEATURES - 1).map(lambda one: (one,)),
        st.sampled_from(OPERATORS),
        bounds,
    )
    family = st.builds(
        lambda name, operator, bound: Literal(FAMILIES[name], operator, bound, name),
        st.sampled_from(sorted(FAMILIES)),
        st.sampled_from(OPERATORS),
        bounds,
    )
    return st.one_of(single, family)


def rule_lists(bounds):
    rule = st.lists(literals(bounds), min_size=1, max_size=3).map(
        lambda found: ConditionalRule(tuple(found), 0.1, 0.0, 20.0)
    )
    return st.lists(rule, min_size=1, max_size=6)


def probes(rules, rng, rows=300):
    """Return samples on bounds, on their neighbours, and far off."""
    bounds = [literal.bound for rule in rules for literal in rule.literals]
    values = np.array([*bounds, -1e308, 1e308, 0.0, -0.0])
    with np.errstate(over='ignore'):
        beside = [np.nextafter(values, -np.inf), np.nextafter(values, np.inf)]
    values = np.unique(np.concatenate([values, *beside]))
    return rng.choice(values[np.isfinite(values)], size=(rows, FEATURES))


def check(rules, seed):
    rows = probes(rules, np.random.default_rng(seed))
    flagged = np.any([rule.holds(rows) for rule in rules], axis=0)
    forest = safe_forest(rules)
    inside = np.all([tree.contains(rows) for tree in forest], axis=0)
    np.testing.assert_array_equal(flagged, ~inside)
    for tree in forest:
        counts = np.zeros(len(rows), dtype=int)
        for box in tree.boxes():
            within = np.ones(len(rows), dtype=bool)
            for feature, (low, high) in box.items():
                assert low <= high
                within &= (rows[:, feature] >= low) & (rows[:, feature] <= high)
            counts += within
        assert counts.max(initial=0) <= 1
        np.testing.assert_array_equal(counts == 1, tree.contains(rows))


@effort(max_examples=300, deadline=None)
@given(rule_lists(COARSE), st.integers(0, 2**32 - 1))
def test_some_rule_is_true_exactly_outside_the_disjoint_boxes(rules, seed):
    check(rules, seed)


@effort(max_examples=150, deadline=None)
@given(rule_lists(st.floats(allow_nan=False, allow_infinity=False)), st.integers(0, 2**32 - 1))
def test_so_it_is_with_any_finite_bounds(rules, seed):
    check(rules, seed)


def rule(*literals):
    return ConditionalRule(tuple(Literal(*literal) for literal in literals), 0.1, 0.0, 20.0)


def test_a_staircase_has_a_leaf_more_than_steps():
    steps = [rule(((0,), '>', speed), ((1,), '<', speed)) for speed in (0.5, 1.0, 1.5, 2.0)]
    assert len(list(safe_tree(steps).boxes())) == 5


def test_rules_that_share_no_feature_have_trees_of_their_own():
    one = rule(((0,), '>', 1.0), ((1,), '<', 1.0))
    other = rule(((2,), '>', 1.0), ((3,), '<', 1.0))
    between = rule(((1,), '>', 2.0), ((4,), '<', 1.0))
    assert group_rules([one, other, between]) == [[one, between], [other]]
    assert [tree.feature in (0, 1, 4) for tree in safe_forest([one, other, between])] == [
        True,
        False,
    ]


def test_a_family_is_a_chain_below_the_other_condition():
    near = Literal(tuple(range(1, 17)), '>', 0.9, 'hazards')
    both = ConditionalRule((near, Literal((0,), '>', 1.0)), 0.1, 0.0, 20.0)
    boxes = list(safe_tree([both]).boxes())
    assert len(boxes) == 2
    assert len(boxes[1]) == 17


def test_a_rule_that_is_always_true_leaves_no_leaf():
    always = rule(((0,), '<=', 1.0))
    never_less = rule(((0,), '>', 1.0))
    assert list(safe_tree([always, never_less]).boxes()) == []
