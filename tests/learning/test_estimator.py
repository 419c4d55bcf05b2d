# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import doctest
import pickle
import unittest
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.learning import estimator as module
from occ_constraints_pkg.learning.estimator import OCTreeClassifier
from occ_constraints_pkg.learning.learn import learn, tree_document
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from scipy.sparse import csr_array
from strategies import fit_settings, probes, samples, tree_bounds

pytest.importorskip('sklearn', reason='scikit-learn is not installed')
# Without it scikit-learn would skip its checks of data frames.
pandas = pytest.importorskip('pandas', reason='pandas is not installed')
from sklearn.base import clone  # noqa: E402
from sklearn.utils.estimator_checks import parametrize_with_checks  # noqa: E402


def drives(rows=1000, seed=0):
    return np.random.default_rng(seed).normal([1.0, 0.0, -3.0], [0.2, 0.5, 2.0], size=(rows, 3))


def classifier(options):
    """Return the estimator with the settings of the learner."""
    own = asdict(options)
    return OCTreeClassifier(most_outside=own.pop('contamination'), **own)


def outliers(detector, rows):
    return np.count_nonzero(detector.predict(rows) == -1)


@parametrize_with_checks(
    [
        OCTreeClassifier(),
        OCTreeClassifier(contamination=0.05, alpha=0.5),
        OCTreeClassifier(clip='density', full_conditions=True, nu=0.2),
    ]
)
def test_scikit_learns_own_checks(estimator, check, monkeypatch):
    # Else scikit-learn skips its check with array API dispatch.
    monkeypatch.setenv('SCIPY_ARRAY_API', '1')
    try:
        check(estimator)
    except unittest.SkipTest as reason:
        pytest.fail(f'skipped: {reason}')


def test_the_example_of_the_docstring():
    result = doctest.testmod(module)
    assert result.attempted > 3
    assert result.failed == 0


def test_parameters_and_defaults_are_those_of_the_learner():
    own = OCTreeClassifier().get_params()
    assert own.pop('contamination') == 'auto'
    assert own.pop('conditions') == 'auto'
    # There are no families here, which estimates mainly rest on.
    own['contamination'] = own.pop('most_outside')
    assert own == asdict(OCTreeSettings(contamination=0.01))


@settings(max_examples=60)
@given(samples(), fit_settings(), st.booleans(), st.integers(0, 99))
def test_rules_and_decisions_are_those_of_learn(values, options, full, seed):
    options = OCTreeSettings(**{**asdict(options), 'full_conditions': full})
    detector = classifier(options).fit(values, groups=np.zeros(len(values)))
    space = FeatureSpace(tuple(Feature(f'x{index}') for index in range(values.shape[1])))
    rng = np.random.default_rng(seed)
    learned = learn(values, np.zeros(len(values)), space, options, rng=rng)
    assert detector.rule_set_.rules == learned.rule_set.rules
    assert tree_document(detector.tree_, space) == learned.tree
    assert detector.offset_ == 0.0
    box = detector.rule_set_.demonstrated
    points = np.concatenate([values, probes(rng, tree_bounds(detector.tree_, space, box))])
    judgement = learned.rule_set.judge(points)
    safe = judgement.verdict == Verdict.SAFE
    np.testing.assert_array_equal(detector.predict(points), np.where(safe, 1, -1))
    margin = detector.decision_function(points)
    np.testing.assert_array_equal(margin >= 0.0, safe)
    largest = np.finfo(np.float64).max
    np.testing.assert_allclose(margin, judgement.margin.clip(-largest, largest), atol=1e-300)
    np.testing.assert_array_equal(detector.score_samples(points), margin)


def fast_or_near(groups, steps):
    """Return samples of two features that are never both large, each value kept for some steps."""
    rng = np.random.default_rng(0)
    speed, near = (np.repeat(rng.random(groups), steps) for _ in range(2))
    speed[(speed > 0.5) & (near > 0.5)] -= 0.5
    return np.column_stack([speed, near, rng.random(groups * steps)])


