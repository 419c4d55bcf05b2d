# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The time to violation is exact for features that move along straight lines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import Forecaster
from strategies import rule_sets

SPACE = FeatureSpace((Feature('x'), Feature('y')))
DEMONSTRATED = np.array([[0.0, 1.0]] * 2)


def rules(*conjunctions):
    built = tuple(Rule(f'R{i}', literals) for i, literals in enumerate(conjunctions))
    return RuleSet(SPACE, built, DEMONSTRATED)


def run(forecaster, start, rate, times):
    """Return what is forecast last on the way from ``start``."""
    start, rate = np.array(start), np.array(rate)
    for time in times:
        result = forecaster.add(time, start + rate * time)
    return result


def test_one_literal_ahead():
    forecaster = Forecaster(rules((Literal(0, '>', 1.0),)))
    result = run(forecaster, [0.0, 0.0], [0.5, 0.0], [0.0, 0.1, 0.2])
    assert result.seconds == pytest.approx(1.8)
    assert (result.rule, result.feature) == (0, 0)


def test_the_last_literal_of_a_rule_decides_and_all_must_hold_at_once():
    both = (Literal(0, '>', 1.0), Literal(1, '<=', 0.0))
    forecaster = Forecaster(rules(both))
    result = run(forecaster, [0.0, 1.0], [1.0, -0.25], [0.0, 0.1, 0.2])
    assert result.seconds == pytest.approx(3.8)
    assert result.feature == 1
    # x leaves its literal before y reaches its own.
    assert run(Forecaster(rules(both)), [1.1, 1.0], [-1.0, -0.25], [0.0, 0.01, 0.02]) is None


def test_the_soonest_rule_is_told():
    forecaster = Forecaster(rules((Literal(0, '>', 9.0),), (Literal(1, '<', -1.0),)))
    result = run(forecaster, [0.0, 0.0], [1.0, -1.0], [0.0, 0.1, 0.2])
    assert (result.rule, result.feature) == (1, 1)
    assert result.seconds == pytest.approx(0.8)


def test_nothing_is_forecast_from_too_little():
    ahead = rules((Literal(0, '>', 1.0),))
    assert run(Forecaster(ahead), [0.0, 0.0], [1.0, 0.0], [0.0, 0.1]) is None
    assert run(Forecaster(ahead), [0.0, 0.0], [0.0, 0.0], [0.0, 0.1, 0.2]) is None
    assert run(Forecaster(rules()), [0.0, 0.0], [1.0, 0.0], [0.0, 0.1, 0.2]) is None


@pytest.mark.parametrize('gap', [0.0, -1.0, 0.6])
def test_a_jump_in_time_begins_anew(gap):
    forecaster = Forecaster(rules((Literal(0, '>', 1.0),)), window=0.5)
    assert run(forecaster, [0.0, 0.0], [1.0, 0.0], [0.0, 0.1, 0.2]) is not None
    assert forecaster.add(0.2 + gap, np.array([0.3, 0.0])) is None
    assert forecaster.add(0.3 + gap, np.array([0.4, 0.0])) is None
    assert forecaster.add(0.4 + gap, np.array([0.5, 0.0])) is not None


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_a_value_that_is_none_begins_anew(bad):
    forecaster = Forecaster(rules((Literal(0, '>', 1.0),)))
    run(forecaster, [0.0, 0.0], [1.0, 0.0], [0.0, 0.1, 0.2])
    assert forecaster.add(0.3, np.array([0.3, bad])) is None
    assert forecaster.add(0.4, np.array([0.4, 0.0])) is None


@given(
    rule_sets(enabled=st.just(True)),
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=3, max_size=3),
)
def test_safe_until_then_on_a_straight_line(rule_set, lines):
    start, rate = np.array(lines)[: len(rule_set.space)].T
    bare = RuleSet(
        FeatureSpace(tuple(Feature(name) for name in rule_set.space.names)),
        rule_set.rules,
        rule_set.demonstrated,
    )
    forecaster = Forecaster(bare)
    for time in (-0.2, -0.1, 0.0):
        result = forecaster.add(time, start + rate * time)
    until = 5.0 if result is None else result.seconds - 1e-6 * (1.0 + result.seconds)
    times = np.linspace(1e-9, until, 50)[:, None]
    if until > 1e-9:
        assert (bare.judge(start + rate * times).verdict == Verdict.SAFE).all()


def test_a_window_that_is_no_time_is_refused():
    with pytest.raises(OccError, match='allowed is a time above 0 s'):
        Forecaster(rules(), 0.0)
