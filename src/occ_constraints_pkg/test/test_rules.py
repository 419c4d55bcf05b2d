# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What literals, rules and rule sets mean, at bounds and for values that are none."""

import math

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict

INF, NAN = math.inf, math.nan
# Operator, value, whether it is true of the bound 0.5.
TRUTHS = [
    ('<', 0.4, True),
    ('<', 0.5, False),
    ('<', 0.6, False),
    ('<=', 0.4, True),
    ('<=', 0.5, True),
    ('<=', 0.6, False),
    ('>', 0.4, False),
    ('>', 0.5, False),
    ('>', 0.6, True),
    ('>=', 0.4, False),
    ('>=', 0.5, True),
    ('>=', 0.6, True),
]


@pytest.fixture
def space():
    return FeatureSpace((Feature('v', 'm/s', 0.0, 2.0), Feature('gap', 'm', 0.0, 5.0)))


@pytest.fixture
def rule_set(space):
    """Fast is forbidden, and so is less fast near something."""
    rules = (
        Rule('fast', (Literal(0, '>', 1.0),)),
        Rule('near', (Literal(0, '>', 0.5), Literal(1, '<', 1.0))),
    )
    return RuleSet(space, rules, np.array([[0.0, 0.5], [1.0, 4.0]]))


@pytest.mark.parametrize(('operator', 'value', 'truth'), TRUTHS)
def test_a_literal_is_true_as_its_operator_says(operator, value, truth):
    assert Literal(0, operator, 0.5).holds(np.array([value])).tolist() == [truth]


@pytest.mark.parametrize(('operator', 'value', 'truth'), TRUTHS)
def test_a_rule_of_one_literal_violates_where_it_is_true(space, operator, value, truth):
    rules = (Rule('R', (Literal(0, operator, 0.5),)),)
    judgement = RuleSet(space, rules, np.array([[0.0, 0.0], [2.0, 5.0]])).judge(
        np.array([[value, 2.0]])
    )
    assert (Verdict(judgement.verdict[0]) is Verdict.VIOLATED) == truth
    assert judgement.cost.tolist() == [1.0 if truth else 0.0]


@pytest.mark.parametrize(
    ('values', 'verdict', 'rule'),
    [
        ((0.2, 3.0), Verdict.SAFE, -1),
        ((0.6, 3.0), Verdict.SAFE, -1),
        ((0.5, 0.5), Verdict.SAFE, -1),
        ((0.6, 1.0), Verdict.SAFE, -1),
        ((0.6, 0.9), Verdict.VIOLATED, 1),
        ((1.0, 3.0), Verdict.SAFE, -1),
        ((1.1, 3.0), Verdict.VIOLATED, 0),
        ((1.1, 0.5), Verdict.VIOLATED, 0),
        ((NAN, 3.0), Verdict.UNKNOWN, -1),
        ((1.1, NAN), Verdict.UNKNOWN, -1),
        ((INF, 3.0), Verdict.UNKNOWN, -1),
        ((0.2, -INF), Verdict.UNKNOWN, -1),
        ((-0.1, 3.0), Verdict.UNKNOWN, -1),
        ((0.2, 5.1), Verdict.UNKNOWN, -1),
    ],
)
def test_a_rule_set_judges_one_sample_as_many(rule_set, values, verdict, rule):
    judgement = rule_set.judge(np.array([values, (0.2, 3.0)]))
    assert Verdict(judgement.verdict[0]) is verdict
    assert judgement.rule[0] == rule
    assert judgement.cost.tolist() == [0.0 if verdict is Verdict.SAFE else 1.0, 0.0]
    assert rule_set.verdict(np.array(values)) is verdict
    margin = judgement.margin[0]
    assert math.isnan(margin) if verdict is Verdict.UNKNOWN else True
    assert (margin > 0.0) == (verdict is Verdict.SAFE) or margin == 0.0


@pytest.mark.parametrize('operator', ['=', '==', '!=', '', 'lt', None])
def test_other_operators_are_refused(operator):
    with pytest.raises(OccError, match='allowed are < <= > >='):
        Literal(0, operator, 0.5)


@pytest.mark.parametrize('bound', [NAN, INF, -INF])
def test_bounds_are_finite(bound):
    with pytest.raises(OccError, match='allowed is a finite number'):
        Literal(0, '<', bound)


@pytest.mark.parametrize('member', [0, 1, 2])
def test_a_literal_about_a_family_is_true_of_any_member(member):
    space = FeatureSpace(tuple(Feature(f'd_{i}', 'm', 0.0, 3.0, 'd') for i in range(3)))
    rule_set = RuleSet(
        space, (Rule('R', (Literal((0, 1, 2), '<', 0.3),)),), np.tile([0.0, 1.0], (3, 1))
    )
    near = np.ones(3)
    near[member] = 0.2
    assert rule_set.verdict(near) is Verdict.VIOLATED
    assert rule_set.verdict(np.ones(3)) is Verdict.SAFE
    assert rule_set.rules[0].formula(space) == 'any d < 0.3'


def test_a_disabled_rule_forbids_nothing(space):
    rules = (
        Rule('fast', (Literal(0, '>', 1.0),), enabled=False),
        Rule('R', (Literal(1, '<', 1.0),)),
    )
    rule_set = RuleSet(space, rules, np.array([[0.0, 0.5], [1.0, 4.0]]))
    assert rule_set.verdict(np.array([1.5, 3.0])) is Verdict.SAFE


def test_without_any_enabled_rule_there_is_a_problem(space):
    rules = (Rule('fast', (Literal(0, '>', 1.0),), enabled=False),)
    rule_set = RuleSet(space, rules, np.array([[0.0, 0.5], [1.0, 4.0]]))
    # Whoever judges has to ask for it; the monitor then reports UNKNOWN.
    assert rule_set.problem == 'no rule is enabled'
