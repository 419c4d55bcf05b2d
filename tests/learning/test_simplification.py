# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.simplification import simplify, size
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.ruleset import rule_ids
from strategies import FINITE, fit_settings, probes, rule_sets, samples, trees

SEEDS = st.integers(0, 2**32 - 1)


def bounds_of(rule_set):
    """Return for each feature the bounds that rules, space and demonstrations mention."""
    bounds = [
        [feature.low, feature.high, *demonstrated]
        for feature, demonstrated in zip(
            rule_set.space.features, rule_set.demonstrated, strict=True
        )
    ]
    for rule in rule_set.rules:
        for literal in rule.literals:
            for member in literal.members:
                bounds[member].append(literal.bound)
    return bounds


def check_same_meaning(before, after, rng, rows=300):
    points = probes(rng, bounds_of(before), rows=rows)
    points = points.clip(before.space.lows, before.space.highs)
    old, new = before.judge(points), after.judge(points)
    np.testing.assert_array_equal(new.verdict, old.verdict)
    return old, new


def check(before, rng, **options):
    result = simplify(before, **options)
    after = result.rule_set
    check_same_meaning(before, after, rng)
    assert result.before == size(before)
    assert result.after == size(after)
    assert result.after <= result.before
    assert result.after[1] <= result.before[1]
    lengths = [len(rule.literals) for rule in after.rules]
    assert lengths == sorted(lengths)
    again = simplify(after, **options)
    assert again.rule_set.rules == after.rules
    assert (again.changed, again.removed) == ({}, ())
    return result


@effort(max_examples=120)
@given(rule_sets(most_rules=9), SEEDS)
def test_any_rules_mean_the_same_when_simplified(rule_set, seed):
    check(rule_set, np.random.default_rng(seed))


@effort(max_examples=60)
@given(rule_sets(bounds=FINITE, most_rules=9), SEEDS)
def test_any_bounds_mean_the_same_when_simplified(rule_set, seed):
    check(rule_set, np.random.default_rng(seed))


@effort(max_examples=80)
@given(trees(), st.booleans(), SEEDS)
def test_rules_of_any_tree_mean_the_same_when_simplified(tree, full, seed):
    before = extract_rules(*tree, full_conditions=full)
    check(before, np.random.default_rng(seed), renumber=True)


@effort(max_examples=40)
@given(samples(most_rows=100), fit_settings(), st.booleans(), SEEDS)
def test_rules_of_learned_trees_mean_the_same_when_simplified(values, settings, full, seed):
    demonstrated = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(values.shape[1])))
    before = extract_rules(
        fit_safe_set(values, settings), space, demonstrated, full_conditions=full
    )
    check(before, np.random.default_rng(seed))


@effort(max_examples=60)
@given(rule_sets(most_rules=8, enabled=st.just(True)), SEEDS)
def test_margins_of_safe_samples_stay_and_of_violations_come_closer(rule_set, seed):
    after = simplify(rule_set).rule_set
    old, new = check_same_meaning(rule_set, after, np.random.default_rng(seed))
    safe, violated = old.verdict == Verdict.SAFE, old.verdict == Verdict.VIOLATED
    assert (new.margin[safe] >= old.margin[safe] - 1e-12).all()
    # Physical bounds can put rules out of reach; and where all is a violation, a rule goes that no
    # other one contains.
    bounded = np.isfinite([*rule_set.space.lows, *rule_set.space.highs]).any()
    if safe.any() and not bounded:
        assert (new.margin[violated] <= old.margin[violated] + 1e-12).all()
        np.testing.assert_allclose(new.margin[safe], old.margin[safe], rtol=1e-12, atol=1e-12)


@given(rule_sets(most_rules=8), st.data())
def test_what_a_person_or_a_count_has_touched_survives(rule_set, data):
    rules = tuple(
        replace(
            rule,
            note=data.draw(st.sampled_from(['', 'agreed'])),
            evaluated=data.draw(st.sampled_from([0, 3])),
        )
        for rule in rule_set.rules
    )
    before = replace(rule_set, rules=rules)
    result = check(before, np.random.default_rng(0))
    touched = [rule for rule in rules if not rule.enabled or rule.note or rule.evaluated]
    assert all(rule in result.rule_set.rules for rule in touched)
    assert result.kept == tuple(rule.id for rule in touched if rule.enabled)
    counted = check(before, np.random.default_rng(0), counted_too=True)
    assert counted.after <= result.after
    assert all(rule in counted.rule_set.rules for rule in rules if not rule.enabled or rule.note)


PLANE = FeatureSpace((Feature('x', low=0.0, high=10.0), Feature('y')))


def rules_of(*formulas):
    """Return a rule set of formulas such as ``x > 1 and y <= 2``, called A, B, C ..."""
    rules = []
    for index, formula in enumerate(formulas):
        words = [item.split() for item in formula.split(' and ')]
        literals = (Literal('xy'.index(name), sign, float(bound)) for name, sign, bound in words)
        rules.append(Rule('ABCDEFG'[index], tuple(literals)))
    return RuleSet(PLANE, tuple(rules), np.array([[0.0, 10.0], [-1.0, 1.0]]))


ABOVE_1 = repr(float(np.nextafter(1.0, 2.0)))


