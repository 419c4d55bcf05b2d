# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.conditional import ConditionalRule, ConditionalSettings
from occ_constraints_pkg.learning.conditional import Literal as Condition
from occ_constraints_pkg.learning.conditional.forest import SafeForest
from occ_constraints_pkg.learning.conditional.formula import as_rules
from occ_constraints_pkg.learning.conditional.moving import MovableRules
from occ_constraints_pkg.learning.conditional.rules import LearnedRules
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.constraints_file import Constraints, parse_constraints
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

# A mode, a speed that has a smallest value, and a family of three.
SPACE = FeatureSpace(
    (
        Feature('mode'),
        Feature('speed', 'm/s', low=0.0),
        *(Feature(f'sector_{number}', family='sectors') for number in range(3)),
    )
)
FAMILY = 2, 3, 4
UNITS = ((0,), (1,), FAMILY)
NUMBERS = (-0.1, 0.0, 0.1, 0.5, 1.0, 1.0000000000000002, 2.0)


@st.composite
def conditions(draw):
    """Return a corner of two or three units, a discrete value, or a gap."""
    literals = []
    for columns in draw(st.lists(st.sampled_from(UNITS), min_size=2, max_size=3, unique=True)):
        bound = draw(st.sampled_from(NUMBERS))
        family = 'sectors' if columns == FAMILY else ''
        if columns == (0,) and draw(st.booleans()):
            literals += [Condition(columns, '>=', bound), Condition(columns, '<=', bound)]
        else:
            operator = draw(st.sampled_from(['<', '<=', '>', '>=']))
            literals.append(Condition(columns, operator, bound, family))
    if draw(st.booleans()):
        low, high = sorted(draw(st.lists(st.sampled_from(NUMBERS), min_size=2, unique=True))[:2])
        literals = [Condition((1,), '>', low), Condition((1,), '<', high)]
    return ConditionalRule(tuple(literals), 0.1, 0.0, draw(st.floats(10, 20)))


@st.composite
def safe_sets(draw):
    box = []
    for columns in UNITS:
        low, high = sorted(draw(st.lists(st.sampled_from(NUMBERS), min_size=2, max_size=2)))
        box += [(max(low, 0.0) if columns == (1,) else low, high)] * len(columns)
    box = np.array(box)
    box[:, 1] = np.maximum(box[:, 0], box[:, 1])
    return LearnedRules(box, box, tuple(draw(st.lists(conditions(), max_size=4))))


@given(safe_sets(), st.randoms(use_true_random=False))
def test_some_rule_is_true_exactly_outside_the_stored_safe_set(learned, random):
    formula, origins = as_rules(learned, SPACE, np.array([[0.0, 2.0]] * 5))
    stored = SafeForest.of(learned).document(SPACE)
    file = Constraints(formula.rule_set, safe_set=stored).dumps()
    written = parse_constraints(file, 'rules.yaml')
    near = [np.nextafter(x, side) for x in NUMBERS for side in (-np.inf, x, np.inf)]
    rows = np.array([[random.choice(near) for _ in range(5)] for _ in range(300)])
    rows[:, 1] = np.abs(rows[:, 1])
    expected = learned.flagged(rows)
    safe_set = SafeForest.parse(written.safe_set, SPACE)
    np.testing.assert_array_equal(safe_set.contains(rows), ~expected)
    # Where everything is safe no rule is left.
    np.testing.assert_array_equal(written.rule_set.judge(rows).verdict == 1, expected)
    assert set(origins) <= {rule.id for rule in formula.rule_set.rules}
    assert set(origins.values()) <= set(learned.rules)


@given(safe_sets(), st.sampled_from([0.0, 0.05, 0.25, 1.0]), st.randoms(use_true_random=False))
def test_moved_bounds_give_a_larger_safe_set_that_holds_what_it_tolerates(learned, margin, random):
    learned = replace(learned, steps={0: 0.1})
    limits = np.array([[-np.inf, np.inf], [0.0, np.inf], *[[-np.inf, np.inf]] * 3])
    scale = np.array([2.0, 2.0, 2.0, 2.0, 2.0])
    given = MovableRules(learned, scale, limits)
    moved = given.moved(margin)
    near = [np.nextafter(x, side) for x in NUMBERS for side in (-np.inf, x, np.inf)]
    rows = np.array([[random.choice(near) for _ in range(5)] for _ in range(200)])
    rows[:, 1] = np.abs(rows[:, 1])
    inside, tolerances = moved.contains(rows), given.tolerances(rows)
    assert not (given.contains(rows) & ~inside).any()
    assert not (inside & ~given.moved(margin * 2 + 0.01).contains(rows)).any()
    assert (tolerances[given.contains(rows)] == 0).all()
    # But for rounding.
    assert inside[tolerances < margin - 1e-9].all()
    assert not inside[tolerances > margin + 1e-9].any()
    formula, _ = as_rules(moved.learned, SPACE, np.array([[0.0, 2.0]] * 5))
    np.testing.assert_array_equal(formula.rule_set.judge(rows).verdict == 1, ~inside)


