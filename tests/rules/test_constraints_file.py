# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import (
    Constraints,
    load_constraints,
    parse_constraints,
    save_learned,
)
from strategies import FINITE, rule_sets

TEXT = """\
schema_version: 1
features:
- name: x
  unit: m
  bounds: [0.0, null]
  demonstrated: [0.25, 2.0]
- name: y
  demonstrated: [-1.0, 1.0]
rules:
- id: R1
  literals:
  - {feature: x, operator: '>', bound: 1.5}
- id: R2
  literals:
  - {feature: x, operator: <=, bound: 1.0}
  - {feature: y, operator: '<', bound: -0.5}
"""


def learned(rule_set):
    """Return constraints as a learner hands them out."""
    return Constraints(rule_set, provenance={'learned_formula': rule_set.fingerprint})


def example():
    return learned(parse_constraints(TEXT, 'text').rule_set)


def with_rule(constraints, **changes):
    first, *others = constraints.rule_set.rules
    rules = (replace(first, **changes), *others)
    return constraints.with_rule_set(replace(constraints.rule_set, rules=rules))


def bits(number):
    return struct.pack('<d', number)


@settings(max_examples=60)
@given(
    rule_sets(bounds=FINITE),
    st.lists(
        st.text(max_size=30) | st.sampled_from(['a: b # c', "it's", '- x', '\x85', '🤖', '']),
        min_size=8,
        max_size=8,
    ),
    st.integers(0, 2**70),
)
def test_what_is_written_reads_back_bit_for_bit(rule_set, texts, count):
    rules = tuple(
        replace(rule, note=text, evaluated=count, violated=count // 2)
        for rule, text in zip(rule_set.rules, texts, strict=False)
    )
    rule_set = replace(rule_set, rules=rules)
    written = Constraints(
        rule_set,
        feature_map={'pace': '/odom', 'features': [{'name': 'x: #'}]},
        tree={},
        learner={'alpha': 0.1, 'nu': None},
        coverage={'training': 1.0, 'held_out': None},
        provenance={'learned_formula': rule_set.fingerprint, 'bags': [{'name': 'Fahrt 7 – Hof'}]},
    )
    read = parse_constraints(written.dumps(), 'text')
    assert read.rule_set.space == rule_set.space
    assert read.rule_set.rules == rules
    for rule, other in zip(read.rule_set.rules, rules, strict=True):
        for literal, expected in zip(rule.literals, other.literals, strict=True):
            assert bits(literal.bound) == bits(expected.bound)
    assert read.rule_set.demonstrated.tobytes() == rule_set.demonstrated.tobytes()
    assert read.rule_set.fingerprint == rule_set.fingerprint
    for key in ('feature_map', 'tree', 'learner', 'coverage', 'provenance'):
        assert getattr(read, key) == getattr(written, key)


def test_what_a_file_leaves_out():
    read = parse_constraints(TEXT, 'text')
    assert read.rule_set.space.features[1] == Feature('y', '1', -np.inf, np.inf)
    assert read.rule_set.rules[0] == Rule('R1', (Literal(0, '>', 1.5),), True, '', 0, 0)
    assert (read.feature_map, read.tree) == (None, None)
    assert (read.learner, read.coverage, read.provenance) == ({}, {}, {})


def test_words_stand_in_the_file_but_are_not_read(tmp_path):
    example().save(tmp_path / 'c.yaml')
    text = (tmp_path / 'c.yaml').read_text()
    assert 'text: x above 1.5 m\n' in text
    read = parse_constraints(text.replace('x above 1.5 m', 'x is too large'), 'text')
    assert read.rule_set.rules == example().rule_set.rules
    assert not read.is_edited


def test_a_tree_as_deep_as_the_learner_may_grow_comes_back():
    tree = {}
    for _ in range(100):
        tree = {'split': 'x', 'branches': [{'from': 0.0, 'to': 1.0, 'samples': 2, 'below': tree}]}
    written = replace(example(), tree=tree)
    assert parse_constraints(written.dumps(), 'text').tree == tree


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        (TEXT, '', 'c.yaml'),
        (TEXT, '# nothing\n', 'c.yaml'),
        (TEXT, 'rules', "c.yaml, line 1: got 'rules'; allowed is a mapping"),
        (TEXT, '[1, 2', 'c.yaml, line 1 is not valid YAML'),
        ('schema_version: 1\n', '', "the key 'schema_version' is missing"),
        (
            'schema_version: 1\n',
            'schema_version: 99\nnew_key: 0\n',
            'c.yaml: schema_version: got 99, written by a newer occ_constraints_pkg; '
            'allowed here is 2',
        ),
        ('schema_version: 1', 'schema_version: 0', 'c.yaml, line 1: schema_version: got 0'),
        ('literals:\n  - {f', 'literal:\n  - {f', "did you mean 'literals'?"),
        ("operator: '>'", "operator: '=>'", 'c.yaml, line 12: rules[0].literals[0].operator'),
        (
            '{feature: x, operator: <=',
            '{feature: speed, operator: <=',
            "c.yaml, line 15: rules[1].literals[0].feature: got 'speed'; allowed are x, y",
        ),
        (
            'bound: 1.5',
            'bound: .nan',
            'c.yaml, line 12: rules[0].literals[0].bound: got nan; allowed is a finite number',
        ),
        ('bound: 1.5', 'bound: -.inf', 'rules[0].literals[0].bound: got -inf'),
        ('bound: 1.5', f'bound: 1{"0" * 400}', 'c.yaml: '),
        ('bound: 1.5', "bound: '1.5'", "c.yaml, line 12: rules[0].literals[0].bound: got '1.5'"),
        ('bound: 1.5', 'bound: true', 'rules[0].literals[0].bound: got True'),
        ('id: R2', 'id: R1', "c.yaml: rule id 'R1' is used twice"),
        ('name: y', 'name: x', "c.yaml: feature 'x' is named twice"),
        ('[0.0, null]', '[3.0, 1.0]', "c.yaml: feature 'x' has bounds [3.0, 1.0]"),
        ('[0.0, null]', '[.nan, null]', "c.yaml: feature 'x' has bounds [nan, inf]"),
        ('[0.25, 2.0]', '[.nan, 2.0]', "c.yaml: feature 'x' has the demonstrated range"),
        ('[0.25, 2.0]', '[0.25]', 'features[0].demonstrated'),
        (
            'bound: 1.5}',
            "bound: 1.5}\n  - {feature: x, operator: '<', bound: 1.0}",
            "c.yaml: rule 'R1' can never be true: x > 1.5 and x < 1.0",
        ),
        ('- id: R1', '- id: R1\n  evaluated: -1', 'rules[0].evaluated: got -1'),
        ('- id: R1', '- id: R1\n  enabled: maybe', "rules[0].enabled: got 'maybe'"),
    ],
)
def test_mistakes_are_told_in_one_sentence_that_names_the_file(tmp_path, old, new, sentence):
    assert old in TEXT
    path = tmp_path / 'c.yaml'
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(OccError) as caught:
        load_constraints(path)
    assert str(caught.value).startswith(str(tmp_path))
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(OccError, match='none.yaml: No such file'):
        load_constraints(tmp_path / 'none.yaml')


