# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The time to a violation is that of a search in exact numbers, whatever the rules."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import Forecast, Forecaster
from strategies import COARSE, rule_sets

SECOND = 10**9
NOWHERE = Forecast(math.inf)


def judged(forecaster, rule_set, row):
    judgement = rule_set.judge(np.array([row]))
    return forecaster.forecast(Verdict(judgement.verdict[0]), int(judgement.rule[0]))


def line(forecaster, row, slopes, rows=3):
    """Let rows 0.25 s apart lead to ``row`` along a straight line."""
    for back in range(rows - 1, -1, -1):
        forecaster.add(SECOND - back * SECOND // 4, np.array(row) - 0.25 * back * np.array(slopes))


def begin_of(rule, row, slopes):
    """Return when a rule begins to be true, or None; some members of its families make it so."""
    choices = itertools.product(*(literal.members for literal in rule.literals))
    intervals = [
        true_from(zip(rule.literals, choice, strict=True), row, slopes) for choice in choices
    ]
    return min((begin for begin, _ in filter(None, intervals)), default=None)


def true_from(literals, row, slopes):
    """Return the open interval of time from now on in which literals on features hold, or None."""
    begin, end = Fraction(0), None
    for literal, feature in literals:
        slope, short = Fraction(slopes[feature]), Fraction(literal.bound)
        short -= Fraction(row[feature])
        sign = -1 if literal.is_upper else 1
        if slope == 0:
            holds = sign * short < 0 or (short == 0 and literal.operator in ('<=', '>='))
            if not holds:
                return None
        elif sign * slope > 0:
            begin = max(begin, short / slope)
        else:
            end = short / slope if end is None else min(end, short / slope)
    # That two literals hold at one moment only is left open.
    assume(begin != end)
    return (begin, end) if end is None or begin < end else None


@given(rule_sets(), st.data())
def test_is_the_earliest_time_that_an_exact_search_finds(rule_set, data):
    vector = st.lists(COARSE, min_size=len(rule_set.space), max_size=len(rule_set.space))
    row, slopes = data.draw(vector), data.draw(vector)
    forecaster = Forecaster(rule_set, window=1.0)
    line(forecaster, row, slopes)
    got = judged(forecaster, rule_set, row)
    verdict = rule_set.verdict(np.array(row))
    if verdict is Verdict.UNKNOWN:
        assert math.isnan(got.seconds)
        assert (got.rule, got.feature) == (-1, -1)
        return
    if verdict is Verdict.VIOLATED:
        assert got.seconds == 0.0
        assert got.rule in rule_set.violated_rules(np.array(row))
        return
    times = {}
    for place in rule_set.order.tolist():
        begin = begin_of(rule_set.rules[place], row, slopes)
        if begin is not None:
            times[place] = begin
    if not times:
        assert got == NOWHERE
        return
    assert got.seconds == pytest.approx(float(min(times.values())), rel=1e-12, abs=1e-12)
    assert times[got.rule] == min(times.values())
    # The feature is one that crosses a bound of the rule at that time.
    reached = [
        literal
        for literal in rule_set.rules[got.rule].literals
        if got.feature in literal.members and slopes[got.feature]
    ]
    assert any(
        Fraction(literal.bound) - Fraction(row[got.feature])
        == times[got.rule] * Fraction(slopes[got.feature])
        for literal in reached
    )


@given(st.lists(st.tuples(st.integers(1, 400), st.floats(-5, 5)), min_size=5, max_size=200))
def test_slopes_are_those_of_a_least_squares_line(steps):
    stamps = np.cumsum([10**6 * step for step, _ in steps])
    values = np.array([value for _, value in steps])
    space = FeatureSpace((Feature('x'),))
    rule_set = RuleSet(space, (Rule('R', (Literal(0, '>', 6.0),)),), np.array([[0.0, 1.0]]))
    forecaster = Forecaster(rule_set, window=0.5)
    for stamp, value in zip(stamps.tolist(), values, strict=True):
        forecaster.add(stamp, np.array([value]))
    # Rounding decides whether a row exactly as old as the window counts.
    assume(stamps[-1] - SECOND // 2 not in stamps)
    inside = stamps >= stamps[-1] - SECOND // 2
    times = (stamps[inside] - stamps[-1]) * 1e-9
    got = forecaster.forecast(Verdict.SAFE, -1)
    if len(times) < 3 or times[-1] - times[0] < 0.25:
        assert got == NOWHERE
        return
    slope = np.polyfit(times, values[inside], 1)[0]
    assume(abs(slope) > 1e-6)
    if slope < 0:
        assert got == NOWHERE
    else:
        assert got.rule == 0
        assert got.seconds == pytest.approx((6.0 - values[-1]) / slope, rel=1e-6)


@pytest.fixture
def fast():
    space = FeatureSpace((Feature('x', low=-10.0, high=10.0), Feature('y')))
    literals = (Literal(0, '>', 2.0), Literal(1, '>=', 1.0))
    return RuleSet(space, (Rule('both', literals),), np.array([[0.0, 1.0], [0.0, 1.0]]))


def test_values_that_are_none_are_left_out(fast):
    forecaster = Forecaster(fast, window=1.0)
    for step in range(5):
        forecaster.add(step * SECOND // 4, np.array([0.25 * step, np.nan if step == 1 else 1.0]))
    assert judged(forecaster, fast, (1.0, 1.0)) == Forecast(1.0, 0, 0)
    # Of a feature that was hardly ever known nothing is said but its value.
    forecaster.reset()
    for step in range(5):
        forecaster.add(step * SECOND // 4, np.array([0.25 * step, np.nan if step < 3 else step]))
    assert judged(forecaster, fast, (1.0, 4.0)) == Forecast(1.0, 0, 0)
    assert math.isnan(judged(forecaster, fast, (np.nan, 4.0)).seconds)


def test_nothing_is_foreseen_from_little_or_from_another_time(fast):
    forecaster = Forecaster(fast, window=1.0)
    line(forecaster, (1.0, 1.0), (1.0, 0.0))
    assert judged(forecaster, fast, (1.0, 1.0)) == Forecast(1.0, 0, 0)
    # The clock was set back.
    forecaster.add(0, np.array([1.0, 1.0]))
    assert judged(forecaster, fast, (1.0, 1.0)) == NOWHERE
    # The same stamp again and again takes no memory and no time passes.
    for value in range(10_000):
        forecaster.add(5, np.array([float(value), 1.0]))
    assert forecaster.forecast(Verdict.SAFE, -1) == NOWHERE
    assert len(forecaster._rows._times) == 64


def test_memory_stays_small_whatever_the_rate(fast):
    forecaster = Forecaster(fast, window=1.0)
    for step in range(20_000):
        forecaster.add(step, np.array([0.0, 1.0]))
    assert len(forecaster._rows._times) <= 4096


def test_without_rules_nothing_is_foreseen(fast):
    empty = RuleSet(fast.space, (), fast.demonstrated)
    forecaster = Forecaster(empty, window=1.0)
    line(forecaster, (1.0, 1.0), (1.0, 0.0))
    assert judged(forecaster, empty, (1.0, 1.0)) == NOWHERE
    for window in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(OccError, match='window'):
            Forecaster(fast, window)
