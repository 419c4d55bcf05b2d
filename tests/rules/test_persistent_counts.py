# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Counters go on where the process before left them, and count nothing twice."""

import json
from dataclasses import replace

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleCounts, RuleSet
from occ_constraints_pkg.rules.persistent_counts import PersistentCounts, read_counts

RULES = RuleSet(
    FeatureSpace((Feature('x'), Feature('y'))),
    (Rule('a', (Literal(0, '>', 0.5),)), Rule('b', (Literal(1, '>', 0.5),))),
    np.array([[0.0, 1.0], [0.0, 1.0]]),
)
BATCHES = [np.random.default_rng(seed).uniform(size=(20, 2)) for seed in range(6)]


def numbers(counts):
    return counts.evaluated.tolist(), counts.violated.tolist()


@pytest.mark.parametrize('repeated', [False, True])
def test_a_restart_goes_on_and_counts_a_repeat_once(tmp_path, repeated):
    plain, path = RuleCounts(RULES), tmp_path / 'counts.json'
    counts = PersistentCounts(RULES, path)
    assert not counts.resumed
    for stamp, rows in enumerate(BATCHES, start=1):
        judgement = RULES.judge(rows)
        plain.add(judgement)
        counts.add_stamped(judgement, stamp)
        if stamp == 3:
            counts.keep()
            counts = PersistentCounts(RULES, path)
            assert counts.resumed
            assert counts.until_ns == 3
            if repeated:
                counts.add_stamped(judgement, stamp)
    assert numbers(counts) == numbers(plain)
    counts.keep()
    assert numbers(read_counts(path, RULES)) == numbers(plain)
    assert [item.name for item in tmp_path.iterdir()] == ['counts.json']


def test_only_a_restart_makes_a_stamp_one_that_was_counted():
    """A sensor whose stamps stand still is counted all the same."""
    counts = PersistentCounts(RULES)
    for rows in BATCHES:
        counts.add_stamped(RULES.judge(rows), 7)
    assert counts.evaluated[0] == 120
    counts.keep()


def test_a_reset_is_kept(tmp_path):
    counts = PersistentCounts(RULES, tmp_path / 'counts.json')
    counts.add_stamped(RULES.judge(BATCHES[0]), 1)
    counts.keep()
    counts.reset()
    counts.keep()
    assert numbers(read_counts(tmp_path / 'counts.json', RULES)) == ([0, 0], [0, 0])


def test_counters_of_other_rules_are_not_taken(tmp_path):
    path = tmp_path / 'counts.json'
    counts = PersistentCounts(RULES, path)
    counts.add_stamped(RULES.judge(BATCHES[0]), 1)
    counts.keep()
    other = replace(RULES, rules=RULES.rules[:1])
    fresh = PersistentCounts(other, path)
    assert not fresh.resumed
    assert fresh.evaluated.tolist() == [0]
    fresh.add_stamped(other.judge(BATCHES[1]), 2)
    fresh.keep()
    beside = tmp_path / f'counts.json.{RULES.fingerprint}'
    assert numbers(read_counts(beside, RULES)) == numbers(counts)
    counts.reset()
    counts.keep()
    with pytest.raises(OccError, match='counts other rules'):
        read_counts(path, other)


DAMAGED = {
    'empty': b'',
    'another file': b'{"format": "x"}',
    'a list': b'[]',
    'null': b'null',
    'cut short': b'{"format": "occ_constraints counts 1"}',
    'deep': b'[' * 100_000,
    'no text': b'\xff\xfe',
    'a name that leads away': b'{"format": "occ_constraints counts 1", "rule_set": "/../../x"}',
    'too large a number': b'{"format": "occ_constraints counts 1", "until_ns": '
    + b'9' * 5000
    + b'}',
}


@pytest.mark.parametrize('text', DAMAGED.values(), ids=DAMAGED)
def test_another_file_is_kept_beside_and_counting_begins_anew(tmp_path, text):
    path = tmp_path / 'file'
    path.write_bytes(text)
    with pytest.raises(OccError, match='not a file of rule counters'):
        read_counts(path, RULES)
    with pytest.raises(OccError, match='no such file'):
        read_counts(tmp_path / 'nowhere', RULES)
    (tmp_path / 'file.damaged').write_text('an earlier one')
    counts = PersistentCounts(RULES, path)
    assert 'not a file of rule counters' in counts.problem
    assert not counts.resumed
    # Nothing is moved before something is written in its place.
    assert path.read_bytes() == text
    counts.add_stamped(RULES.judge(BATCHES[0]), 1)
    for _ in range(2):
        counts.keep()
        assert numbers(read_counts(path, RULES)) == numbers(counts)
        counts.add_stamped(RULES.judge(BATCHES[1]), 2)
    assert (tmp_path / 'file.damaged').read_text() == 'an earlier one'
    assert (tmp_path / 'file.damaged.1').read_bytes() == text
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize('name', ['.', 'x' * 300, 'file/x', '/dev/zero'])
def test_a_path_at_which_no_file_can_be_is_a_problem_of_the_counters_only(tmp_path, name):
    (tmp_path / 'file').touch()
    counts = PersistentCounts(RULES, tmp_path / name)
    assert counts.problem
    counts.add_stamped(RULES.judge(BATCHES[0]), 1)
    with pytest.raises(OccError, match='cannot write'):
        counts.keep()


def test_damaged_counters_count_nothing(tmp_path):
    path = tmp_path / 'counts.json'
    first = PersistentCounts(RULES, path)
    first.add_stamped(RULES.judge(BATCHES[0]), 1)
    first.keep()
    whole = json.loads(path.read_text())
    one = {'evaluated': 1, 'violated': 1}
    changes = [{'rules': {}}, {'until_ns': 'x'}, {'rules': {'a': {}, 'b': {}}}]
    for wrong in (-1, True, 1.5, '1', None, 2**70):
        changes.append({'rules': {'a': one, 'b': {**one, 'violated': wrong}}})
    for change in changes:
        path.write_text(json.dumps(whole | change))
        with pytest.raises(OccError, match='not a file of rule counters'):
            read_counts(path, RULES)
        assert numbers(PersistentCounts(RULES, path)) == ([0, 0], [0, 0])
