# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from strategies import fit_settings, probes, samples, tree_bounds, trees

SEEDS = st.integers(0, 2**32 - 1)
LEAF = Node()


def safe_set(root, demonstrated, rows):
    """Tell for each row whether it lies in a leaf's box and in the demonstrated one."""
    boxes = root.leaf_boxes(len(demonstrated))
    boxes[..., 0] = np.maximum(boxes[..., 0], demonstrated[:, 0])
    boxes[..., 1] = np.minimum(boxes[..., 1], demonstrated[:, 1])
    inside = (rows[:, None] >= boxes[..., 0]) & (rows[:, None] <= boxes[..., 1])
    return inside.all(axis=2).any(axis=1)


def check_complement(root, space, demonstrated, rng, *, full=False):
    rows = probes(rng, tree_bounds(root, space, demonstrated), rows=200)
    rule_set = extract_rules(root, space, demonstrated, full_conditions=full)
    judgement = rule_set.judge(rows)
    possible = ((rows >= space.lows) & (rows <= space.highs)).all(axis=1)
    np.testing.assert_array_equal(judgement.verdict == Verdict.UNKNOWN, ~possible)
    expected = np.where(safe_set(root, demonstrated, rows), Verdict.SAFE, Verdict.VIOLATED)
    np.testing.assert_array_equal(judgement.verdict[possible], expected[possible])
    return rule_set


@effort(max_examples=200)
@given(trees(), st.booleans(), SEEDS)
def test_rules_are_the_complement_of_any_tree(tree, full, seed):
    check_complement(*tree, np.random.default_rng(seed), full=full)


@effort(max_examples=60)
@given(samples(), fit_settings(), st.booleans(), SEEDS)
def test_rules_are_the_complement_of_learned_trees(values, settings, has_bounds, seed):
    tree = fit_safe_set(values, settings)
    demonstrated = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    limits = demonstrated if has_bounds else np.full(demonstrated.shape, [-np.inf, np.inf])
    space = FeatureSpace(
        tuple(Feature(f'x{index}', '1', *limits[index]) for index in range(len(limits)))
    )
    rule_set = check_complement(tree, space, demonstrated, np.random.default_rng(seed))
    judged = rule_set.judge(values).verdict == Verdict.SAFE
    np.testing.assert_array_equal(judged, tree.contains(values))


@given(trees(), st.booleans())
def test_every_rule_can_be_true_and_says_nothing_twice(tree, full):
    root, space, demonstrated = tree
    rule_set = extract_rules(root, space, demonstrated, full_conditions=full)
    assert [len(rule.literals) for rule in rule_set.rules] == sorted(
        len(rule.literals) for rule in rule_set.rules
    )
    assert len({rule.id for rule in rule_set.rules}) == len(rule_set.rules)
    assert len({frozenset(rule.literals) for rule in rule_set.rules}) == len(rule_set.rules)
    alone = [rule.literals[0] for rule in rule_set.rules if len(rule.literals) == 1]
    assert len({(item.feature, item.operator) for item in alone}) == len(alone)
    for rule in rule_set.rules:
        sides = [(item.feature, item.is_upper) for item in rule.literals]
        assert len(set(sides)) == len(sides)
        for item in rule.literals:
            if item.operator == '<':
                assert item.bound > space.lows[item.feature]
            if item.operator == '>':
                assert item.bound < space.highs[item.feature]


def formulas(root, features, demonstrated, **options):
    space = FeatureSpace(features)
    rule_set = extract_rules(root, space, np.array(demonstrated, dtype=np.float64), **options)
    return [rule.formula(space) for rule in rule_set.rules]


def test_a_lone_leaf_gives_minimum_and_maximum_of_every_feature():
    features = Feature('x'), Feature('y', 'm', 0.0, 9.0), Feature('z', 'm', 0.0, 9.0)
    assert formulas(LEAF, features, [[1, 2], [0, 9], [0, 8]]) == [
        'x < 1.0',
        'x > 2.0',
        # y reaches its physical bounds, and z the lower one.
        'z > 8.0',
    ]


