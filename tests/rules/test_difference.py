# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.simplification import simplify
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints, parse_constraints
from occ_constraints_pkg.rules.difference import compare_verdicts
from strategies import COARSE, FINITE, probes, rule_sets

SEEDS = st.integers(0, 2**32 - 1)


def columns(first, second):
    """Return where each feature of the second is in the first."""
    return [first.space.index(name) for name in second.space.names]


def points_of(first, second, seed, rows=400):
    bounds = [
        [*ends, *demonstrated]
        for ends, demonstrated in zip(
            first.space.finite_bounds.T.tolist(), first.demonstrated.tolist(), strict=True
        )
    ]
    for rule_set in (first, second):
        for rule in rule_set.rules:
            for literal in rule.literals:
                for member in literal.members:
                    bounds[first.space.index(rule_set.space.names[member])].append(literal.bound)
    return probes(np.random.default_rng(seed), bounds, rows=rows)


def check(first, second, seed=0):
    """Compare with brute force; return the comparison."""
    result = compare_verdicts(first, second)
    own = columns(first, second)
    points = points_of(first, second, seed)
    old, new = first.verdicts(points), second.verdicts(points[:, own])
    for flags, found in enumerate((result.only_first, result.only_second)):
        expected = [(Verdict.VIOLATED, Verdict.SAFE), (Verdict.SAFE, Verdict.VIOLATED)][flags]
        listed = np.zeros(len(points), dtype=bool)
        for item in found:
            point = np.array([item.point[name] for name in first.space.names])
            assert np.isfinite(point).all()
            verdicts = first.verdicts(point[None])[0], second.verdicts(point[own][None])[0]
            assert verdicts == item.verdicts == expected
            rule_set = (first, second)[flags]
            (rule,) = (rule for rule in rule_set.rules if rule.id == item.rule)
            assert rule.holds(point[own if flags else slice(None)][None]).all()
            inside = np.ones(len(points), dtype=bool)
            for name, (low, high) in item.limits.items():
                values = points[:, first.space.index(name)]
                assert low <= item.point[name] <= high
                inside &= (values >= low) & (values <= high)
            inside &= first.space.knows(points) & second.space.knows(points[:, own])
            # All of the box differs, not only the point.
            assert (old[inside] == expected[0]).all()
            assert (new[inside] == expected[1]).all()
            listed |= inside
        if not result.unproven[flags]:
            np.testing.assert_array_equal(listed, (old == expected[0]) & (new == expected[1]))
    return result


@effort(max_examples=150)
@given(rule_sets(most_rules=6), st.data(), SEEDS)
def test_any_two_rule_sets_compare_as_by_brute_force(first, data, seed):
    other = data.draw(rule_sets(most_rules=6))
    fits = []
    for rule in other.rules:
        literals = [
            replace(literal, feature=literal.feature % len(first.space))
            for literal in rule.literals
            if not literal.is_family
        ]
        if literals and not Rule('r', tuple(literals)).is_contradictory:
            fits.append(replace(rule, literals=tuple(literals)))
    fits += [
        replace(rule, id=f'kept {rule.id}')
        for rule in first.rules
        if data.draw(st.booleans(), label='kept')
    ]
    check(first, replace(first, rules=tuple(fits)), seed)


@effort(max_examples=60)
@given(rule_sets(most_rules=7), st.randoms(use_true_random=False))
def test_rewritten_and_reordered_rules_are_the_same(rule_set, random):
    rules = [
        replace(rule, id=f'other {rule.id}', literals=tuple(shuffled(rule.literals, random)))
        for rule in shuffled(rule_set.rules, random)
    ]
    names = shuffled(rule_set.space.names, random)
    place = [rule_set.space.index(name) for name in names]
    space = FeatureSpace(tuple(rule_set.space.features[index] for index in place))
    families = {frozenset(space.names[m] for m in members): members for members in space.families}

    def moved(literal):
        if literal.is_family:
            members = frozenset(rule_set.space.names[member] for member in literal.members)
            return replace(literal, feature=families[members])
        return replace(literal, feature=names.index(rule_set.space.names[literal.feature]))

    rules = tuple(replace(rule, literals=tuple(map(moved, rule.literals))) for rule in rules)
    other = RuleSet(space, rules, rule_set.demonstrated[place])
    text = Constraints(other).dumps()
    for again in (other, parse_constraints(text, 'here').rule_set):
        assert compare_verdicts(rule_set, again).is_same
        assert compare_verdicts(again, rule_set).is_same


