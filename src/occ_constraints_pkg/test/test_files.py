# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Feature maps and constraints files: what is built in loads, and every float survives."""

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import BUILT_IN_MAPS, FeatureMap, load_feature_map
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import (
    Constraints,
    load_constraints,
    parse_constraints,
)


def constraints_of(name):
    feature_map = load_feature_map(name)
    space = feature_map.space
    rules = tuple(
        Rule(f'R{index}', (Literal(index, '>' if index % 2 else '<=', 0.1 + index / 7),))
        for index in range(min(5, len(space)))
    )
    demonstrated = np.tile([0.0, 1.0], (len(space), 1))
    return Constraints(RuleSet(space, rules, demonstrated), feature_map.to_document())


@pytest.mark.parametrize('name', BUILT_IN_MAPS)
def test_a_built_in_map_survives_its_document(name):
    feature_map = load_feature_map(name)
    assert FeatureMap.from_document(feature_map.to_document(), name) == feature_map
    assert len(feature_map.space) == len(feature_map.names) > 1
    assert feature_map.topics


@pytest.mark.parametrize('name', BUILT_IN_MAPS)
def test_a_constraints_file_keeps_every_bound(name, tmp_path):
    constraints = constraints_of(name)
    constraints.save(tmp_path / 'rules.yaml')
    loaded = load_constraints(tmp_path / 'rules.yaml')
    assert loaded.rule_set.fingerprint == constraints.rule_set.fingerprint
    assert [rule.literals for rule in loaded.rules] == [rule.literals for rule in constraints.rules]
    assert loaded.feature_map == constraints.feature_map


@pytest.mark.parametrize('name', BUILT_IN_MAPS)
def test_topics_move_into_a_namespace(name):
    moved = load_feature_map(name).in_namespace('robot1')
    assert all(topic.startswith('/robot1/') for topic in moved.topics)
    assert moved.space == load_feature_map(name).space


@pytest.mark.parametrize('name', ['PointGaol1', '', 'none.yaml', '..'])
def test_a_map_that_is_not_there_is_told_in_a_sentence(name):
    with pytest.raises(OccError):
        load_feature_map(name)


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('schema_version', 'schema_versoin'),
        ('operator: <=', 'operator: ='),
        ('bound: 0.1', 'bound: .nan'),
        ('rules:', 'rulez:'),
        ('R0', 'R1'),
        ('feature: x', 'feature: z'),
    ],
)
def test_a_damaged_constraints_file_is_refused(old, new):
    text = constraints_of('simple_nav').dumps()
    assert old in text
    with pytest.raises(OccError):
        parse_constraints(text.replace(old, new, 1), 'rules.yaml')


@pytest.mark.parametrize(
    'text', ['', '[]', '{}', 'a: [', '!!python/object:os.system x', '\0', 'x: &a [*a]']
)
def test_what_is_no_constraints_file_is_refused(text):
    with pytest.raises(OccError):
        parse_constraints(text, 'rules.yaml')
