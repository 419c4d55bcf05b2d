# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.calibration import (
    SafeSet,
    calibrate,
    episodes_needed,
    space_limits,
)
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.guarantee import guarantee_words, loss_words
from occ_constraints_pkg.learning.learn import learn, learn_safe_set
from occ_constraints_pkg.learning.rules_text import describe_guarantee
from occ_constraints_pkg.learning.samples import divide_samples
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.simplification import extract_and_simplify
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.rules import Feature, FeatureSpace, Verdict
from occ_constraints_pkg.rules.constraints_file import parse_constraints
from strategies import probes, tree_bounds, trees

MARGINS = st.sampled_from([0.0, 0.0625, 0.25, 1.0, 3.0]) | st.floats(0.0, 4.0)
PLANE = FeatureSpace((Feature('x', 'm'), Feature('y', 'm', -50.0, 50.0)))


def safe_set(tree, space, demonstrated):
    extent = demonstrated[:, 1] - demonstrated[:, 0]
    return SafeSet(tree, demonstrated, np.where(extent > 0, extent, 1.0), space_limits(space))


def points(space, demonstrated, *roots):
    bounds = [tree_bounds(root, space, demonstrated) for root in roots]
    together = [sum((each[index] for each in bounds), []) for index in range(len(space))]
    rows = probes(np.random.default_rng(0), together)
    return rows[((rows >= space.lows) & (rows <= space.highs)).all(axis=1)]


@settings(max_examples=60)
@given(trees(), MARGINS)
def test_the_rules_of_a_moved_safe_set_say_where_it_is(case, margin):
    tree, space, demonstrated = case
    moved = safe_set(tree, space, demonstrated).moved(margin)
    rows = points(space, moved.box, moved.tree, tree)
    inside = moved.contains(rows)
    for full in (False, True):
        rule_set = extract_rules(moved.tree, space, moved.box, full_conditions=full)
        np.testing.assert_array_equal(rule_set.verdicts(rows) == Verdict.SAFE, inside)
    simpler = extract_and_simplify(moved.tree, space, moved.box).rule_set
    np.testing.assert_array_equal(simpler.verdicts(rows) == Verdict.SAFE, inside)


@settings(max_examples=60)
@given(trees(), MARGINS, MARGINS)
def test_a_larger_margin_gives_a_larger_safe_set_that_is_never_farther_than_that(case, one, other):
    tree, space, demonstrated = case
    given = safe_set(tree, space, demonstrated)
    near, far = given.moved(min(one, other)), given.moved(max(one, other))
    rows = points(space, far.box, tree, near.tree, far.tree)
    assert not (near.contains(rows) & ~far.contains(rows)).any()
    assert not (given.contains(rows) & ~near.contains(rows)).any()
    boxes = np.stack(
        [
            np.maximum(tree.leaf_boxes(len(space))[..., 0], demonstrated[:, 0]),
            np.minimum(tree.leaf_boxes(len(space))[..., 1], demonstrated[:, 1]),
        ],
        axis=-1,
    )
    outside = np.maximum(boxes[None, ..., 0] - rows[:, None], rows[:, None] - boxes[None, ..., 1])
    distance = (np.maximum(outside, 0.0) / given.scale).max(axis=-1).min(axis=-1)
    assert (distance[far.contains(rows)] <= max(one, other) + 1e-9).all()


@settings(max_examples=40)
@given(trees())
def test_the_tolerance_of_a_state_is_the_margin_that_lets_it_in(case):
    tree, space, demonstrated = case
    given = safe_set(tree, space, demonstrated)
    rows = points(space, demonstrated, tree)[:16]
    tolerances = given.tolerances(rows)
    assert (tolerances >= 0.0).all()
    assert (tolerances[given.contains(rows)] == 0.0).all()
    for row, tolerance in zip(rows, tolerances, strict=True):
        assert given.moved(tolerance * (1 + 1e-9) + 1e-9).contains(row[None])[0]
        if tolerance > 1e-6:
            assert not given.moved(tolerance * (1 - 1e-9) - 1e-9).contains(row[None])[0]


