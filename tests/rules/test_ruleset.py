# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import itertools
import operator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import (
    Feature,
    FeatureSpace,
    Literal,
    Rule,
    RuleCounts,
    RuleSet,
    Verdict,
    evaluation,
)
from strategies import FINITE, probes, rule_sets

HOLDS = {'<': operator.lt, '<=': operator.le, '>': operator.gt, '>=': operator.ge}
SEEDS = st.integers(0, 2**32 - 1)


def naive_judge(rule_set, sample):
    """Return verdict, first violated rule and the rules tried, one literal after another."""
    for feature, value in zip(rule_set.space.features, sample, strict=True):
        if not np.isfinite(value) or not feature.low <= value <= feature.high:
            return Verdict.UNKNOWN, -1, []
    enabled = [index for index, rule in enumerate(rule_set.rules) if rule.enabled]
    tried = []
    for index in sorted(enabled, key=lambda index: len(rule_set.rules[index].literals)):
        tried.append(index)
        literals = rule_set.rules[index].literals
        if all(
            any(HOLDS[item.operator](sample[member], item.bound) for member in item.members)
            for item in literals
        ):
            return Verdict.VIOLATED, index, tried
    return Verdict.SAFE, -1, tried


def distance_to_violation(rule_set, sample):
    """Return the scaled maximum-norm distance to the closest box of an enabled rule.

    A rule about families has a box for each choice of their members.
    """
    nearest = np.inf
    for rule in rule_set.rules:
        if not rule.enabled:
            continue
        for members in itertools.product(*(item.members for item in rule.literals)):
            low, high = np.full(len(sample), -np.inf), np.full(len(sample), np.inf)
            for item, member in zip(rule.literals, members, strict=True):
                if item.is_upper:
                    high[member] = min(high[member], item.bound)
                else:
                    low[member] = max(low[member], item.bound)
            if (low > high).any():
                continue
            with np.errstate(over='ignore'):
                outside = np.maximum(np.maximum(low - sample, sample - high), 0.0)
                nearest = min(nearest, (outside / rule_set.scale).max())
    return nearest


def mixes_family_and_member(rule):
    return any(
        len(one.members) > 1 and len(other.members) == 1 and other.members[0] in one.members
        for one in rule.literals
        for other in rule.literals
    )


def bounds_of(rule_set):
    bounds = [[feature.low, feature.high] for feature in rule_set.space.features]
    for rule in rule_set.rules:
        for literal in rule.literals:
            for member in literal.members:
                bounds[member].append(literal.bound)
    return bounds


def near(rule_set, seed):
    """Return points at random, on all bounds and beside them."""
    return probes(np.random.default_rng(seed), bounds_of(rule_set))


def one_rule(*literals, features=1, **changes):
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(features)))
    rule = replace(Rule('R', literals), **changes)
    return RuleSet(space, (rule,), np.tile([0.0, 1.0], (features, 1)))


@given(rule_sets() | rule_sets(bounds=FINITE), SEEDS)
def test_judges_and_counts_as_a_loop_over_literals_does(rule_set, seed):
    rows = near(rule_set, seed)
    judgement, counts = rule_set.judge(rows), RuleCounts(rule_set)
    counts.add(judgement)
    singly = RuleCounts(rule_set)
    for row in rows:
        singly.add(rule_set.judge(row[None]))
    evaluated, violated = np.zeros((2, len(rule_set.rules)), dtype=np.int64)
    for row, verdict, rule in zip(rows, judgement.verdict, judgement.rule, strict=True):
        expected_verdict, expected_rule, tried = naive_judge(rule_set, row)
        assert (verdict, rule) == (expected_verdict, expected_rule)
        evaluated[tried] += 1
        violated[tried[-1:]] += rule >= 0
    for counted in (counts, singly):
        np.testing.assert_array_equal(counted.evaluated, evaluated)
        np.testing.assert_array_equal(counted.violated, violated)
    np.testing.assert_array_equal(judgement.cost, judgement.verdict != Verdict.SAFE)


@given(rule_sets() | rule_sets(bounds=FINITE), SEEDS)
def test_margin_of_a_safe_sample_is_the_distance_to_the_nearest_violation(rule_set, seed):
    rows = near(rule_set, seed)
    judgement = rule_set.judge(rows)
    for row, verdict, margin in zip(rows, judgement.verdict, judgement.margin, strict=True):
        if verdict == Verdict.UNKNOWN:
            assert np.isnan(margin)
        elif verdict == Verdict.VIOLATED:
            assert margin <= 0.0
        else:
            assert margin >= 0.0
            distance = distance_to_violation(rule_set, row)
            # 1e-300: where distances underflow, not their ratio to the range counts.
            is_exact = margin == pytest.approx(distance, 1e-12, 1e-300)
            # What one literal needs of a member may be what another forbids it.
            mixed = any(map(mixes_family_and_member, rule_set.rules))
            assert is_exact or (mixed and margin < distance)


