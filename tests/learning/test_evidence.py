# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.evidence import NEAR, evidence_document, gather_evidence
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from strategies import probes, rule_sets


def judged(rule_set, rows):
    return rule_set.judge(rows).verdict == Verdict.SAFE


def true(literals, rows):
    held = np.ones(len(rows), dtype=bool)
    for literal in literals:
        held &= np.any([literal.holds(rows[:, member]) for member in literal.members], axis=0)
    return held


@effort(max_examples=80)
@given(rule_sets(), st.integers(0, 2**32 - 1))
def test_evidence_is_what_counting_one_by_one_gives(rule_set, seed):
    rng = np.random.default_rng(seed)
    bounds = [[*rule_set.demonstrated[index]] for index in range(len(rule_set.space))]
    for rule in rule_set.rules:
        for literal in rule.literals:
            for member in literal.members:
                bounds[member].append(literal.bound)
    rows = probes(rng, bounds, rows=80).clip(rule_set.space.lows, rule_set.space.highs)
    episodes = rng.integers(0, 5, size=len(rows))
    safe = judged(rule_set, rows)
    evidence = gather_evidence(rule_set, rows, safe, episodes)
    assert [item.rule for item in evidence] == [rule_set.rules[i] for i in rule_set.order]
    for item in evidence:
        assert item.flagged == true(item.rule.literals, rows).sum()
        for literal, found in zip(item.rule.literals, item.literals, strict=True):
            others = [other for other in item.rule.literals if other != literal]
            # They would be violations but for this literal.
            support = safe & true(others, rows) & ~true([literal], rows)
            away = np.min([np.abs(rows[:, one] - literal.bound) for one in literal.members], axis=0)
            near = support & (away <= NEAR * rule_set.scale[literal.members[0]])
            assert found.near == near.sum()
            assert found.episodes == len(set(episodes[near]))
            wanted = near if near.any() else support
            assert len(found.closest) == min(3, len(set(episodes[wanted])))
            positions = [position for position, _, _ in found.closest]
            assert all(wanted[positions])
            assert len(set(episodes[positions])) == len(positions)
            best = [away[wanted & (episodes == episode)].min() for episode in episodes[positions]]
            assert list(away[positions]) == best == sorted(best)
            for position, feature, value in found.closest:
                assert feature in literal.members
                assert value == rows[position, feature]
                assert abs(value - literal.bound) == away[position]


def test_members_of_a_family_hold_their_bound_together():
    space = FeatureSpace((Feature('a', family='f'), Feature('b', family='f'), Feature('c')))
    rule = Rule('R', (Literal(0, '>', 1.0),))
    rule_set = RuleSet(space, (rule,), np.array([[0.0, 1.0]] * 3))
    rows = np.array([[0.2, 1.0, 1.0], [0.995, 0.3, 1.0], [0.5, 0.5, 1.0]])
    [alone] = gather_evidence(rule_set, rows, judged(rule_set, rows), np.arange(3))
    assert alone.literals[0].closest == ((1, 0, 0.995),)
    evidence = gather_evidence(
        rule_set, rows, judged(rule_set, rows), np.arange(3), families=space.families
    )
    assert evidence[0].literals[0].near == 2
    assert evidence[0].literals[0].closest == ((0, 1, 1.0), (1, 0, 0.995))
    document = evidence_document(evidence, space, lambda row: {'row': 10 * row}, {})
    assert document['rules'][0]['literals'][0]['closest'] == [
        {'value': 1.0, 'feature': 'b', 'row': 0},
        {'value': 0.995, 'row': 10},
    ]
