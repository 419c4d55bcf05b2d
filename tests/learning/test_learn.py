# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.simplification import size
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from occ_constraints_pkg.rules.constraints_file import parse_constraints
from strategies import fit_settings, samples

PLANE = FeatureSpace((Feature('x', 'm'), Feature('y', 'm', -50.0, 50.0)))


def drive(rows=1000, episodes=10, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, 2)), np.arange(rows) * episodes // rows


def learn_plane(values, episodes, options=None, *, seed=0, **more):
    return learn(values, episodes, PLANE, options, rng=np.random.default_rng(seed), **more)


def share_safe(constraints, rows):
    return np.mean(constraints.rule_set.judge(rows).verdict == Verdict.SAFE)


def test_coverage_is_stated_on_episodes_never_learned_from():
    values, episodes = drive()
    # Each episode has its own corner, so the demonstrated box tells which were learned from.
    values += episodes[:, None] * 4.0
    learned = learn_plane(values, episodes)
    coverage = learned.coverage
    assert coverage['training_samples'] == 800
    assert coverage['held_out_samples'] == 200
    assert coverage['held_out_episodes'] == 2
    drawn = np.random.default_rng(0).choice(10, size=2, replace=False)
    held_out = np.isin(episodes, drawn)
    assert coverage['held_out'] == share_safe(learned, values[held_out])
    assert coverage['training'] == share_safe(learned, values[~held_out])
    trained = values[~held_out]
    box = np.stack([trained.min(axis=0), trained.max(axis=0)], axis=1)
    np.testing.assert_array_equal(learned.rule_set.demonstrated, box)
    # At least the 1 % that may lie outside is there, and hardly more.
    assert 0.98 < coverage['training'] <= 1.0


@pytest.mark.parametrize(
    ('episodes', 'share', 'held_out'),
    [
        (1, 0.2, 0),
        (4, 0.2, 0),
        (5, 0.2, 1),
        (10, 0.0, 0),
        (10, 0.34, 3),
        (5, 0.99, 4),
    ],
)
def test_whole_episodes_are_held_out_when_there_are_enough(episodes, share, held_out):
    learned = learn_plane(*drive(episodes=episodes), held_out_share=share)
    coverage = learned.coverage
    assert coverage['held_out_episodes'] == held_out
    assert coverage['held_out_samples'] == held_out * 1000 // episodes
    assert coverage['training_samples'] + coverage['held_out_samples'] == 1000
    assert (coverage['held_out'] is None) == (held_out == 0)


def test_the_seed_chooses_the_episodes():
    same = [learn_plane(*drive(), seed=3).rule_set.fingerprint for _ in range(2)]
    others = {learn_plane(*drive(), seed=seed).rule_set.fingerprint for seed in range(6)}
    assert same[0] == same[1]
    assert len(others) > 1


def test_samples_that_could_only_be_unknown_are_left_out_and_counted():
    values, episodes = drive(episodes=1)
    bad = values.copy()
    bad[:4] = [[np.nan, 0.0], [0.0, np.inf], [0.0, 50.1], [-np.inf, 0.0]]
    learned = learn_plane(bad, episodes)
    assert learned.learner['unusable_samples'] == 4
    assert learned.coverage['training_samples'] == 996
    clean = learn_plane(values[4:], episodes[4:])
    assert learned.rule_set.fingerprint == clean.rule_set.fingerprint


