# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet


def counted(*counts, **changes):
    rules = tuple(
        replace(
            Rule(f'R{index}', (Literal(0, '>', float(index)),)),
            evaluated=evaluated,
            violated=violated,
            **changes,
        )
        for index, (evaluated, violated) in enumerate(counts)
    )
    return RuleSet(FeatureSpace((Feature('x'),)), rules, np.array([[0.0, 1.0]]))


def test_rules_rarely_violated_are_disabled_and_say_why():
    result = prune(counted((1000, 0), (1000, 9), (1000, 10), (1000, 500), (0, 0)), 0.01)
    assert result.pruned == ('R0', 'R1')
    assert result.not_evaluated == ('R4',)
    assert [rule.enabled for rule in result.rule_set.rules] == [False, False, True, True, True]
    assert result.rule_set.rules[1].note == 'pruned: violated 9 of 1000 times, below 0.01'
    assert result.rule_set.rules[2].note == ''
    # Counters and literals stay.
    assert [rule.evaluated for rule in result.rule_set.rules] == [1000, 1000, 1000, 1000, 0]
    assert result.rule_set.rules[1].literals == (Literal(0, '>', 1.0),)


def test_pruning_adds_to_a_note_and_leaves_disabled_rules_alone():
    noted = counted((10, 0), (10, 10), note='mine')
    assert prune(noted, 0.5).rule_set.rules[0].note == (
        'mine; pruned: violated 0 of 10 times, below 0.5'
    )
    both = counted((10, 0), (10, 10))
    off = replace(both, rules=(replace(both.rules[0], enabled=False), both.rules[1]))
    result = prune(off, 0.5)
    assert result.pruned == ()
    assert result.rule_set.rules == off.rules


@given(st.integers(1, 10_000), st.integers(1, 1000))
def test_a_share_equal_to_the_threshold_stays(evaluated, parts):
    violated = evaluated * parts // 1000
    threshold = float(Fraction(violated, evaluated))
    kept = (1, 1)
    assert prune(counted((evaluated, violated), kept), threshold).pruned == ()
    if violated:
        assert prune(counted((evaluated, violated - 1), kept), threshold).pruned == ('R0',)


def test_the_last_rules_are_not_pruned():
    """A formula without rules would call everything safe."""
    with pytest.raises(OccError, match='would disable every rule'):
        prune(counted((10, 1), (10, 2)), 0.5)


def test_decimal_thresholds_mean_what_they_say():
    # In binary 0.1 times 30 is more than 3.
    assert prune(counted((30, 3)), 0.1).pruned == ()


@pytest.mark.parametrize(('threshold', 'kept'), [(0.0, 3), (1.0, 1)])
def test_the_ends_of_the_allowed_thresholds(threshold, kept):
    result = prune(counted((10, 0), (10, 9), (10, 10)), threshold)
    assert len(result.rule_set.order) == kept


@pytest.mark.parametrize('threshold', [-0.1, 1.1, np.nan])
def test_thresholds_out_of_range(threshold):
    with pytest.raises(OccError, match='allowed is 0 to 1'):
        prune(counted((10, 1)), threshold)


@pytest.mark.parametrize('rule_set', [counted(), counted((0, 0)), counted((9, 0), enabled=False)])
def test_without_counts_there_is_nothing_to_prune_by(rule_set):
    with pytest.raises(OccError, match='no enabled rule has been evaluated yet'):
        prune(rule_set, 0.5)