@settings(max_examples=50)
@given(rule_sets(enabled=st.just(True)), SEEDS)
def test_margin_of_a_violation_is_a_lower_bound_of_the_way_back(rule_set, seed):
    free = FeatureSpace(
        tuple(Feature(item.name, family=item.family) for item in rule_set.space.features)
    )
    rule_set = replace(rule_set, space=free)
    rows = near(rule_set, seed)
    judgement = rule_set.judge(rows)
    step = np.random.default_rng(seed).choice([-0.999, 0.0, 0.999], size=rows.shape)
    distance = np.where(judgement.verdict == Verdict.VIOLATED, -judgement.margin, 0.0)
    assume(np.isfinite(distance).all())
    moved = rule_set.judge(rows + step * distance[:, None] * rule_set.scale)
    still = moved.verdict[distance > 1e-9]
    assert (still == Verdict.VIOLATED).all()


@settings(max_examples=50)
@given(rule_sets(), SEEDS, st.sampled_from([np.nan, np.inf, -np.inf]))
def test_what_is_not_finite_is_unknown(rule_set, seed, number):
    rows = near(rule_set, seed)
    rows[:, np.random.default_rng(seed).integers(rows.shape[1])] = number
    judgement = rule_set.judge(rows)
    assert (judgement.verdict == Verdict.UNKNOWN).all()
    assert (judgement.rule == -1).all()
    assert np.isnan(judgement.margin).all()
    assert (judgement.cost == 1.0).all()


@pytest.mark.parametrize('symbol', list(HOLDS))
@settings(max_examples=30)
@given(hnp.arrays(np.float64, (4, 2), elements=st.floats()))
def test_no_number_outside_the_physical_bounds_is_safe(symbol, rows):
    space = FeatureSpace((Feature('x', '1', 0.0, 1.0), Feature('y', 'm', -1.0)))
    rule_set = RuleSet(space, (Rule('R', (Literal(0, symbol, 0.5),)),), np.array([[0, 1]] * 2))
    for row, verdict in zip(rows, rule_set.judge(rows).verdict, strict=True):
        if verdict == Verdict.SAFE:
            assert 0.0 <= row[0] <= 1.0
            assert -1.0 <= row[1] < np.inf


def test_unbounded_features_take_the_largest_floats():
    largest = np.finfo(np.float64).max
    rule_set = one_rule(Literal(0, '>=', -largest))
    assert (rule_set.judge([[-largest], [largest]]).verdict == Verdict.VIOLATED).all()
    rule_set = one_rule(Literal(0, '>', largest))
    assert (rule_set.judge([[-largest], [largest]]).verdict == Verdict.SAFE).all()


def test_minus_zero_equals_zero():
    for symbol, verdict in (('<', 0), ('<=', 1), ('>', 0), ('>=', 1)):
        for bound in (0.0, -0.0):
            judged = one_rule(Literal(0, symbol, bound)).judge([[0.0], [-0.0]])
            assert (judged.verdict == verdict).all()


@pytest.mark.parametrize('rows', [0, 1, 40, 41, 999, 1000, 1001, 5000])
def test_blocks_of_rows_join_without_a_seam(monkeypatch, rows):
    monkeypatch.setattr(evaluation, '_BLOCK', 2000)
    rng = np.random.default_rng(rows)
    rule_set = one_rule(Literal(0, '>', 0.9), Literal(1, '<=', 0.5), features=2)
    values = rng.random((rows, 2))
    whole = rule_set.judge(values)
    violated = (values[:, 0] > 0.9) & (values[:, 1] <= 0.5)
    np.testing.assert_array_equal(whole.verdict, violated)
    np.testing.assert_array_equal(whole.rule, np.where(violated, 0, -1))
    margin = np.maximum(0.9 - values[:, 0], values[:, 1] - 0.5)
    np.testing.assert_allclose(whole.margin, margin, rtol=1e-12)


@pytest.mark.parametrize('rules', [(), (Rule('R', (Literal(0, '>', 0.0),), enabled=False),)])
def test_without_enabled_rules_all_that_is_known_is_safe(rules):
    space = FeatureSpace((Feature('x', '1', -1.0, 1.0),))
    rule_set = RuleSet(space, rules, np.array([[0.0, 1.0]]))
    judgement, counts = rule_set.judge([[0.5], [2.0], [np.nan]]), RuleCounts(rule_set)
    counts.add(judgement)
    assert judgement.verdict.tolist() == [Verdict.SAFE, Verdict.UNKNOWN, Verdict.UNKNOWN]
    assert judgement.margin[0] == np.inf
    assert not counts.evaluated.any()
    assert not rule_set.violated_rules([0.5]).size
    assert np.isnan(rule_set.rule_margins([0.5])).all()


