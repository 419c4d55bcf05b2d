# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What changed from one constraints file to another."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from occ_constraints_pkg.learning.changes import compare_files
from occ_constraints_pkg.learning.changes_text import comparison_document, describe_comparison
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.ruleset import rule_ids
from strategies import rule_sets

SPACE = FeatureSpace(
    (Feature('clearance', 'm', low=0.0), Feature('speed', 'm/s'), Feature('level'))
)
DEMONSTRATED = np.array([[0.5, 2.5], [0.0, 1.0], [3.0, 3.0]])


def rule(formula, name=None, **options):
    """Return a rule such as ``clearance < 0.5 and speed > 1``, with a learned rule's id or own."""
    words = [item.split() for item in formula.split(' and ')]
    literals = tuple(Literal(SPACE.index(one), sign, float(end)) for one, sign, end in words)
    return Rule(name or rule_ids(SPACE, [literals])[0], literals, **options)


def file_of(*rules, **options):
    return Constraints(RuleSet(SPACE, rules, DEMONSTRATED), **options)


def evidence(*entries):
    return {
        'near': 0.01,
        'rules': [
            {
                'id': one.id,
                'formula': one.formula(SPACE),
                'flagged': 0,
                'literals': [
                    {'near': 1, 'episodes': 1, 'closest': [{'value': v} for v in values]}
                    for values in samples
                ],
            }
            for one, samples in entries
        ],
    }


def kinds(first, second):
    result = compare_files(first, second)
    comparison_document(result)
    return [
        (item.kind, item.before and item.before.id, item.after and item.after.id)
        for item in result.rules
    ]


def test_equal_files_have_no_changes():
    one = file_of(rule('clearance < 0.5'), rule('speed > 1', 'fast'))
    other = file_of(rule('speed > 1', 'fast'), replace(rule('clearance < 0.5'), evaluated=9))
    result = compare_files(one, other)
    assert result.rules == ()
    assert describe_comparison(result) == 'same verdicts for every input within bounds'


def test_new_gone_and_edited_rules():
    close, fast = rule('clearance < 0.5', 'close'), rule('speed > 1', 'fast')
    assert kinds(file_of(close), file_of(close, fast)) == [('new', None, 'fast')]
    assert kinds(file_of(close, fast), file_of(close)) == [('gone', 'fast', None)]
    for edited in (replace(fast, enabled=False), replace(fast, note='agreed')):
        assert kinds(file_of(fast), file_of(edited)) == [('edited', 'fast', 'fast')]
    assert kinds(file_of(fast), file_of(replace(fast, id='quick'))) == [('edited', 'fast', 'quick')]


def test_a_moved_bound_in_its_unit_and_in_parts_of_what_was_demonstrated():
    result = compare_files(file_of(rule('clearance < 0.5')), file_of(rule('clearance < 0.6')))
    (change,) = result.rules
    (bound,) = change.bounds
    assert bound.change == pytest.approx(0.1)
    assert bound.relative == pytest.approx(0.05)
    assert bound.flags_more
    text = describe_comparison(result)
    assert 'clearance < 0.5 -> 0.6 m (+0.1 m, +5.00% of the demonstrated range), flags more' in text
    assert 'only B flags clearance from 0.5 to 0.6 m\n' in text
    constant = compare_files(file_of(rule('level > 3')), file_of(rule('level >= 3')))
    (bound,) = constant.rules[0].bounds
    assert (bound.change, bound.relative, bound.flags_more) == (0.0, None, True)
    assert 'level > -> >= 3, flags more' in describe_comparison(constant)