@pytest.mark.parametrize(
    ('changes', 'edited'),
    [
        ({}, False),
        ({'evaluated': 7, 'violated': 1}, False),
        ({'enabled': False}, True),
        ({'note': 'too strict in the yard'}, True),
        ({'literals': (Literal(0, '>', float(np.nextafter(1.5, 2.0))),)}, True),
        ({'literals': (Literal(0, '>=', 1.5),)}, True),
    ],
)
def test_edits_are_noticed(changes, edited):
    changed = with_rule(example(), **changes)
    assert changed.is_edited == edited
    assert parse_constraints(changed.dumps(), 'text').is_edited == edited


def test_a_file_written_by_hand_counts_as_edited():
    assert parse_constraints(TEXT, 'text').is_edited


def test_a_relearn_replaces_what_nobody_changed(tmp_path):
    path = tmp_path / 'deeper' / 'c.yaml'
    save_learned(example(), path)
    newer = with_rule(example(), evaluated=3)
    save_learned(newer, path)
    assert load_constraints(path).rule_set.rules == newer.rule_set.rules
    assert [item.name for item in path.parent.iterdir()] == ['c.yaml']


@pytest.mark.parametrize('hand_written', [False, True])
def test_a_relearn_never_silently_replaces_an_edit(tmp_path, hand_written):
    path = tmp_path / 'c.yaml'
    if hand_written:
        path.write_text(TEXT)
    else:
        with_rule(example(), enabled=False).save(path)
    before = path.read_bytes()
    with pytest.raises(OccError, match='c.yaml was edited since it was learned'):
        save_learned(example(), path)
    assert path.read_bytes() == before
    save_learned(example(), path, overwrite=True)
    assert load_constraints(path).rule_set.rules == example().rule_set.rules
    assert (tmp_path / 'c.yaml.bak').read_bytes() == before