def test_combinations_that_the_samples_avoid_are_outliers():
    rows = fast_or_near(2000, 1)
    detector = OCTreeClassifier(most_outside=None).fit(rows)
    assert detector.predict([[0.9, 0.9, 0.5], [0.9, 0.1, 0.5], [0.1, 0.9, 0.5]]).tolist() == [
        -1,
        1,
        1,
    ]
    alone = OCTreeClassifier(most_outside=None, conditions='none').fit(rows)
    assert (alone.predict([[0.9, 0.9, 0.5]]) == 1).all()
    assert all(len(rule.literals) == 1 for rule in alone.rule_set_.rules)
    with pytest.raises(ValueError, match='conditions are looked for within a box'):
        OCTreeClassifier(conditions='pairs', alpha=0.5).fit(rows)


def test_samples_of_one_group_prove_less():
    rows = fast_or_near(4, 500)
    groups = np.repeat(np.arange(4), 500)
    assert max(len(rule.literals) for rule in OCTreeClassifier().fit(rows).rule_set_.rules) > 1
    grouped = OCTreeClassifier().fit(rows, groups=groups)
    assert all(len(rule.literals) == 1 for rule in grouped.rule_set_.rules)
    with pytest.raises(ValueError, match='inconsistent numbers of samples'):
        OCTreeClassifier().fit(rows, groups=groups[1:])


@pytest.mark.parametrize('alpha', [0.0, 0.5])
@pytest.mark.parametrize('share', [0.001, 0.01, 0.0873, 0.25, 0.5])
def test_contamination_is_the_share_of_outliers(share, alpha):
    rows = drives()
    detector = OCTreeClassifier(contamination=share, alpha=alpha).fit(rows)
    wanted = np.ceil(share * 999)
    decision = detector.decision_function(rows)
    inside = decision[decision >= 0.0]
    # Fewer only where those on the border are many: the samples that set a bound of the rules.
    border = np.count_nonzero(inside == inside.min())
    assert outliers(detector, rows) <= wanted <= outliers(detector, rows) + border - 1
    assert border < 10


@pytest.mark.parametrize('share', [0.02, 0.3])
def test_bounds_are_moved_inward_or_outward_by_one_margin(share):
    # Half of what is learned from is out already where the density is clipped so hard.
    options = {'clip': 'density', 'gamma': 0.3, 'alpha': 0.5, 'max_depth': 2}
    rows = np.concatenate([drives(), drives() + 9.0])
    as_learned = OCTreeClassifier(**options).fit(rows)
    detector = OCTreeClassifier(contamination=share, **options).fit(rows)
    assert detector.offset_ * (outliers(as_learned, rows) / len(rows) - share) < 0.0
    points = np.concatenate([rows, drives(seed=1) * 2.0])
    np.testing.assert_allclose(
        detector.score_samples(points), as_learned.score_samples(points), rtol=1e-9, atol=1e-9
    )
    safe = detector.rule_set_.judge(points).verdict == Verdict.SAFE
    np.testing.assert_array_equal(detector.predict(points), np.where(safe, 1, -1))
    assert 0 < np.count_nonzero(safe) < len(points)


@settings(max_examples=60)
@given(samples(), fit_settings(), st.floats(0.001, 0.5))
def test_contamination_copes_with_any_columns(values, options, share):
    detector = classifier(options).set_params(contamination=share).fit(values)
    decision = detector.decision_function(values)
    assert np.isfinite(decision).all()
    safe = detector.rule_set_.judge(values).verdict == Verdict.SAFE
    np.testing.assert_array_equal(detector.predict(values), np.where(safe, 1, -1))
    assert np.count_nonzero(~safe) <= np.ceil(share * (len(values) - 1))


def test_a_gap_that_closes_takes_its_rule_along():
    rng = np.random.default_rng(0)
    parts = rng.normal(0.0, 1.0, 500), rng.normal(9.0, 1.0, 500), rng.normal(60.0, 1.0, 50)
    rows = np.concatenate(parts)[:, None]
    options = {'clip': 'density', 'alpha': 0.5, 'beta': 0.1, 'max_depth': 1}
    points = [[4.5], [60.0], [75.0], [200.0]]
    as_learned = OCTreeClassifier(**options).fit(rows)
    assert max(len(rule.literals) for rule in as_learned.rule_set_.rules) == 2
    assert as_learned.predict(points).tolist() == [-1, -1, -1, -1]
    detector = OCTreeClassifier(**options, contamination=0.01).fit(rows)
    assert max(len(rule.literals) for rule in detector.rule_set_.rules) == 1
    assert detector.predict(points).tolist() == [1, 1, -1, -1]