@pytest.mark.parametrize(
    ('formulas', 'expected'),
    [
        # One rule alone: what its own literals or the physical bounds imply.
        (['x > 1 and x > 2 and y < 0'], ['A: x > 2.0 and y < 0.0']),
        (['x >= 0 and x <= 10 and y > 1'], ['A: y > 1.0']),
        (['x > 10', 'x < 0', 'y > 1'], ['C: y > 1.0']),
        (['x >= 0'], ['A: x >= 0.0']),
        # One contains the other.
        (['y > 1', 'y > 2'], ['A: y > 1.0']),
        (
            ['y > 2', 'x > 1 and y >= 2', 'x > 2 and y >= 2'],
            ['A: y > 2.0', 'B: x > 1.0 and y >= 2.0'],
        ),
        (['x > 1 and y > 2', 'x > 1 and y > 2'], ['A: x > 1.0 and y > 2.0']),
        # Neighbours; whether the bound between them belongs to one decides.
        (['x > 1 and x < 2', 'x >= 2 and x < 3'], ['A: x > 1.0 and x < 3.0']),
        (
            ['x > 1 and x < 2', 'x > 2 and x < 3'],
            ['A: x > 1.0 and x < 2.0', 'B: x > 2.0 and x < 3.0'],
        ),
        (['x < 1 and y > 0', 'x >= 1 and x < 3 and y > 0'], ['A: x < 3.0 and y > 0.0']),
        (['x <= 1 and y > 0', f'x >= {ABOVE_1} and y > 0'], ['A: y > 0.0']),
        (
            ['x < 1 and y > 0', 'x > 1 and y > 0'],
            ['A: x < 1.0 and y > 0.0', 'B: x > 1.0 and y > 0.0'],
        ),
        # Four tiles become a square.
        (
            [
                'x > 1 and x <= 2 and y > 1 and y <= 2',
                'x > 2 and x <= 3 and y > 1 and y <= 2',
                'x > 2 and x <= 3 and y > 2 and y <= 3',
                'x > 1 and x <= 2 and y > 2 and y <= 3',
            ],
            ['A: x > 1.0 and x <= 3.0 and y > 1.0 and y <= 3.0'],
        ),
        # Another rule has the rest.
        (['x > 2', 'x <= 2 and y > 3'], ['A: x > 2.0', 'B: y > 3.0']),
        (['x > 2 and y > 1', 'x <= 2 and y > 3'], ['B: y > 3.0', 'A: x > 2.0 and y > 1.0']),
        # All is a violation; a rule still states something.
        (['x < 1', 'x >= 1'], ['A: x < 1.0', 'B: x >= 1.0']),
        (['x >= 0', 'y > 1', 'y < 2'], ['A: x >= 0.0']),
    ],
)
def test_examples(formulas, expected):
    result = check(rules_of(*formulas), np.random.default_rng(0))
    found = [f'{rule.id}: {rule.formula(PLANE)}' for rule in result.rule_set.rules]
    assert found == expected


def test_what_became_of_each_rule_is_told():
    rule_set = rules_of('y > 1', 'x > 1 and x < 2', 'x >= 2 and x < 3', 'x > 4 and y > 5')
    noted = replace(rule_set.rules[0], note='agreed', evaluated=7)
    result = simplify(replace(rule_set, rules=(noted, *rule_set.rules[1:])))
    assert (result.before, result.after) == ((4, 7), (2, 3))
    assert result.changed == {'B': ('B', 'C')}
    assert result.removed == ('D',)
    assert result.kept == ('A',)
    assert result.rule_set.rules[0] == noted


def test_ids_made_from_literals_follow_them():
    literals = Literal(0, '<=', 2.0), Literal(1, '>', 3.0)
    wide = Rule('wide', (Literal(0, '>', 2.0),))
    [name] = rule_ids(PLANE, [literals])
    [shorter] = rule_ids(PLANE, [literals[1:]])
    ranges = np.array([[0.0, 10.0], [-1.0, 1.0]])
    learned = RuleSet(PLANE, (wide, Rule(f'{name}-2', literals)), ranges)
    assert [rule.id for rule in simplify(learned).rule_set.rules] == ['wide', shorter]
    other = Rule(shorter, (Literal(1, '>', 8.0),), note='mine')
    crowded = replace(learned, rules=(*learned.rules, other))
    assert {rule.id for rule in simplify(crowded).rule_set.rules} == {
        'wide',
        shorter,
        f'{shorter}-2',
    }
    renumbered = simplify(learned, renumber=True).rule_set
    assert [rule.id for rule in renumbered.rules] == rule_ids(
        PLANE, [rule.literals for rule in renumbered.rules]
    )


def test_two_thousand_rules_of_many_features():
    """Cells of a grid in pairs of features: they merge into what a person would have written."""
    space = FeatureSpace(tuple(Feature(f'x{index}', low=0.0, high=9.5) for index in range(40)))
    rules = []
    for pair in range(20):
        for row in range(10):
            for column in range(10):
                literals = (
                    Literal(2 * pair, '>=', float(row)),
                    Literal(2 * pair, '<', row + 1.0),
                    Literal(2 * pair + 1, '>=', float(column)),
                    Literal(2 * pair + 1, '<', column + 1.0),
                )
                if row < 5 or column > 7:
                    rules.append(Rule(f'R{len(rules)}', literals))
    rules += [replace(rule, id=f'{rule.id}-again') for rule in rules[: 2000 - len(rules)]]
    before = RuleSet(space, tuple(rules), np.tile([0.0, 9.5], (40, 1)))
    assert len(rules) > 1900
    result = check(before, np.random.default_rng(0))
    words = {rule.words(space) for rule in result.rule_set.rules}
    assert words == {f'x{2 * pair} below 5' for pair in range(20)} | {
        f'x{2 * pair + 1} at least 8' for pair in range(20)
    }


def test_of_rules_that_can_never_be_true_one_stays():
    space = FeatureSpace((Feature('x', low=0.0, high=1.0),))
    never = tuple(Rule(name, (Literal(0, '>', bound),)) for name, bound in (('a', 2.0), ('b', 3.0)))
    found = simplify(RuleSet(space, never, np.array([[0.0, 1.0]])))
    assert found.rule_set.rules == never[:1]
    assert found.removed == ('b',)
