# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Every way to evaluate rules agrees, bit for bit, with a plain loop over literals."""

import copy
import math
import operator
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules import evaluation as evaluation_module
from occ_constraints_pkg.rules import ruleset as ruleset_module
from occ_constraints_pkg.rules.evaluation import factor
from strategies import FINITE, probes, rule_sets, trees

HOLDS = {'<': operator.lt, '<=': operator.le, '>': operator.gt, '>=': operator.ge}
ODD = [math.nan, math.inf, -math.inf, 1.7976931348623157e308, 5e-324, 0.0, -0.0, -1e-310]


def reference(rule_set, sample):
    """Return (verdict, rule, margin) of a list of floats."""
    for feature, value in zip(rule_set.space.features, sample, strict=True):
        if not math.isfinite(value) or not feature.low <= value <= feature.high:
            return Verdict.UNKNOWN, -1, math.nan
    first, smallest = -1, math.inf
    for index in sorted(
        (index for index, rule in enumerate(rule_set.rules) if rule.enabled),
        key=lambda index: len(rule_set.rules[index].literals),
    ):
        literals = rule_set.rules[index].literals
        if first < 0 and all(
            any(HOLDS[it.operator](sample[member], it.bound) for member in it.members)
            for it in literals
        ):
            first = index
        margins = []
        for it in literals:
            away = [sample[member] - it.bound for member in it.members]
            away = min(away) if it.is_upper else -max(away)
            margins.append(away / float(rule_set.scale[it.members[0]]))
        smallest = min(smallest, max(margins))
    verdict = Verdict.SAFE if first < 0 else Verdict.VIOLATED
    return verdict, first, smallest + 0.0


@st.composite
def learned(draw):
    """Rules as a tree gives them: many share the beginning of their conditions."""
    root, space, demonstrated = draw(trees())
    return extract_rules(root, space, demonstrated, full_conditions=draw(st.booleans()))


ANY_RULES = rule_sets(most_rules=10) | rule_sets(bounds=FINITE) | learned()


def points(rule_set, seed):
    """Return points on all bounds and beside them; some with numbers that are odd."""
    rng = np.random.default_rng(seed)
    bounds = [[feature.low, feature.high] for feature in rule_set.space.features]
    for rule in rule_set.rules:
        for literal in rule.literals:
            for member in literal.members:
                bounds[member].append(literal.bound)
    rows = probes(rng, bounds)
    odd = rng.random(rows.shape) < 0.1
    rows[odd] = rng.choice(ODD, size=odd.sum())
    return rows


def assert_same_bits(got, expected):
    __tracebackhide__ = True
    np.testing.assert_array_equal(got, expected)
    known = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(got[known]), np.signbit(expected[known]))


def assert_all_ways_agree(rule_set, rows):
    __tracebackhide__ = True
    judged = [reference(rule_set, row) for row in rows.tolist()]
    verdict, rule, margin = map(np.array, zip(*judged, strict=True))
    singles = [rule_set.judge(row[None]) for row in rows]
    few = [rule_set.judge(rows[start : start + 5]) for start in range(0, len(rows), 5)]
    for parts in ([rule_set.judge(rows)], singles, few):
        np.testing.assert_array_equal(np.concatenate([part.verdict for part in parts]), verdict)
        np.testing.assert_array_equal(np.concatenate([part.rule for part in parts]), rule)
        assert_same_bits(np.concatenate([part.margin for part in parts]), margin)
    np.testing.assert_array_equal(rule_set.verdicts(rows), verdict)
    assert [rule_set.verdict(row) for row in rows] == verdict.tolist()


@settings(max_examples=150)
@given(ANY_RULES, st.integers(0, 2**32 - 1))
def test_all_ways_agree_with_a_loop(rule_set, seed):
    assert_all_ways_agree(rule_set, points(rule_set, seed))


@settings(max_examples=30)
@given(ANY_RULES, st.integers(0, 2**32 - 1))
def test_large_rule_sets_and_small_blocks_agree_too(rule_set, seed):
    with pytest.MonkeyPatch.context() as patch:
        # Column by column even for few samples, and several blocks with a rest.
        patch.setattr(ruleset_module, '_FEW_LITERALS', 0)
        patch.setattr(ruleset_module, '_BLOCK', 7)
        patch.setattr(evaluation_module, '_BLOCK', 0)
        patch.setattr(evaluation_module, '_FEWEST_ROWS', 11)
        assert_all_ways_agree(rule_set, points(rule_set, seed))