def test_equal_outliers_stay_together():
    far = np.full(5, 60.0)
    rows = np.concatenate([np.random.default_rng(0).normal(size=300), far])[:, None]
    options = {'clip': 'density', 'gamma': 0.01, 'beta': 0.1}
    assert outliers(OCTreeClassifier(**options).fit(rows), rows) == 5
    # Four are wanted.
    assert outliers(OCTreeClassifier(**options, contamination=0.01).fit(rows), rows) == 0


def test_columns_of_a_frame_name_the_features():
    frame = pandas.DataFrame(drives(), columns=['pace', 'drift', 'depth'])
    detector = OCTreeClassifier().fit(frame)
    assert detector.rule_set_.space.names == ('pace', 'drift', 'depth')
    assert detector.feature_names_in_.tolist() == ['pace', 'drift', 'depth']
    assert OCTreeClassifier().fit(drives()).rule_set_.space.names == ('x0', 'x1', 'x2')
    with pytest.raises(ValueError, match='feature names should match'):
        detector.predict(frame[['drift', 'pace', 'depth']])
    frame.columns = ['pace', 'pace', 'depth']
    with pytest.raises(ValueError, match='pace'):
        OCTreeClassifier().fit(frame)


def test_single_precision_is_widened_and_meets_its_own_bounds():
    rows = drives().astype(np.float32)
    detector = OCTreeClassifier(most_outside=0.0).fit(rows)
    assert outliers(detector, rows) == 0
    assert outliers(detector, rows.astype(np.float64)) == 0


def test_one_row_and_a_constant_column():
    detector = OCTreeClassifier().fit([[1.0, 2.0]])
    assert detector.predict([[1.0, 2.0], [1.0, 2.1]]).tolist() == [1, -1]
    rows = drives()
    rows[:, 1] = 0.5
    detector = OCTreeClassifier().fit(rows)
    assert detector.predict([[1.0, 0.5, -3.0], [1.0, 0.6, -3.0]]).tolist() == [1, -1]


def test_copies_decide_alike():
    rows = drives()
    detector = OCTreeClassifier(contamination=0.1, max_depth=2).fit(rows)
    again = clone(detector).fit(rows)
    restored = pickle.loads(pickle.dumps(detector))
    for other in (again, restored):
        np.testing.assert_array_equal(
            other.decision_function(rows), detector.decision_function(rows)
        )
        assert other.rule_set_.fingerprint == detector.rule_set_.fingerprint


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_would_be_unknown_is_refused(bad):
    detector = OCTreeClassifier().fit(drives())
    rows = drives()
    rows[3, 1] = bad
    for refuse in (detector.predict, detector.decision_function, OCTreeClassifier().fit):
        with pytest.raises(ValueError, match='contains (NaN|infinity)'):
            refuse(rows)


def test_sparse_samples_are_refused():
    detector = OCTreeClassifier().fit(drives())
    for refuse in (detector.predict, OCTreeClassifier().fit):
        with pytest.raises(TypeError, match='Sparse data was passed'):
            refuse(csr_array(drives()))


@pytest.mark.parametrize(
    ('parameters', 'sentence'),
    [
        ({'contamination': 'some'}, "contamination is 'some'; allowed are 'auto'"),
        ({'contamination': 0.0}, 'contamination is 0.0'),
        ({'contamination': 0.51}, 'contamination is 0.51'),
        ({'contamination': np.nan}, 'contamination is nan'),
        ({'most_outside': 1.0}, 'most_outside is 1.0; allowed are None and 0 <= most_outside < 1'),
        ({'clip': 'both'}, "clip is 'both'"),
        ({'max_depth': -1}, 'max_depth is -1'),
        ({'max_depth': 2.5}, 'max_depth is 2.5; allowed is a whole number'),
        ({'gamma': 'low'}, "gamma is 'low'; allowed is a number"),
        ({'contamination': None}, "contamination is None; allowed are 'auto'"),
    ],
)
def test_parameters_that_are_not_allowed(parameters, sentence):
    with pytest.raises(ValueError, match=sentence):
        OCTreeClassifier(**parameters).fit(drives())
