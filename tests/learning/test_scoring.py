# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.scoring import Score, score_flags, score_rules
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from strategies import COARSE, rule_sets

X = FeatureSpace((Feature('x', '1', -10.0, 10.0),))


def same(left, right):
    return left == right or (math.isnan(left) and math.isnan(right))


def naive(flagged, costly):
    """Return precision, recall, F1, IoU from sets and the textbook."""
    flagged = {place for place, flag in enumerate(flagged) if flag}
    costly = {place for place, flag in enumerate(costly) if flag}
    both = flagged & costly
    precision = len(both) / len(flagged) if flagged else math.nan
    recall = len(both) / len(costly) if costly else math.nan
    if both:
        f1 = 2 * precision * recall / (precision + recall)
    else:
        f1 = 0.0 if flagged or costly else math.nan
    iou = len(both) / len(flagged | costly) if flagged | costly else math.nan
    return precision, recall, f1, iou


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30))
def test_ratios_equal_the_textbook(pairs):
    flagged, costly = (np.array([pair[i] for pair in pairs], dtype=bool) for i in (0, 1))
    score = score_flags(flagged, costly)
    assert score.samples == len(pairs)
    for got, expected in zip(score.ratios().values(), naive(flagged, costly), strict=True):
        assert same(got, expected) or got == pytest.approx(expected, rel=1e-12)


@given(data=st.data(), rule_set=rule_sets())
def test_rules_equal_counting_one_by_one(data, rule_set):
    k = len(rule_set.space)
    number = COARSE | st.sampled_from([np.nan, np.inf])
    rows = data.draw(st.lists(st.lists(number, min_size=k, max_size=k), min_size=1, max_size=12))
    cost = st.sampled_from([0.0, 0.5, 1.0, -1.0, np.nan])
    costs = data.draw(st.lists(cost, min_size=len(rows), max_size=len(rows)))
    if not any(math.isfinite(cost) for cost in costs):
        with pytest.raises(OccError, match='finite true cost'):
            score_rules(rule_set, np.array(rows), np.array(costs))
        return
    score = score_rules(rule_set, np.array(rows), np.array(costs))

    flags, truth, unknown = [], [], 0
    first, true = {}, {}
    for row, cost in zip(rows, costs, strict=True):
        if not math.isfinite(cost):
            continue
        judgement = rule_set.judge(np.array([row]))
        flags.append(judgement.verdict[0] != Verdict.SAFE)
        truth.append(cost > 0)
        if judgement.verdict[0] == Verdict.UNKNOWN:
            unknown += 1
            continue
        hits = rule_set.violated_rules(np.array(row))
        for place in hits:
            true.setdefault(rule_set.rules[place].id, []).append(cost > 0)
        if len(hits):
            first.setdefault(rule_set.rules[hits[0]].id, []).append(cost > 0)
    assert score.unknown == unknown
    assert score.unscored == len(rows) - len(flags)
    assert score.overall == score_flags(np.array(flags), np.array(truth))
    assert [item.rule for item in score.rules] == [rule_set.rules[i] for i in rule_set.order]
    for item in score.rules:
        mine = first.get(item.rule.id, [])
        assert (item.first, item.first_costly) == (len(mine), sum(mine))
        mine = true.get(item.rule.id, [])
        assert item.alone == Score(len(flags), len(mine), sum(truth), sum(mine))


def test_an_example_by_hand():
    rules = (
        Rule('high', (Literal(0, '>', 1.0),)),
        Rule('higher', (Literal(0, '>', 2.0),)),
        Rule('low', (Literal(0, '<', -1.0),), enabled=False),
    )
    rule_set = RuleSet(X, rules, np.array([[-1.0, 1.0]]))
    values = np.array([[0.0], [1.5], [2.5], [-5.0], [11.0], [3.0]])
    score = score_rules(rule_set, values, np.array([0.0, 0.0, 1.0, 1.0, 1.0, np.nan]))
    # 1.5, 2.5 and the impossible 11 are flagged; 2.5, -5 and 11 are costly.
    assert score.overall == Score(5, 3, 3, 2)
    assert (score.unknown, score.unscored) == (1, 1)
    high, higher = score.rules
    assert (high.first, high.first_costly, high.alone) == (2, 1, Score(5, 2, 3, 1))
    assert (higher.first, higher.first_costly, higher.alone) == (0, 0, Score(5, 1, 3, 1))


def test_what_does_not_fit_is_refused():
    rule_set = RuleSet(X, (), np.array([[-1.0, 1.0]]))
    with pytest.raises(OccError, match=r'true costs of shape \(2,\)'):
        score_rules(rule_set, np.zeros((3, 1)), np.zeros(2))
    with pytest.raises(OccError, match='none of the 0 samples'):
        score_rules(rule_set, np.zeros((0, 1)), np.zeros(0))
    with pytest.raises(OccError, match='one for each'):
        score_flags(np.zeros(3, dtype=bool), np.zeros(1, dtype=bool))
