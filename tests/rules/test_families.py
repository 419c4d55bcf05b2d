# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One literal about any member of a family says what a rule for each of its members would."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.simplification import simplify
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints, parse_constraints
from occ_constraints_pkg.rules.edits import RuleEdits
from occ_constraints_pkg.rules.forecast import Forecast, Forecaster
from strategies import COARSE, probes, rule_sets

SEEDS = st.integers(0, 2**32 - 1)
SECTORS = (0, 2, 3)
SPACE = FeatureSpace(
    (
        Feature('d_0', 'm', 0.0, 10.0, 'd'),
        Feature('speed', 'm/s'),
        Feature('d_1', 'm', 0.0, 10.0, 'd'),
        Feature('d_2', 'm', 0.0, 10.0, 'd'),
    )
)
DEMONSTRATED = np.array([[0.5, 4.5], [0.0, 2.0], [0.5, 4.5], [0.5, 4.5]])
CLOSE = Literal(SECTORS, '<', 0.5)
FAST = Literal(1, '>', 1.0)


def rules_of(*conjunctions):
    rules = (Rule(f'R{number}', literals) for number, literals in enumerate(conjunctions))
    return RuleSet(SPACE, tuple(rules), DEMONSTRATED)


def expanded(rule_set):
    """Return a rule for each choice of members instead of literals about families."""
    rules = []
    for rule in rule_set.rules:
        for number, members in enumerate(itertools.product(*(i.members for i in rule.literals))):
            literals = tuple(
                replace(literal, feature=member)
                for literal, member in zip(rule.literals, members, strict=True)
            )
            if rule.enabled and not Rule('R', literals).is_contradictory:
                rules.append(Rule(f'{rule.id}-{number}', literals))
    return replace(rule_set, rules=tuple(rules))


def points(rule_set, seed):
    bounds = [[feature.low, feature.high] for feature in rule_set.space.features]
    for rule in rule_set.rules:
        for literal in rule.literals:
            for member in literal.members:
                bounds[member].append(literal.bound)
    rows = probes(np.random.default_rng(seed), bounds)
    return rows.clip(rule_set.space.lows, rule_set.space.highs)


@effort(max_examples=60)
@given(rule_sets(most=5), SEEDS)
def test_verdicts_and_margins_are_those_of_a_rule_for_each_member(rule_set, seed):
    rows, apart = points(rule_set, seed), expanded(rule_set)
    one, many = rule_set.judge(rows), apart.judge(rows)
    np.testing.assert_array_equal(one.verdict, many.verdict)
    # A rule that no choice of members can make true still has a distance.
    assert (one.margin <= many.margin).all()
    if len(apart.rules) == sum(
        math.prod(len(literal.members) for literal in rule.literals)
        for rule in rule_set.rules
        if rule.enabled
    ):
        np.testing.assert_array_equal(one.margin, many.margin)


@effort(max_examples=60)
@given(rule_sets(most=5, most_rules=4), SEEDS)
def test_rules_for_each_member_simplify_to_the_same_verdicts(rule_set, seed):
    rows = points(rule_set, seed)
    result = simplify(expanded(rule_set)).rule_set
    np.testing.assert_array_equal(result.verdicts(rows), rule_set.verdicts(rows))


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ([(Literal(member, '<', 0.5),) for member in SECTORS], ['any d < 0.5']),
        (
            [(Literal(member, '<', 0.5), FAST) for member in SECTORS],
            ['any d < 0.5 and speed > 1.0'],
        ),
        # All of them below 0.3, one below 0.5 as well.
        (
            [*((Literal(member, '<', 0.3),) for member in SECTORS), (Literal(2, '<', 0.5),)],
            ['any d < 0.3', 'd_1 < 0.5'],
        ),
        # Not all members.
        ([(Literal(member, '<', 0.5),) for member in (0, 2)], ['d_0 < 0.5', 'd_1 < 0.5']),
        # The family implies its members, alone and with a condition.
        ([(CLOSE,), (Literal(2, '<', 0.4),)], ['any d < 0.5']),
        ([(CLOSE,), (Literal(2, '<=', 0.5),)], ['any d < 0.5', 'd_1 <= 0.5']),
        ([(CLOSE,), (Literal(2, '<', 0.4), FAST)], ['any d < 0.5']),
        ([(CLOSE, FAST), (Literal(2, '<', 0.4), FAST)], ['any d < 0.5 and speed > 1.0']),
        ([(CLOSE, Literal(2, '<', 0.4), FAST)], ['d_1 < 0.4 and speed > 1.0']),
        ([(CLOSE,), (Literal(SECTORS, '<', 0.4), FAST)], ['any d < 0.5']),
        # What the family covers need not be excluded.
        (
            [(CLOSE,), (Literal(2, '>=', 0.5), Literal(2, '<', 0.7), FAST)],
            ['any d < 0.5', 'd_1 < 0.7 and speed > 1.0'],
        ),
        ([(CLOSE,), (Literal(2, '>=', 0.5), Literal(2, '<', 0.7))], ['any d < 0.5', 'd_1 < 0.7']),
        # Smallest and largest are not one range.
        (
            [(CLOSE, Literal(SECTORS, '>', 4.0))],
            ['any d < 0.5 and any d > 4.0'],
        ),
        ([(Literal(SECTORS, '>', 3.0),), (Literal(SECTORS, '>', 4.0),)], ['any d > 3.0']),
        # Two families' worth of rules: one for each pair of members.
        (
            [
                (Literal(one, '<', 0.5), Literal(other, '>', 4.0))
                for one in SECTORS
                for other in SECTORS
                if one != other
            ],
            [
                f'd_{one} < 0.5 and d_{other} > 4.0'
                for one in range(3)
                for other in range(3)
                if one != other
            ],
        ),
    ],
)
def test_simplification_knows_what_a_family_is(given, expected):
    result = simplify(rules_of(*given)).rule_set
    assert [rule.formula(SPACE) for rule in result.rules] == expected