@given(st.integers(0, 16), st.integers(0, 2**32 - 1))
def test_moving_the_bounds_of_one_box_adds_to_the_margin_of_every_state(sixteenths, seed):
    # With such numbers nothing is rounded, so the relation must hold exactly.
    rng = np.random.default_rng(seed)
    step = sixteenths / 16
    space = FeatureSpace((Feature('x'), Feature('y')))
    demonstrated = np.array([[-2.0, 2.0], [0.0, 8.0]])
    tree = Node(0, (Branch(-1.0, 1.5, 1, Node(1, (Branch(1.0, 6.0, 1, Node()),))),))
    given = safe_set(tree, space, demonstrated)
    moved = given.moved(step)
    before = extract_and_simplify(tree, space, demonstrated).rule_set
    after = extract_and_simplify(moved.tree, space, moved.box).rule_set
    # The unit of the margin stays what it was.
    after = replace(after, demonstrated=demonstrated)
    rows = rng.integers(-64, 64, size=(50, 2)) / 8
    np.testing.assert_array_equal(after.judge(rows).margin, before.judge(rows).margin + step)


def test_branches_that_move_towards_each_other_meet_in_the_middle():
    space = FeatureSpace((Feature('x'), Feature('y')))
    demonstrated = np.array([[0.0, 4.0], [0.0, 4.0]])
    low, high = (Node(1, (Branch(0.0, top, 1, Node()),)) for top in (1.0, 3.0))
    tree = Node(0, (Branch(0.0, 1.0, 1, low), Branch(3.0, 4.0, 1, high)))
    moved = safe_set(tree, space, demonstrated).moved(0.5)
    assert [(branch.low, branch.high) for branch in moved.tree.branches] == [
        (-2.0, 2.0),
        (math.nextafter(2.0, 3.0), 6.0),
    ]
    # Up to the middle the lower roof holds, beyond it the higher: no hole opens at the seam.
    rows = np.array([[2.0, 3.0], [2.0, 3.1], [2.1, 5.0], [2.1, 5.1], [1.9, 99.0]])
    assert moved.contains(rows).tolist() == [True, False, True, False, False]
    rule_set = extract_and_simplify(moved.tree, space, moved.box).rule_set
    assert (rule_set.verdicts(rows) == Verdict.SAFE).tolist() == moved.contains(rows).tolist()


@pytest.mark.parametrize(
    ('false_alarm', 'needed'),
    [(0.5, 1), (0.3, 3), (0.1, 9), (0.05, 19), (0.02, 49), (0.01, 99), (0.001, 999), (0.9, 1)],
)
def test_how_many_episodes_a_promise_takes(false_alarm, needed):
    assert episodes_needed(false_alarm) == needed
    box = safe_set(Node(), PLANE, np.array([[0.0, 1.0], [0.0, 1.0]]))
    rows, episodes = np.zeros((needed, 2)), np.arange(needed)
    _, calibration = calibrate(box, rows, episodes, false_alarm)
    assert calibration.bound <= false_alarm + 1e-12
    if needed > 1:
        with pytest.raises(OccError, match=f'needs {needed} safe episodes .*, got {needed - 1}'):
            calibrate(box, rows[1:], episodes[1:], false_alarm)


@pytest.mark.parametrize('false_alarm', [0.0, 1.0, -0.1, 1.5, math.nan, '0.1', None])
def test_a_probability_that_is_none_is_refused(false_alarm):
    with pytest.raises(OccError, match='false_alarm is .*; allowed is a number above 0 and below'):
        episodes_needed(false_alarm)


def walks(rng, episodes, steps=20):
    """(episodes, steps, 2) samples that hang together within an episode, and are all alike."""
    start = rng.normal(size=(episodes, 1, 2))
    return start + 0.1 * rng.normal(size=(episodes, steps, 2)).cumsum(axis=1)


def flat(values):
    return values.reshape(-1, values.shape[-1]), np.repeat(np.arange(len(values)), values.shape[1])