def shuffled(items, random):
    items = list(items)
    random.shuffle(items)
    return items


@effort(max_examples=100)
@given(rule_sets(most_rules=8) | rule_sets(bounds=FINITE, most_rules=8))
def test_simplified_rules_are_the_same(rule_set):
    # No rule left makes every verdict UNKNOWN, which simplification does not look at.
    simpler = simplify(rule_set).rule_set
    assume(bool(simpler.problem) == bool(rule_set.problem))
    result = compare_verdicts(rule_set, simpler)
    assert result.is_same, result


@effort(max_examples=100)
@given(rule_sets(most_rules=6), COARSE, st.data())
def test_a_changed_bound_is_found_exactly_where_it_matters(rule_set, bound, data):
    assume(rule_set.rules)
    index = data.draw(st.integers(0, len(rule_set.rules) - 1))
    rule = rule_set.rules[index]
    place = data.draw(st.integers(0, len(rule.literals) - 1))
    literals = list(rule.literals)
    literals[place] = replace(literals[place], bound=bound)
    rules = list(rule_set.rules)
    rules[index] = replace(rule, literals=tuple(literals))
    assume(not rules[index].is_contradictory)
    check(rule_set, replace(rule_set, rules=tuple(rules)))


def in_line(*literals, low=-np.inf, high=np.inf, unit='m', **options):
    space = FeatureSpace((Feature('x', unit, low, high),))
    rules = tuple(
        Rule(f'R{index}', (Literal(0, *one),), **options) for index, one in enumerate(literals)
    )
    return RuleSet(space, rules, np.array([[0.0, 1.0]]))


def test_a_bound_moved_by_one_float_gives_this_float():
    above = float(np.nextafter(1.0, 2.0))
    result = check(in_line(('>', 1.0)), in_line(('>', above)))
    assert [(item.rule, item.point) for item in result.only_first] == [('R0', {'x': above})]
    assert result.only_second == ()
    assert check(in_line(('>', 1.0)), in_line(('>=', above))).is_same


def test_a_union_covers_what_no_single_rule_does():
    split = in_line(('<', 0.5), ('>=', 0.5))
    whole = in_line(('<', 2.0), ('>', 1.0))
    assert check(split, whole).is_same
    assert not check(split, in_line(('<', 0.5), ('>', 0.5))).is_same


def test_disabled_rules_do_not_count_and_no_rule_at_all_is_unknown():
    disabled = in_line(('>', 1.0), enabled=False)
    assert compare_verdicts(disabled, in_line()).is_same
    result = compare_verdicts(disabled, in_line(('>', 2.0), high=1.0))
    assert result.without_rules == (True, False)
    assert result.differs


def test_physical_bounds_that_differ_give_a_value_that_one_cannot_judge():
    wide, narrow = in_line(('>', 9.0), low=-5.0), in_line(('>', 9.0), low=0.0)
    for first, second, is_first in ((wide, narrow, True), (narrow, wide, False)):
        (item,) = compare_verdicts(first, second).unknown
        assert item.known_to_first == is_first
        assert wide.verdicts(np.array([[item.value]])) == Verdict.SAFE
        assert narrow.verdicts(np.array([[item.value]])) == Verdict.UNKNOWN
    apart = compare_verdicts(in_line(low=2.0), in_line(high=1.0))
    assert len(apart.unknown) == 2
    assert not apart.only_first


def test_other_units_are_not_compared():
    result = compare_verdicts(in_line(('>', 1.0)), in_line(('>', 1.0), unit='cm'))
    assert "'m' in the first and in 'cm' in the second" in result.problem
    assert not result.is_same