def test_simplification_leaves_what_a_person_has_noted():
    rules = rules_of(*((Literal(member, '<', 0.5),) for member in SECTORS))
    noted = replace(rules.rules[0], note='agreed')
    result = simplify(replace(rules, rules=(noted, *rules.rules[1:]))).rule_set
    assert [rule.formula(SPACE) for rule in result.rules] == ['d_0 < 0.5', 'any d < 0.5']
    assert result.rules[0] == noted


def test_margins_have_one_scale_for_a_family():
    ranges = np.array([[0.5, 1.5], [0.0, 2.0], [0.5, 4.5], [1.0, 2.0]])
    rule_set = RuleSet(SPACE, (Rule('R', (CLOSE,)),), ranges)
    np.testing.assert_array_equal(rule_set.scale, [4.0, 2.0, 4.0, 4.0])
    rows = np.array([[2.5, 0.0, 9.0, 9.0], [9.0, 0.0, 9.0, 2.5]])
    np.testing.assert_array_equal(rule_set.judge(rows).margin, [0.5, 0.5])


def test_a_member_that_is_missing_is_unknown_whatever_the_others_are():
    rule_set = rules_of((CLOSE,), (CLOSE, FAST))
    rows = np.array([[0.1, 0.0, np.nan, 3.0], [5.0, 0.0, 5.0, np.inf], [5.0, 0.0, 5.0, 11.0]])
    many = np.tile(rows, (400, 1))
    for got in (rule_set.judge(rows), rule_set.judge(rows[:1]), rule_set.judge(many)):
        assert (got.verdict == Verdict.UNKNOWN).all()
        assert np.isnan(got.margin).all()
    assert (rule_set.verdicts(rows) == Verdict.UNKNOWN).all()
    assert rule_set.verdict(rows[0]) is Verdict.UNKNOWN


def test_a_rule_in_words_names_the_member_that_decides():
    rule = Rule('R', (CLOSE, FAST, Literal(SECTORS, '>=', 4.0)))
    assert rule.words(SPACE) == 'any d below 0.5 m and speed above 1 m/s and any d at least 4 m'
    sample = np.array([4.0, 1.5, 0.25, 0.4])
    assert rule.words(SPACE, sample) == (
        'any d below 0.5 m (d_1 at 0.25) and speed above 1 m/s and any d at least 4 m (d_0 at 4)'
    )
    assert rule.deciding(sample) == (2, 1, 0)
    assert rule.fired(sample) == (2, 3, 1, 0)


@pytest.mark.parametrize('rows', [2, 9])
def test_the_time_to_a_violation_is_that_of_the_first_member_to_arrive(rows):
    rule_set = rules_of((CLOSE,))
    forecaster = Forecaster(rule_set, window=1.0)
    # The closest member goes away, another one comes.
    for step in range(rows + 3):
        forecaster.add(step * 250_000_000, np.array([1.0 + 0.5 * step, 0.0, 9.0 - 0.5 * step, 5.0]))
    expected = (9.0 - 0.5 * (rows + 2) - 0.5) / 2.0
    assert forecaster.forecast(Verdict.SAFE, -1) == Forecast(pytest.approx(expected), 0, 2)