@pytest.mark.parametrize(('false_alarm', 'episodes'), [(0.1, 9), (0.1, 25), (0.25, 10)])
def test_fresh_episodes_raise_no_more_alarms_than_promised(false_alarm, episodes):
    rng = np.random.default_rng(5)
    rates, bound = [], 1.0
    for _ in range(300):
        learned = flat(walks(rng, 30))[0]
        box = np.stack([learned.min(axis=0), learned.max(axis=0)], axis=1)
        rows, names = flat(walks(rng, episodes))
        moved, calibration = calibrate(
            safe_set(Node(), FeatureSpace((Feature('x'), Feature('y'))), box),
            rows,
            names,
            false_alarm,
        )
        assert calibration.alarms_after <= episodes - calibration.rank
        fresh = walks(rng, 40)
        rates.append(1.0 - moved.contains(flat(fresh)[0]).reshape(40, -1).all(axis=1).mean())
        bound = calibration.bound
    error = np.std(rates) / math.sqrt(len(rates))
    assert np.mean(rates) <= bound + 3.0 * error
    assert bound <= false_alarm + 1e-12


def speedy(rng, episodes, steps=60):
    """(episodes, steps, 3) drives: slow while near and in mode 2, some a bit less so."""
    shape = episodes, steps // 6
    speed, near = (np.repeat(rng.random(shape), 6, axis=1) for _ in range(2))
    mode = np.repeat(rng.integers(0, 3, shape).astype(float), 6, axis=1)
    bold = rng.normal(0.0, 0.03, (episodes, 1))
    speed[(near > 0.6 + bold) & (speed > 0.5 + bold)] *= 0.4
    speed[(mode == 2) & (speed > 0.6 + bold)] *= 0.4
    return np.stack([speed, near, mode], axis=-1)


@pytest.mark.parametrize(('false_alarm', 'episodes'), [(0.1, 20), (0.1, 50), (0.05, 100)])
def test_the_promise_holds_for_conditional_rules(false_alarm, episodes):
    space = FeatureSpace((Feature('speed'), Feature('near'), Feature('mode')))
    rng = np.random.default_rng(7)
    rows, names = flat(speedy(rng, 80))
    samples = divide_samples(rows, names, space, rng=rng, held_out_share=0.0)
    found = learn_safe_set(samples, space, OCTreeSettings(), ConditionalSettings())
    assert sum(len(rule.literals) > 1 for rule in found.formula.rule_set.rules) >= 2
    rates = []
    for _ in range(60):
        moved, calibration = calibrate(found.movable, *flat(speedy(rng, episodes)), false_alarm)
        assert calibration.alarms_after <= episodes - calibration.rank
        fresh = flat(speedy(rng, 40))[0]
        rates.append(1.0 - moved.contains(fresh).reshape(40, -1).all(axis=1).mean())
    error = np.std(rates) / math.sqrt(len(rates))
    assert np.mean(rates) <= calibration.bound + 3.0 * error
    # The rules are still there, and say where the moved set is.
    written = found.write(moved).formula.rule_set
    assert sum(len(rule.literals) > 1 for rule in written.rules) >= 2
    np.testing.assert_array_equal(written.verdicts(fresh) == Verdict.SAFE, moved.contains(fresh))


def test_learning_keeps_the_promise_on_fresh_episodes_and_writes_it_down():
    rng = np.random.default_rng(1)
    rates = []
    for _ in range(60):
        rows, names = flat(walks(rng, 30))
        learned = learn(
            rows, names, PLANE, OCTreeSettings(contamination=0.05), rng=rng, false_alarm=0.2
        )
        fresh = walks(rng, 50)
        safe = learned.rule_set.verdicts(flat(fresh)[0]) == Verdict.SAFE
        rates.append(1.0 - safe.reshape(50, -1).all(axis=1).mean())
    assert np.mean(rates) <= 0.2 + 3.0 * np.std(rates) / math.sqrt(len(rates))
    calibration = learned.learner['calibration']
    assert calibration['episodes'] == learned.coverage['held_out_episodes'] == 6
    assert calibration['alarms_after'] <= min(1, calibration['alarms_before'])
    read = parse_constraints(learned.dumps(), 'text')
    assert not read.is_edited
    assert read.learner['calibration'] == calibration
    assert 'probability at most 0.2 (bound 0.143 from 6 safe episodes' in guarantee_words(
        calibration
    )
    assert describe_guarantee(read) == guarantee_words(calibration)
    edited = read.with_rule_set(type(read.rule_set)(PLANE, (), read.rule_set.demonstrated))
    assert 'edited since' in describe_guarantee(edited)