def test_a_family_moves_even_if_its_first_member_is_discrete():
    literals = Condition((1,), '>', 0.5), Condition(FAMILY, '<', 1.0, 'sectors')
    box = np.array([[0.0, 2.0]] * 5)
    rule = ConditionalRule(literals, 0.1, 0.0, 15.0)
    # The first sector had the values 0 and 0.1 only.
    given = MovableRules(
        LearnedRules(box, box, (rule,), {2: 0.1}),
        np.full(5, 2.0),
        np.array([[-np.inf, np.inf]] * 5),
    )
    (moved,) = given.moved(0.1).learned.rules
    assert [literal.bound for literal in moved.literals] == pytest.approx([0.7, 0.8])
    row = np.array([[0.0, 0.6, 0.9, 1.5, 1.5]])
    assert given.tolerances(row) == pytest.approx([0.05])


def drives(episodes=80, steps=60, seed=0):
    """Return drives in three modes, in which any near obstacle slows down."""
    rng = np.random.default_rng(seed)
    speed, near = (np.repeat(rng.random(episodes * steps // 4), 4) for _ in range(2))
    mode = np.repeat(rng.integers(0, 3, episodes * steps // 10), 10).astype(float)
    sectors = near[:, None] * rng.random((episodes * steps, 3))
    speed[sectors.max(axis=1) > 0.4] *= 0.3
    return np.column_stack([mode, speed, sectors]), np.repeat(np.arange(episodes), steps)


def learned_file(settings=None, *, conditional, seed=0, **more):
    values, episodes = drives(seed=seed)
    rng = np.random.default_rng(0)
    return learn(values, episodes, SPACE, settings, rng=rng, conditional=conditional, **more)


def test_conditional_rules_are_ordinary_rules_of_the_file():
    found = learned_file(conditional=ConditionalSettings('triples', (('mode', 'sectors'),)))
    again = parse_constraints(found.dumps(), 'rules.yaml')
    assert again.dumps() == found.dumps()
    assert not again.is_edited
    (rule,) = (rule for rule in again.rules if len(rule.literals) > 1)
    assert {literal.feature for literal in rule.literals} == {1, FAMILY}
    (entry,) = (item for item in again.evidence['rules'] if 'expected' in item)
    assert entry['id'] == rule.id
    assert entry['expected'] > 0.01 > entry['seen']
    assert again.learner['conditional']['apart'] == [['mode', 'sectors']]
    values, _ = drives(seed=1)
    flagged = again.rule_set.verdicts(values) == 1
    assert flagged.mean() < 0.02
    assert again.coverage['training'] > 0.99
    assert again.coverage['held_out'] > 0.98


def test_without_conditions_all_is_as_before():
    plain = learned_file(conditional=ConditionalSettings('none'))
    assert all(len(rule.literals) == 1 for rule in plain.rules)
    assert 'conditional' not in plain.learner
    assert not any('expected' in item for item in plain.evidence['rules'])


def test_samples_that_depend_on_each_other_prove_less():
    values, _ = drives()
    found = learned_file(
        conditional=ConditionalSettings(), independent=np.zeros(len(values), dtype=int)
    )
    assert all(len(rule.literals) == 1 for rule in found.rules)


@pytest.mark.parametrize(
    ('settings', 'more', 'message'),
    [
        (OCTreeSettings(alpha=0.5), {}, 'got clip mass, alpha 0.5, full_conditions False;'),
        (OCTreeSettings.article(), {}, 'allowed beside them are clip mass, alpha 0'),
        (OCTreeSettings(full_conditions=True), {}, 'full_conditions True'),
    ],
)
def test_what_does_not_go_with_conditions_is_refused(settings, more, message):
    with pytest.raises(ConfigurationError, match=message):
        learned_file(settings, conditional=ConditionalSettings('pairs'), **more)