def test_a_family_may_be_left_and_reached_again():
    rule_set = rules_of((CLOSE, FAST))
    forecaster = Forecaster(rule_set, window=1.0)
    # Close for one more second, fast in two, close again in three.
    for time in (-1.0, -0.5, 0.0):
        row = [0.4 + 0.1 * time, 0.0 + 0.5 * time, 5.0, 3.5 - 1.0 * time]
        forecaster.add(round((time + 5) * 1e9), np.array(row))
    got = forecaster.forecast(Verdict.SAFE, -1)
    assert got == Forecast(pytest.approx(3.0), 0, 3)


TEXT = """\
schema_version: 2
features:
- {name: d_0, family: d, demonstrated: [0.5, 4.5]}
- {name: d_1, family: d, demonstrated: [0.5, 4.5]}
- {name: tilt, family: imu, demonstrated: [0.0, 1.0]}
rules:
- id: R1
  literals:
  - {family: d, operator: <, bound: 0.5}
"""


@pytest.mark.parametrize('version', [1, 2])
def test_a_literal_about_a_family_in_a_file(version):
    read = parse_constraints(TEXT.replace('version: 2', f'version: {version}'), 'c.yaml')
    assert read.rules[0].literals == (Literal((0, 1), '<', 0.5),)
    written = read.dumps()
    assert written.startswith('schema_version: 2\n')
    assert '  text: any d below 0.5\n' in written
    assert '  - {family: d, operator: <, bound: 0.5}\n' in written
    assert parse_constraints(written, 'c.yaml').rules == read.rules


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        (
            'family: d, o',
            'family: e, o',
            "c.yaml, line 9: rules[0].literals[0].family: got 'e'; allowed are families of two or "
            'more features: d',
        ),
        (
            'family: d, o',
            'family: imu, o',
            "c.yaml, line 9: rules[0].literals[0].family: got 'imu', a family of one feature; "
            'allowed are families of two or more features: d',
        ),
        (
            'd_1, family: d',
            'd_1',
            "c.yaml, line 9: rules[0].literals[0].family: got 'd', a family of one feature; "
            'allowed is the key feature instead, as no two features are of one family',
        ),
        (
            'family: d, o',
            'family: d, feature: d_0, o',
            'c.yaml, line 9: rules[0].literals[0]: got feature, family of the keys feature, '
            'family; exactly one of them is allowed',
        ),
        (
            'family: d, o',
            'o',
            'c.yaml, line 9: rules[0].literals[0]: got none of the keys feature, family; exactly '
            'one of them is allowed',
        ),
        (
            'name: tilt',
            'name: any d',
            "c.yaml: rule 'R1' speaks of any d, a family, but a feature has the name 'any d' too",
        ),
    ],
)
def test_mistakes_in_a_file(old, new, sentence):
    assert old in TEXT
    with pytest.raises(OccError) as caught:
        parse_constraints(TEXT.replace(old, new, 1), 'c.yaml')
    assert sentence in str(caught.value)


@pytest.mark.parametrize('members', [(), (0,), (0, 2), (0, 2, 3, 1), (2, 0, 3)])
def test_a_literal_is_about_a_whole_family(members):
    with pytest.raises(OccError, match=r"rule 'R0' speaks of any of the features .*\(0, 2, 3\)"):
        rules_of((Literal(members, '<', 0.5),))


def test_files_with_a_rule_for_each_member_stay_as_they_are():
    """Their ids, counters and fingerprint are those of the version that wrote them."""
    before = rules_of(*((Literal(member, '<', 0.5),) for member in SECTORS))
    rules = tuple(replace(rule, evaluated=7, violated=1) for rule in before.rules)
    text = Constraints(replace(before, rules=rules)).dumps().replace('version: 2', 'version: 1')
    read = parse_constraints(text, 'old.yaml')
    assert read.rules == rules
    assert read.rule_set.fingerprint == before.fingerprint
    edits = RuleEdits.parse(['R1'], [], ['R2: d_2 < 0.75'])
    assert edits.apply(read.rule_set).rules[2].literals == (Literal(3, '<', 0.75),)


@given(st.lists(COARSE, min_size=1, max_size=3))
def test_bounds_of_families_are_moved_by_name(numbers):
    rule_set = rules_of((CLOSE, FAST), (Literal(2, '<', 0.5),))
    assume(numbers[0] <= 10.0)
    edits = RuleEdits.parse([], [], [f'R0:  any  d < {numbers[0]!r}'])
    assert edits.within(rule_set) == edits
    edited = edits.apply(rule_set)
    assert edited.rules[0].literals == (replace(CLOSE, bound=numbers[0]), FAST)
    assert edited.rules[1] == rule_set.rules[1]
    with pytest.raises(OccError, match="'R0' has no literal any d >; it has any d <, speed >"):
        RuleEdits.parse([], [], ['R0: any d > 1']).apply(rule_set)