def test_without_a_promise_nothing_is_moved_and_nothing_written():
    rows, names = flat(walks(np.random.default_rng(0), 30))
    options = OCTreeSettings(contamination=0.1)
    plain = learn(rows, names, PLANE, options, rng=np.random.default_rng(0))
    promised = learn(rows, names, PLANE, options, rng=np.random.default_rng(0), false_alarm=0.2)
    assert 'calibration' not in plain.learner
    assert describe_guarantee(plain) == ''
    # The scale of the margin and the ids stay; the bounds do not.
    np.testing.assert_array_equal(plain.rule_set.demonstrated, promised.rule_set.demonstrated)
    moved = promised.learner['calibration']['margin']
    assert moved > 0.0
    old = {rule.id: rule.literals[0] for rule in plain.rule_set.rules}
    for rule in promised.rule_set.rules:
        literal = rule.literals[0]
        step = -moved if literal.is_upper else moved
        expected = old[rule.id].bound + step * plain.rule_set.scale[literal.feature]
        assert literal.bound == pytest.approx(expected, rel=1e-12)


def test_as_many_episodes_are_held_out_as_the_promise_takes_up_to_half():
    rows, names = flat(walks(np.random.default_rng(0), 40))
    rng = np.random.default_rng(0)
    learned = learn(rows, names, PLANE, rng=rng, false_alarm=0.05)
    assert learned.coverage['held_out_episodes'] == 19
    with pytest.raises(
        OccError,
        match=r'0.04 needs 24 safe .* given 20 .* false_alarm of 0.0477 or more',
    ):
        learn(rows, names, PLANE, rng=rng, false_alarm=0.04)
    with pytest.raises(OccError, match=r'the 1 episode given none can be held out .* 5 or more'):
        learn(rows[:20], names[:20], PLANE, rng=rng, false_alarm=0.5)


def test_other_episodes_can_be_calibrated_on_and_unusable_samples_are_left_out():
    rng = np.random.default_rng(0)
    rows, names = flat(walks(rng, 30))
    safe, safe_names = flat(0.1 * walks(rng, 9))
    safe[3] = np.nan
    safe[4] = 0.0, 60.0
    learned = learn(rows, names, PLANE, rng=rng, false_alarm=0.1, safe_episodes=(safe, safe_names))
    calibration = learned.learner['calibration']
    assert (calibration['episodes'], calibration['margin']) == (9, 0.0)
    assert learned.coverage['held_out_episodes'] == 6
    assert 'no bound had to be moved' in guarantee_words(calibration)
    assert loss_words(calibration) == ''


def test_a_bound_at_a_physical_limit_stays_there_and_a_rule_beyond_it_vanishes():
    space = FeatureSpace((Feature('d', '1', 0.0, 1.0), Feature('v', 'm/s')))
    rng = np.random.default_rng(0)
    rows = np.stack([rng.uniform(0.0, 0.9, size=400), rng.normal(size=400)], axis=1)
    # A safe episode that goes to the limit.
    safe = np.array([[1.0, 0.0]])
    learned = learn(rows, np.zeros(400), space, rng=rng, false_alarm=0.5, safe_episodes=(safe, [0]))
    assert [
        rule
        for rule in learned.rule_set.rules
        if rule.literals[0].feature == 0 and not rule.literals[0].is_upper
    ] == []
    vanished = learned.learner['calibration']['vanished']
    assert any('d above 0.' in words for words in vanished)
    assert 'rules dropped' in loss_words(learned.learner['calibration'])
    assert learned.rule_set.verdicts(safe).tolist() == [Verdict.SAFE]


@settings(max_examples=30)
@given(st.floats(1e-300, 1e300), st.integers(0, 2**32 - 1))
def test_rounding_never_breaks_the_promise(size, seed):
    rng = np.random.default_rng(seed)
    offset = size * rng.choice([0.0, 1e6])
    space = FeatureSpace((Feature('x'),))
    rows = offset + size * rng.normal(size=(40, 1))
    box = np.array([[rows[:20].min(), rows[:20].max()]])
    given = safe_set(Node(), space, box)
    moved, calibration = calibrate(given, rows[20:], np.arange(20), 0.1)
    assert moved.contains(rows[20:]).sum() >= calibration.rank
    assert np.isfinite(moved.box).all()