def test_a_feature_of_one_only_differs():
    one = in_line(('>', 1.0))
    two = RuleSet(
        FeatureSpace((Feature('y'), Feature('x', 'm'))),
        (Rule('R0', (Literal(1, '>', 1.0),)), Rule('R1', (Literal(0, '>', 3.0),))),
        np.array([[0.0, 1.0], [0.0, 1.0]]),
    )
    result = compare_verdicts(one, two)
    assert result.missing == ('y',)
    assert result.only_first == ()
    (item,) = result.only_second
    assert item.rule == 'R1'
    assert item.point['y'] > 3.0


def sectors(count, *literals):
    space = FeatureSpace(tuple(Feature(f'd_{i}', 'm', 0.0, 5.0, 'd') for i in range(count)))
    demonstrated = np.tile([0.5, 4.0], (count, 1))
    members = tuple(range(count))
    rules = [
        Rule(f'R{number}', (Literal(members if feature is None else feature, sign, bound),))
        for number, (feature, sign, bound) in enumerate(literals)
    ]
    return RuleSet(space, tuple(rules), demonstrated)


def test_a_family_is_the_union_of_its_members():
    family = sectors(16, (None, '<', 0.3))
    each = sectors(16, *((index, '<', 0.3) for index in range(16)))
    assert check(family, each).is_same
    result = check(family, replace(each, rules=each.rules[1:]))
    (item,) = result.only_first
    assert item.limits['d_0'][1] < 0.3
    assert result.only_second == ()


def too_hard():
    """Return rule sets whose difference takes more boxes than are allowed, of parity's kind."""
    rng = np.random.default_rng(0)
    space = FeatureSpace(tuple(Feature(f'x{i}', '1', 0.0, 1.0) for i in range(12)))
    rules = []
    for number in range(120):
        chosen = rng.choice(12, 4, replace=False)
        signs = rng.choice(['<', '>'], 4)
        rules.append(
            Rule(
                f'R{number}',
                tuple(
                    Literal(int(feature), sign, 0.5)
                    for feature, sign in zip(chosen, signs, strict=True)
                ),
            )
        )
    everything = Rule('all', (Literal(0, '>=', 0.0),))
    demonstrated = np.tile([0.0, 1.0], (12, 1))
    return (
        RuleSet(space, (everything,), demonstrated),
        RuleSet(space, tuple(rules), demonstrated),
    )


def test_too_many_boxes_are_not_called_a_proof():
    first, second = too_hard()
    result = compare_verdicts(first, second, most_boxes=10)
    assert result.unproven[0] == ('all',)
    assert not result.is_same
    assert result.points > 0
    # The points find it all the same.
    (item,) = result.only_first
    assert item.verdicts == (Verdict.VIOLATED, Verdict.SAFE)
    longer = tuple(
        replace(rule, literals=(*rule.literals, Literal(0, '>=', -1.0))) for rule in second.rules
    )
    same = compare_verdicts(second, replace(second, rules=longer), most_boxes=10)
    assert not same.is_same
    assert not same.differs
    assert same.unproven[0]


@pytest.mark.parametrize('seed', range(3))
def test_random_forests_of_rules_are_compared_in_time(seed):
    first, second = too_hard()
    rng = np.random.default_rng(seed)
    rules = tuple(second.rules[index] for index in rng.permutation(len(second.rules)))
    assert compare_verdicts(second, replace(second, rules=rules)).is_same
    assert compare_verdicts(second, replace(second, rules=rules[1:])).differs


def test_a_feature_demonstrated_as_constant_needs_no_warning():
    space = FeatureSpace((Feature('level'), Feature('speed')))
    rules = Rule('a', (Literal(1, '>', 1.0),)), Rule('b', (Literal(0, '>', 30.0),))
    demonstrated = np.array([[0.5, 0.5], [0.0, 1.0]])
    first = RuleSet(space, rules, demonstrated)
    second = RuleSet(space, rules[:1], demonstrated)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        result = compare_verdicts(first, second)
    assert [item.rule for item in result.only_first] == ['b']