def test_a_feature_that_is_never_cut_keeps_its_minimum_and_maximum():
    root = Node(0, (Branch(0.2, 0.8, 1, LEAF),))
    assert formulas(root, (Feature('x'), Feature('y')), [[0, 1], [3, 4]]) == [
        'x < 0.2',
        'x > 0.8',
        'y < 3.0',
        'y > 4.0',
    ]


def test_the_papers_navigation_example():
    # Section "Formula Extraction"; the children there share the bound 0.7.
    root = Node(
        0,
        (
            Branch(0.1, 0.7, 1, Node(1, (Branch(0.1, 0.3, 1, LEAF),))),
            Branch(0.75, 0.9, 1, Node(1, (Branch(0.1, 0.9, 1, LEAF),))),
        ),
    )
    features, box = (Feature('x'), Feature('y')), [[0.1, 0.9], [0.1, 0.9]]
    common = ['x < 0.1', 'x > 0.9', 'y < 0.1', 'y > 0.9', 'x > 0.7 and x < 0.75']
    assert formulas(root, features, box) == [*common, 'x <= 0.7 and y > 0.3']
    assert formulas(root, features, box, full_conditions=True) == [
        *common,
        'x >= 0.1 and x <= 0.7 and y > 0.3',
    ]


def test_a_chain_of_single_branches_gives_rules_of_one_literal():
    root = LEAF
    for feature in (2, 1, 0):
        root = Node(feature, (Branch(feature + 0.25, feature + 0.75, 1, root),))
    features = Feature('x'), Feature('y'), Feature('z')
    assert formulas(root, features, [[0, 1], [1, 2], [2, 3]]) == [
        'x < 0.25',
        'x > 0.75',
        'y < 1.25',
        'y > 1.75',
        'z < 2.25',
        'z > 2.75',
    ]


def test_a_feature_cut_again_states_only_what_tells_siblings_apart():
    inner = Node(0, (Branch(0.1, 0.2, 1, LEAF), Branch(0.3, 0.4, 1, LEAF)))
    root = Node(0, (Branch(0.0, 0.5, 1, inner), Branch(0.6, 1.0, 1, LEAF)))
    assert formulas(root, (Feature('x'),), [[0.0, 1.0]]) == [
        'x < 0.1',
        'x > 1.0',
        'x > 0.5 and x < 0.6',
        'x > 0.2 and x < 0.3',
        'x > 0.4 and x <= 0.5',
    ]


def test_a_gap_that_holds_no_number_gives_no_rule():
    right = float(np.nextafter(0.5, 1.0))
    root = Node(0, (Branch(0.0, 0.5, 1, LEAF), Branch(right, 1.0, 1, LEAF)))
    assert formulas(root, (Feature('x'),), [[0.0, 1.0]]) == ['x < 0.0', 'x > 1.0']


def test_full_conditions_state_both_bounds_of_a_branch_but_no_physical_one():
    """As in the paper's example; a bound at a physical limit says nothing."""
    space = FeatureSpace((Feature('x', low=0.0, high=1.0), Feature('y', low=0.0, high=1.0)))
    below = Node(1, (Branch(0.1, 0.3, 1, Node()),))
    right = Node(1, (Branch(0.1, 0.9, 1, Node()),))
    tree = Node(0, (Branch(0.1, 0.7, 1, below), Branch(0.75, 1.0, 1, right)))
    demonstrated = np.array([[0.1, 1.0], [0.1, 0.9]])
    rules = extract_rules(tree, space, demonstrated, full_conditions=True).rules
    words = {rule.words(space) for rule in rules}
    assert 'x from 0.1 to 0.7 and y above 0.3' in words
    assert not any(word == '1' for text in words for word in text.split())
