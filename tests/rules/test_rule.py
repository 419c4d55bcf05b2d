# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule
from occ_constraints_pkg.rules.rule import OPERATORS
from occ_constraints_pkg.rules.ruleset import rule_ids

SPACE = FeatureSpace((Feature('v_x', 'm/s'), Feature('lidar', '1')))
LITERALS = st.builds(Literal, st.just(0), st.sampled_from(OPERATORS), st.integers(-2, 2))


@pytest.mark.parametrize(
    ('literals', 'words', 'formula'),
    [
        ([(0, '>', 1.46)], 'v_x above 1.46 m/s', 'v_x > 1.46'),
        ([(0, '>=', 1 / 3)], 'v_x at least 0.3333 m/s', f'v_x >= {1 / 3!r}'),
        ([(1, '<', 1e-7)], 'lidar below 1e-07', 'lidar < 1e-07'),
        ([(1, '<=', 2)], 'lidar at most 2', 'lidar <= 2.0'),
        (
            [(1, '>', 0.1), (0, '<', 0.5), (1, '<', 0.2)],
            'lidar between 0.1 and 0.2 and v_x below 0.5 m/s',
            'lidar > 0.1 and v_x < 0.5 and lidar < 0.2',
        ),
        ([(0, '>=', 0), (0, '<', 1)], 'v_x from 0 to 1 m/s', 'v_x >= 0.0 and v_x < 1.0'),
        # Of several literals on one side the tightest is told.
        ([(0, '>', 2), (0, '>', 1)], 'v_x above 2 m/s', 'v_x > 2.0 and v_x > 1.0'),
        ([(0, '<', 1), (0, '<=', 1)], 'v_x below 1 m/s', 'v_x < 1.0 and v_x <= 1.0'),
        # As many digits as tell a narrow gap's ends apart.
        (
            [(0, '>', 0.70001), (0, '<', 0.70002)],
            'v_x between 0.70001 and 0.70002 m/s',
            'v_x > 0.70001 and v_x < 0.70002',
        ),
        ([(0, '>=', 0), (0, '<=', 0)], 'v_x equal to 0 m/s', 'v_x >= 0.0 and v_x <= 0.0'),
    ],
)
def test_rules_in_words_and_symbols(literals, words, formula):
    rule = Rule('R', tuple(Literal(*item) for item in literals))
    assert rule.words(SPACE) == words
    assert rule.formula(SPACE) == formula


@given(st.lists(LITERALS, min_size=1, max_size=4))
def test_contradictory_rules_are_true_nowhere(literals):
    numbers = np.arange(-12, 13) / 4
    holds = np.ones(len(numbers), dtype=bool)
    for literal in literals:
        smaller = numbers < literal.bound
        equal = (numbers == literal.bound) & literal.operator.endswith('=')
        holds &= equal | (smaller if literal.is_upper else ~smaller & (numbers != literal.bound))
    assert Rule('R', tuple(literals)).is_contradictory == (not holds.any())


@pytest.mark.parametrize('bound', [np.nan, np.inf, -np.inf])
def test_a_bound_is_finite(bound):
    with pytest.raises(OccError, match='allowed is a finite number'):
        Literal(0, '>', bound)


def test_an_operator_is_one_of_four():
    with pytest.raises(OccError, match="'=' is not known; allowed are < <= > >="):
        Literal(0, '=', 1.0)


def test_a_rule_has_a_literal():
    with pytest.raises(OccError, match="'R7' has no literal"):
        Rule('R7', ())


def test_ids_outlive_a_small_change_of_bounds():
    first = [(Literal(0, '<', 1.0),), (Literal(0, '>', 2.0),), (Literal(0, '<', 3.0),)]
    again = [(Literal(0, '<', 1.1),), (Literal(0, '>', 2.1),), (Literal(0, '<', 3.1),)]
    ids = rule_ids(SPACE, first)
    assert ids == rule_ids(SPACE, again)
    assert len(set(ids)) == 3
    assert ids[2] == f'{ids[0]}-2'