def test_a_relearn_does_not_replace_another_kind_of_file(tmp_path):
    path = tmp_path / 'notes.txt'
    path.write_text('buy milk')
    with pytest.raises(OccError, match='notes.txt'):
        save_learned(example(), path, overwrite=True)
    assert path.read_text() == 'buy milk'


def test_a_failed_save_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / 'c.yaml'
    with_rule(example(), enabled=False).save(path)
    before = path.read_bytes()

    def half(self, data):
        with self.open('wb') as stream:
            stream.write(data[: len(data) // 2])
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'write_bytes', half)
    with pytest.raises(OccError, match='cannot write .*c.yaml: No space left on device'):
        example().save(path)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ['c.yaml']
    with pytest.raises(OccError, match='No space left'):
        save_learned(example(), path, overwrite=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize('target', ['taken/c.yaml', 'folder', '.'])
def test_places_that_cannot_be_written(tmp_path, monkeypatch, target):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'taken').write_text('a file')
    (tmp_path / 'folder').mkdir()
    with pytest.raises(OccError, match='cannot write'):
        example().save(target)
    assert sorted(item.name for item in tmp_path.iterdir()) == ['folder', 'taken']


def test_another_rule_set_over_the_same_features():
    rule_set = RuleSet(FeatureSpace((Feature('x'),)), (), np.array([[0.0, 1.0]]))
    constraints = replace(example(), learner={'alpha': 0.5})
    assert constraints.with_rule_set(rule_set).rule_set is rule_set
    assert constraints.with_rule_set(rule_set).learner == {'alpha': 0.5}


MAP = """\
feature_map:
  features:
    - {name: speed, unit: m/s, topic: odom}
    - {name: gap, unit: m, topic: scan, sectors: 4}
    - {name: load, topic: odom}
    - nonsense
"""
UNITS = """\
schema_version: 1
features:
  - {name: speed, unit: m/s, demonstrated: [0, 1]}
  - {name: gap_front_left, unit: m, demonstrated: [0, 1]}
  - {name: load, unit: kg, demonstrated: [0, 1]}
rules: []
"""


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        (
            'unit: m/s',
            'unit: km/h',
            "text: features[0].unit: got 'km/h', but feature_map gives speed in 'm/s'",
        ),
        ('unit: m,', 'unit: mm,', "features[1].unit: got 'mm', but feature_map gives gap_front"),
    ],
)
def test_a_unit_that_contradicts_the_feature_map_is_refused(old, new, sentence):
    whole = parse_constraints(UNITS + MAP, 'text')
    assert [feature.unit for feature in whole.rule_set.space.features] == ['m/s', 'm', 'kg']
    with pytest.raises(OccError, match=re.escape(sentence)):
        parse_constraints(UNITS.replace(old, new) + MAP, 'text')
    # Nothing contradicts a unit that is said only once.
    parse_constraints(UNITS.replace(old, new), 'text')
    parse_constraints(UNITS.replace(f'{old.rstrip(",")}, ', '') + MAP, 'text')
