# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Edits of a rule set do what they say, and nothing else."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.edits import MovedBound, RuleEdits
from strategies import COARSE, rule_sets

SPACE = FeatureSpace((Feature('speed'), Feature('gap')))
RULES = RuleSet(
    SPACE,
    (
        Rule('FAST', (Literal(0, '>', 2.0),)),
        Rule('NEAR', (Literal(1, '<', 0.5), Literal(1, '>=', 0.0), Literal(0, '>', 1.0))),
        Rule('OFF', (Literal(1, '<', 9.0),), enabled=False),
    ),
    np.array([[0.0, 1.0], [0.0, 1.0]]),
)


def formulas(rule_set):
    return [(rule.formula(SPACE), rule.enabled) for rule in rule_set.rules]


def test_rules_go_on_and_off_and_bounds_move():
    edits = RuleEdits.parse(['FAST'], ['OFF'], ['NEAR: gap < 0.75', 'NEAR:speed>1e-1'])
    assert edits.bounds[1] == MovedBound('NEAR', 'speed', '>', 0.1)
    assert formulas(edits.apply(RULES)) == [
        ('speed > 2.0', False),
        ('gap < 0.75 and gap >= 0.0 and speed > 0.1', True),
        ('gap < 9.0', True),
    ]
    assert edits.apply(edits.apply(RULES)).fingerprint == edits.apply(RULES).fingerprint
    assert RuleEdits().apply(RULES) is RULES


@pytest.mark.parametrize(
    ('edits', 'message'),
    [
        ((['FAS'], [], []), "no rule 'FAS'; did you mean 'FAST'"),
        (([], ['X'], []), "no rule 'X'; the rules are FAST, NEAR, OFF"),
        ((['FAST'], ['FAST'], []), "'FAST' is to be enabled and disabled"),
        (([], [], ['NEAR: gap > 1']), "'NEAR' has no literal gap >; it has gap <, gap >=, speed >"),
        (([], [], ['NEAR gap < 1']), "allowed is 'RULE: FEATURE OPERATOR NUMBER'"),
        (([], [], ['NEAR: gap < nan']), "allowed is 'RULE: FEATURE OPERATOR NUMBER'"),
        (([], [], ['NEAR: gap < near']), "allowed is 'RULE: FEATURE OPERATOR NUMBER'"),
        (
            ([], [], ['NEAR: gap < 1', 'NEAR:gap<2']),
            "bound gap < of rule 'NEAR' is to be moved twice",
        ),
        (([], [], ['NEAR: gap < -1']), "'NEAR' can never be true"),
    ],
)
def test_what_cannot_be_done_is_refused(edits, message):
    with pytest.raises(OccError, match=message):
        RuleEdits.parse(*edits).apply(RULES)


def test_edits_of_rules_that_are_gone_are_left_out():
    edits = RuleEdits.parse(['FAST', 'GONE'], ['X'], ['NEAR: gap < 1', 'NEAR: gap > 1', 'X: a < 1'])
    assert edits.within(RULES) == RuleEdits.parse(['FAST'], [], ['NEAR: gap < 1'])


@given(rule_sets(), st.data())
def test_only_the_rules_that_are_named_change(rule_set, data):
    ids = [rule.id for rule in rule_set.rules]
    disabled = data.draw(st.lists(st.sampled_from(ids), unique=True)) if ids else []
    literal = {
        rule.id: data.draw(st.sampled_from(rule.literals))
        for rule in rule_set.rules
        if data.draw(st.booleans())
    }
    bounds = {
        name: MovedBound(name, item.name(rule_set.space), item.operator, data.draw(COARSE))
        for name, item in literal.items()
    }
    edits = RuleEdits(tuple(disabled), (), tuple(bounds.values()))
    assert edits.within(rule_set) == edits
    try:
        edited = edits.apply(rule_set)
    except OccError:
        # A rule whose literals exclude each other now, which the test above looks at.
        assume(False)
    for before, after in zip(rule_set.rules, edited.rules, strict=True):
        assert after.enabled == (before.enabled and before.id not in disabled)
        assert len(after.literals) == len(before.literals)
        for old, new in zip(before.literals, after.literals, strict=True):
            moved = literal.get(before.id)
            fits = moved and (moved.feature, moved.operator) == (old.feature, old.operator)
            assert new.bound == (bounds[before.id].bound if fits else old.bound)
            assert (new.feature, new.operator) == (old.feature, old.operator)