@settings(max_examples=50)
@given(rule_sets(), SEEDS)
def test_rules_one_by_one_agree_with_the_judgement(rule_set, seed):
    rows = near(rule_set, seed)[:8]
    judgement = rule_set.judge(rows)
    enabled = np.array([rule.enabled for rule in rule_set.rules], dtype=bool)
    for place, row in enumerate(rows):
        if judgement.verdict[place] == Verdict.UNKNOWN:
            continue
        violated, margins = rule_set.violated_rules(row), rule_set.rule_margins(row)
        assert (len(violated) > 0) == (judgement.verdict[place] == Verdict.VIOLATED)
        assert judgement.rule[place] == (violated[0] if len(violated) else -1)
        assert (np.isnan(margins) == ~enabled).all()
        assert (margins[violated] <= 0.0).all()
        assert margins[enabled].min(initial=np.inf) == judgement.margin[place]


def test_rules_are_tried_by_length_and_then_in_their_order():
    one, other = Literal(0, '>', 0.0), Literal(0, '<', 5.0)
    rules = (
        Rule('long', (one, other)),
        Rule('first', (one,)),
        Rule('off', (one,), enabled=False),
        Rule('second', (other,)),
    )
    rule_set = RuleSet(FeatureSpace((Feature('x'),)), rules, np.array([[0.0, 1.0]]))
    assert rule_set.order.tolist() == [1, 3, 0]
    counts = RuleCounts(rule_set)
    counts.add(rule_set.judge([[1.0], [-1.0], [np.nan]]))
    counts.add(rule_set.judge([[9.0]]))
    assert counts.evaluated.tolist() == [0, 3, 0, 1]
    assert counts.violated.tolist() == [0, 2, 0, 1]
    counted = rule_set.with_counts(counts)
    assert [rule.evaluated for rule in counted.rules] == [0, 3, 0, 1]
    assert [rule.violated for rule in counted.rules] == [0, 2, 0, 1]
    counts.reset()
    assert not counts.evaluated.any()
    assert not counts.violated.any()


def test_a_constant_feature_is_measured_in_its_unit():
    rule_set = replace(one_rule(Literal(0, '>', 2.0)), demonstrated=np.array([[1.0, 1.0]]))
    assert rule_set.judge([[0.5]]).margin == 1.5
    rule_set = replace(rule_set, demonstrated=np.array([[1.0, 5.0]]))
    assert rule_set.judge([[0.0]]).margin == 0.5
    rule_set = replace(rule_set, demonstrated=np.array([[0.0, 5e-324]]))
    assert rule_set.judge([[2.0]]).margin == 0.0


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'demonstrated': np.zeros((2, 2))}, r'must be of shape \(1, 2\), got \(2, 2\)'),
        ({'demonstrated': np.array([[0.0, np.nan]])}, "'x0' has the demonstrated range"),
        ({'demonstrated': np.array([[1.0, 0.0]])}, "'x0' has the demonstrated range"),
        ({'demonstrated': np.array([[0.0, np.inf]])}, "'x0' has the demonstrated range"),
        ({'rules': (Rule('A', (Literal(0, '>', 1.0),)),) * 2}, "'A' is used twice"),
        (
            {'rules': (Rule('A', (Literal(0, '>', 2.0), Literal(0, '<', 1.0))),)},
            "'A' can never be true: x0 > 2.0 and x0 < 1.0",
        ),
    ],
)
def test_rule_sets_that_make_no_sense(change, sentence):
    with pytest.raises(OccError, match=sentence):
        replace(one_rule(Literal(0, '>', 0.0)), **change)


@pytest.mark.parametrize('values', [[1.0, 2.0], [[1.0], [2.0]], [[[1.0, 2.0]]]])
def test_rows_of_another_shape(values):
    with pytest.raises(OccError, match=r'rows of 2 features \(x0, x1\)'):
        one_rule(Literal(0, '>', 0.0), features=2).judge(values)


@settings(max_examples=30)
@given(rule_sets())
def test_fingerprint_names_the_formula_only(rule_set):
    same = replace(
        rule_set,
        rules=tuple(replace(rule, note='seen', evaluated=9, violated=1) for rule in rule_set.rules),
        demonstrated=rule_set.demonstrated * 2.0,
    )
    assert same.fingerprint == rule_set.fingerprint
    assume(len(rule_set.order))
    first = rule_set.order[0]
    rules = list(rule_set.rules)
    rules[first] = replace(rules[first], enabled=False)
    assert replace(rule_set, rules=tuple(rules)).fingerprint != rule_set.fingerprint
    literal = rules[first].literals[0]
    moved = replace(literal, bound=float(np.nextafter(literal.bound, np.inf)))
    rules[first] = replace(rules[first], literals=(moved, *rules[first].literals[1:]), enabled=True)
    assume(not rules[first].is_contradictory)
    assert replace(rule_set, rules=tuple(rules)).fingerprint != rule_set.fingerprint