def test_what_was_learned_is_all_in_the_file():
    options = OCTreeSettings(clip='density', alpha=0.5, max_depth=3)
    learned = learn_plane(
        *drive(), options, feature_map={'pace': 'odom'}, bags=[{'name': 'a', 'messages': 3}]
    )
    read = parse_constraints(learned.dumps(), 'text')
    assert not read.is_edited
    assert read.rule_set.rules == learned.rule_set.rules
    assert read.learner == {
        **vars(options),
        'unusable_samples': 0,
        'extracted_rules': learned.learner['extracted_rules'],
        'extracted_literals': learned.learner['extracted_literals'],
    }
    rules, literals = size(read.rule_set)
    assert rules <= learned.learner['extracted_rules']
    assert literals <= learned.learner['extracted_literals']
    assert read.feature_map == {'pace': 'odom'}
    assert read.provenance['bags'] == [{'name': 'a', 'messages': 3}]
    assert read.coverage == learned.coverage
    split = read.tree['split']
    column = PLANE.index(split)
    literals = {
        (item.feature, item.operator, item.bound)
        for rule in read.rule_set.rules
        for item in rule.literals
    }
    assert (column, '<', read.tree['branches'][0]['from']) in literals
    assert (column, '>', read.tree['branches'][-1]['to']) in literals


def test_one_row():
    learned = learn_plane([[1.0, 2.0]], [0])
    verdicts = learned.rule_set.judge([[1.0, 2.0], [1.0, np.nextafter(2.0, 3.0)]]).verdict
    assert verdicts.tolist() == [Verdict.SAFE, Verdict.VIOLATED]
    assert learned.coverage['training'] == 1.0
    assert learned.tree == {}


def test_fewer_rows_than_features():
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(5)))
    values = np.random.default_rng(0).normal(size=(3, 5))
    learned = learn(values, [0, 1, 2], space, rng=np.random.default_rng(0))
    assert learned.coverage['training'] == 1.0
    assert len(learned.rule_set.rules) == 10


def test_a_constant_column_may_not_vary():
    values, episodes = drive(episodes=1)
    values[:, 0] = 0.1
    learned = learn_plane(values, episodes)
    off = [[np.nextafter(0.1, 1.0), 0.0], [np.nextafter(0.1, 0.0), 0.0], [0.1, 0.0]]
    assert learned.rule_set.judge(off).verdict.tolist() == [1, 1, 0]


@settings(max_examples=40)
@given(samples(), fit_settings(), st.integers(1, 8))
def test_learning_copes_with_any_columns(values, options, episodes):
    names = tuple(Feature(f'x{index}') for index in range(values.shape[1]))
    numbers = np.arange(len(values)) % episodes
    learned = learn(values, numbers, FeatureSpace(names), options, rng=np.random.default_rng(0))
    read = parse_constraints(learned.dumps(), 'text')
    np.testing.assert_array_equal(
        read.rule_set.judge(values).verdict, learned.rule_set.judge(values).verdict
    )
    if options.nu is not None:
        assert learned.coverage['training'] >= 1.0 - options.nu - 1e-9


@pytest.mark.parametrize(
    ('values', 'share', 'sentence'),
    [
        (np.empty((0, 2)), 0.2, 'there are no samples to learn from'),
        (np.empty((3, 3)), 0.2, r'rows of 2 features \(x, y\)'),
        (
            [[np.nan, 99.0], [0.0, 99.0]],
            0.2,
            "none of the 2 samples is usable: .*; worst is 'y', unusable in 100% of them",
        ),
        ([[0.0, 0.0]], 1.0, 'held_out_share is 1.0'),
        ([[0.0, 0.0]], np.nan, 'held_out_share is nan'),
    ],
)
def test_what_cannot_be_learned_from(values, share, sentence):
    with pytest.raises(OccError, match=sentence):
        learn_plane(values, np.zeros(len(values)), held_out_share=share)


def test_a_very_long_formula_is_learned_without_evidence():
    values = np.random.default_rng(0).random((30, 1100))
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(1100)))
    rng = np.random.default_rng(0)
    options = OCTreeSettings(max_depth=0)
    learned = learn(values, np.zeros(30), space, options, rng=rng)
    assert (len(learned.rule_set.rules), learned.evidence) == (2200, {})
    narrow = FeatureSpace(space.features[:3])
    learned = learn(values[:, :3], np.zeros(30), narrow, options, rng=rng)
    assert len(learned.evidence['rules']) == len(learned.rule_set.rules) == 6
    assert all(
        list(sample) == ['value']
        for rule in learned.evidence['rules']
        for literal in rule['literals']
        for sample in literal['closest']
    )
