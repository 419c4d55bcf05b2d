# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.rules.rule import OPERATORS, Literal, Rule
from occ_constraints_pkg.rules.space import Feature, FeatureSpace
from occ_constraints_pkg.traffic.rules_text import in_traffic, rule_rows, rules_table

SPACE = load_feature_map('highway').space


def rule(*literals):
    """Return a rule of literals such as ``v_x < 20``."""
    parts = (text.split() for text in literals)
    return Rule('R', tuple(Literal(SPACE.index(n), op, float(bound)) for n, op, bound in parts))


@pytest.mark.parametrize(
    ('literals', 'words'),
    [
        (['v_x < 20.67'], 'slower than 20.7 m/s (74.4 km/h)'),
        (['v_x > 47.47'], 'faster than 47.5 m/s (171 km/h)'),
        (['v_x < 0'], 'backwards'),
        (['v_x < -1'], 'backwards faster than 1 m/s (3.6 km/h)'),
        (['v_x >= 10', 'v_x < 20'], 'between 10 m/s (36 km/h) and 20 m/s (72 km/h)'),
        (['v_y > 0.96'], 'moving to the left faster than 0.96 m/s'),
        (['v_y < -0.95'], 'moving to the right faster than 0.95 m/s'),
        (['v_y < 0.95'], 'not moving to the left faster than 0.95 m/s'),
        (['v_y > -0.95'], 'not moving to the right faster than 0.95 m/s'),
        (
            ['v_y > -0.5', 'v_y < 0.5'],
            'moving sideways at -0.5 to 0.5 m/s, to the left positive',
        ),
        (['p_rel4 < 18.83'], 'the vehicle ahead closer than 18.8 m'),
        (['p_rel1 < 18.83'], 'the vehicle behind closer than 18.8 m'),
        (['p_rel3 > 344.91'], 'the vehicle ahead on the left lane farther than 345 m, or none'),
        (['p_rel5 >= 500'], 'without a vehicle ahead on the right lane'),
        (
            ['p_rel0 > 20', 'p_rel0 < 30'],
            'the vehicle behind on the left lane between 20 and 30 m away',
        ),
        (['p_rel2 >= 0', 'p_rel2 < 30'], 'the vehicle behind on the right lane closer than 30 m'),
        (['d_left < 4.42'], 'centre closer than 4.42 m to the left road edge'),
        (['d_right < -1'], 'centre more than 1 m beyond the right road edge'),
        (['d_right > 3'], 'centre farther than 3 m from the right road edge'),
        (['d_right > 3', 'd_right < 5'], 'centre between 3 and 5 m from the right road edge'),
        (
            ['d_right < 4.65', 'p_rel4 < 20'],
            'centre closer than 4.65 m to the right road edge, the vehicle ahead closer than 20 m',
        ),
    ],
)  # fmt: skip
def test_words(literals, words):
    assert in_traffic(rule(*literals), SPACE) == words


def test_other_features_are_told_as_they_are():
    space = FeatureSpace((Feature('tilt', 'rad'), Feature('v_x', 'm/s')))
    found = Rule('R', (Literal(0, '>', 0.5), Literal(1, '<', 5.0)))
    assert in_traffic(found, space) == 'tilt above 0.5 rad, slower than 5 m/s (18 km/h)'


LITERAL = st.builds(
    Literal,
    st.integers(0, len(SPACE) - 1),
    st.sampled_from(OPERATORS),
    st.floats(-600.0, 600.0),
)


@given(st.lists(LITERAL, min_size=1, max_size=5))
def test_every_feature_of_a_rule_is_told_once(literals):
    found = Rule('R', tuple(literals))
    phrases = in_traffic(found, SPACE)
    assert phrases
    told = [in_traffic(Rule('R', tuple(
        item for item in literals if item.feature == feature)), SPACE)
        for feature in dict.fromkeys(item.feature for item in literals)]  # fmt: skip
    assert phrases == ', '.join(told)


def test_rows_and_table():
    rules = [rule('v_x < 20.67'), rule('v_y >= -0.95', 'v_y <= 0.96', 'p_rel4 < 26.8123')]
    rows = rule_rows(rules, SPACE)
    assert rows[1]['formula'] == 'v_y >= -0.95 ∧ v_y <= 0.96 ∧ p_rel4 < 26.81'
    assert rows[1]['words'] == 'v_y from -0.95 to 0.96 m/s and p_rel4 below 26.81 m'
    lines = rules_table(rules, SPACE).splitlines()
    assert len(lines) == 4
    assert lines[2] == (
        '| v_x below 20.67 m/s | `v_x < 20.67` | slower than 20.7 m/s (74.4 km/h) |'
    )
