# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
from hypothesis import given
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.listing import read_rules_in_force, rules_in_force_text
from occ_constraints_pkg.rules.space import Feature, FeatureSpace
from strategies import rule_sets


@given(rule_sets())
def test_whoever_hears_the_rules_in_force_can_judge_by_them(rule_set):
    heard = read_rules_in_force(rules_in_force_text(rule_set), 'topic rules')
    assert heard.fingerprint == rule_set.fingerprint
    assert heard.rules == rule_set.rules
    np.testing.assert_array_equal(heard.scale, rule_set.scale)


TEXT = rules_in_force_text(
    RuleSet(FeatureSpace((Feature('x'),)), (Rule('R', (Literal(0, '>', 1.0),)),), [[0.0, 1.0]])
)


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        '[' * 100_000,
        '{"rules": 1, "features": 2}',
        '{"rules": ["x"], "features": []}',
        json.dumps({key: value for key, value in json.loads(TEXT).items() if key != 'features'}),
        TEXT.replace('"bound": 1.0', '"bound": NaN'),
        TEXT.replace('"operator": ">"', '"operator": "="'),
        TEXT.replace('"feature": "x"', '"feature": "y"'),
    ],
)
def test_anything_else_is_refused_in_one_sentence(text):
    with pytest.raises(OccError, match='topic rules') as error:
        read_rules_in_force(text, 'topic rules')
    assert len(str(error.value)) < 300