def depth(formula):
    return 1 + max((depth(inner) for _, inner in formula.parts), default=0)


def test_conditions_nested_deeper_than_is_factored():
    count = 120
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(count)))
    rules = tuple(
        Rule(f'R{i}', (*(Literal(j, '>', 0.0) for j in range(i)), Literal(i, '<=', -0.25)))
        for i in range(2, count)
    )
    assert 10 < depth(factor(rules)) < 40
    rng = np.random.default_rng(0)
    rows = np.where(rng.random((64, count)) < 0.98, 1.0, rng.choice([-1.0, -0.1], (64, count)))
    rule_set = RuleSet(space, rules, np.tile([0.0, 2.0], (count, 1)))
    assert_all_ways_agree(rule_set, rows)


def test_rules_of_very_unequal_lengths():
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(100)))
    long = Rule('long', tuple(Literal(index, '>=', 0.0) for index in range(100)))
    short = tuple(Rule(f'R{index}', (Literal(index, '<', -2.0),)) for index in range(60))
    rule_set = RuleSet(space, (long, *short), np.tile([0.0, 2.0], (100, 1)))
    rows = np.random.default_rng(0).normal(size=(40, 100))
    rows[::3] = np.abs(rows[::3])
    assert_all_ways_agree(rule_set, rows)


def test_common_conditions_are_factored_out_and_implied_rules_dropped():
    a, b, c, d = (Literal(index, '>', 1.0) for index in range(4))
    wide = Literal(3, '>', 0.5)
    formula = factor([Rule('1', (a, b)), Rule('2', (a, c)), Rule('3', (d, a)), Rule('4', (wide,))])
    assert [group.literals for group in formula.ends] == [(wide,)]
    ((condition, inner),) = formula.parts
    assert [group.literals for group in condition] == [(a,)]
    assert [group.literals for group in inner.ends] == [(b,), (c,)]
    assert inner.parts == ()


def test_names_and_kinds_of_numbers_do_not_matter():
    space = FeatureSpace((Feature('x0): raise SystemExit #'), Feature('import os', '1', 0.0, 1.0)))
    literals = Literal(np.int64(0), '>', np.float64(0.1)), Literal(1, '<=', np.float32(0.5))
    rule_set = RuleSet(space, (Rule('"""', literals),), np.array([[0.0, 1.0], [0.0, 1.0]]))
    rows = np.array([[0.1, 0.5], [np.nextafter(0.1, 1.0), 0.5], [5.0, 1.5]])
    assert [rule_set.verdict(row) for row in rows] == [0, 1, 2]
    assert rule_set.verdict([1, 0]) is Verdict.VIOLATED
    assert rule_set.verdict(rows[1].astype(np.float32)) is Verdict.VIOLATED
    assert_all_ways_agree(rule_set, rows)


def test_a_rule_set_that_has_judged_can_be_pickled_and_copied():
    space = FeatureSpace((Feature('x'),))
    rule_set = RuleSet(space, (Rule('R', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]]))
    rows = np.array([[0.0], [2.0]])
    rule_set.judge(rows)
    for other in (pickle.loads(pickle.dumps(rule_set)), copy.deepcopy(rule_set)):
        assert other.fingerprint == rule_set.fingerprint
        assert_all_ways_agree(other, rows)


def test_one_sample_of_another_shape():
    space = FeatureSpace((Feature('x'), Feature('y')))
    rule_set = RuleSet(space, (), np.array([[0.0, 1.0], [0.0, 1.0]]))
    for sample in ([1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], 1.0):
        with pytest.raises(OccError, match='2 features'):
            rule_set.verdict(sample)


def test_more_features_than_can_be_written_as_python():
    count = 6000
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(count)))
    rules = (Rule('A', (Literal(7, '>', 0.5), Literal(count - 1, '<', 0.5))),)
    rule_set = RuleSet(space, rules, np.tile([0.0, 1.0], (count, 1)))
    rows = np.zeros((3, count))
    rows[1, 7], rows[2, 2000] = 1.0, np.nan
    assert_all_ways_agree(rule_set, rows)


@pytest.mark.parametrize('feature', [-1, 2])
def test_a_literal_on_a_feature_that_is_not_there(feature):
    space = FeatureSpace((Feature('x'), Feature('y')))
    with pytest.raises(OccError, match=f"rule 'R' speaks of feature {feature}; allowed are 0 to 1"):
        RuleSet(space, (Rule('R', (Literal(feature, '>', 0.0),)),), np.zeros((2, 2)))