def test_demonstrations_between_two_bounds_are_named():
    old, new = rule('clearance < 0.5'), rule('clearance < 0.6')
    older = file_of(old, evidence=evidence((old, [[0.5, 0.55, 0.7]])))
    newer = file_of(new, evidence=evidence((new, [[0.6, 0.61]])))
    for first, second in ((older, newer), (newer, older)):
        (bound,) = compare_files(first, second).rules[0].bounds
        assert [item['value'] for item in bound.demonstrations] == [0.5, 0.55]
    # Of a rule that was edited in another place too, they may not be flagged.
    pair = rule('clearance < 0.5 and speed > 0.5', 'pair')
    proof = evidence((pair, [[0.5], [0.5]]))
    other = rule('clearance < 0.6 and speed > 0.7', 'pair')
    changes = compare_files(file_of(pair, evidence=proof), file_of(other)).rules[0].bounds
    assert [item.demonstrations for item in changes] == [(), ()]
    assert [item.flags_more for item in changes] == [True, False]


def test_bounds_of_people_are_told_from_those_learned():
    old, moved = rule('clearance < 0.5'), rule('clearance < 0.6')
    (change,) = compare_files(file_of(old), file_of(moved, evidence=evidence((old, [[0.5]])))).rules
    assert change.is_edited
    (change,) = compare_files(
        file_of(old), file_of(moved, evidence=evidence((moved, [[0.6]])))
    ).rules
    assert change.is_edited is False
    (change,) = compare_files(file_of(old), file_of(moved)).rules
    assert change.is_edited is None


def test_changed_conditions():
    old = rule('clearance < 0.5', 'close')
    new = rule('clearance < 0.5 and speed > 1', 'close')
    (change,) = compare_files(file_of(old), file_of(new)).rules
    assert (change.kind, change.gone, change.new) == ('conditions', (), new.literals[1:])
    assert kinds(file_of(new), file_of(old)) == [('conditions', 'close', 'close')]


def test_numbered_rules_are_matched_by_their_bounds():
    near, far = rule('clearance < 0.5 and speed > 1'), rule('clearance < 2 and speed > 3')
    far_second = replace(far, id=f'{far.id}-2')
    assert near.id == far.id
    moved = rule('clearance < 1.9 and speed > 3')
    # The first one has gone, so the second has its number now.
    assert kinds(file_of(near, far_second), file_of(moved)) == [
        ('moved', far_second.id, near.id),
        ('gone', near.id, None),
    ]


def test_features_and_feature_maps():
    other = FeatureSpace((replace(SPACE.features[0], low=-1.0), *SPACE.features[1:]))
    first, second = file_of(), Constraints(RuleSet(other, (), DEMONSTRATED))
    (change,) = compare_files(first, second).features
    assert (change.path, change.before, change.after) == (
        'clearance.bounds',
        [0.0, None],
        [-1.0, None],
    )
    maps = [
        {'pace': 'scan', 'features': [{'name': 'a', 'topic': 'x'}, {'name': 'b', 'topic': 'y'}]},
        {'pace': 'scan', 'features': [{'name': 'b', 'topic': 'z'}, {'name': 'a', 'topic': 'x'}]},
    ]
    first, second = (file_of(rule('speed > 1'), feature_map=one) for one in maps)
    result = compare_files(first, second)
    (change,) = result.feature_map
    assert (change.path, change.before, change.after) == ('features.b.topic', 'y', 'z')
    assert result.verdicts.is_same
    assert not result.is_same
    assert compare_files(first, file_of(rule('speed > 1'))).is_same


@effort(max_examples=60)
@given(rule_sets(), rule_sets())
def test_any_two_files_can_be_compared_and_shown(one, other):
    result = compare_files(Constraints(one), Constraints(other))
    text, document = describe_comparison(result), comparison_document(result)
    assert text.startswith(
        ('same verdicts', 'different verdicts', 'not proven', 'verdicts not compared')
    )
    assert document['same'] == (document['verdicts'] == 'same')
    pairs = [item for item in result.rules if item.before and item.after]
    gone = [item.before for item in result.rules if item.after is None]
    new = [item.after for item in result.rules if item.before is None]
    assert len(one.rules) - len(gone) == len(other.rules) - len(new) >= len(pairs)
