# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.conditional import (
    ConditionalSettings,
    Feature,
)
from occ_constraints_pkg.learning.conditional.formula import as_rules
from occ_constraints_pkg.learning.conditional.learner import learn_conditional
from occ_constraints_pkg.rules.space import Feature as SpaceFeature
from occ_constraints_pkg.rules.space import FeatureSpace

EPISODES = np.repeat(np.arange(60), 100)


def extent(values, families=()):
    """Return the demonstrated box, which is what clipping nothing gives."""
    box = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    for family in families:
        box[list(family)] = box[list(family), 0].min(), box[list(family), 1].max()
    return box


def learn(values, features, settings=None, *, episodes=EPISODES, **more):
    return learn_conditional(values, episodes, features, settings, bounds=extent(values), **more)


def texts(learned, features):
    names = [feature.name for feature in features]
    return [rule.text(names) for rule in learned.rules]


def slow(rng, episodes=60, steps=100, keep=0.9):
    """Return a standard normal process that is drawn anew for each episode."""
    out = np.empty((episodes, steps))
    now = rng.normal(size=episodes)
    for step in range(steps):
        out[:, step] = now
        now = keep * now + np.sqrt(1 - keep**2) * rng.normal(size=episodes)
    return out.ravel()


def modes(rng, kinds=3):
    return np.repeat(rng.integers(0, kinds, 600), 10).astype(float)


SPEEDY = [Feature('speed', low=0.0), Feature('mode'), Feature('other')]


def speed_by_mode(seed=0):
    rng = np.random.default_rng(seed)
    mode = modes(rng)
    limit = np.array([3.0, 3.0, 0.5])[mode.astype(int)]
    return np.column_stack([np.abs(slow(rng)) % limit, mode, slow(rng)])


def test_a_speed_limit_in_one_mode_is_one_rule():
    learned = learn(speed_by_mode(), SPEEDY)
    (rule,) = learned.rules
    speed, *mode = rule.literals
    assert speed.operator == '>'
    assert 0.45 < speed.bound < 0.6
    assert [literal.text(['', 'mode']) for literal in mode] == ['mode >= 2.0', 'mode <= 2.0']
    assert rule.expected > 0.1
    assert rule.seen == 0
    assert rule.evidence > 14
    assert learned.flagged(
        [[1.0, 2.0, 0.0], [1.0, 1.0, 0.0], [0.2, 2.0, 0.0]] @ np.eye(3)
    ).tolist() == [
        True,
        False,
        False,
    ]


def test_three_literals_are_found_where_no_two_are_enough():
    rng = np.random.default_rng(0)
    values = np.column_stack([slow(rng) for _ in range(4)])
    bad = (values[:, 0] > 0) & (values[:, 1] > 0) & (values[:, 2] < 0)
    values[bad, 0] *= -1
    features = [Feature(name) for name in 'abcd']
    (rule,) = learn(values, features).rules
    assert [literal.text('abcd')[:3] for literal in rule.literals] == ['a >', 'b >', 'c <']
    assert learn(values, features, ConditionalSettings(conditions='pairs')).rules == ()


def test_a_gap_is_a_rule_of_one_feature():
    rng = np.random.default_rng(0)
    forward = np.repeat(rng.random(60) < 0.5, 100)
    speed = np.where(forward, 1.0 + np.abs(slow(rng)), -0.2 - 0.3 * np.abs(slow(rng)))
    values = np.column_stack([speed, slow(rng)])
    learned = learn(values, [Feature('v'), Feature('x')])
    gap = learned.rules[0]
    assert [literal.operator for literal in gap.literals] == ['>', '<']
    assert -0.25 < gap.literals[0].bound < 0.0
    assert 0.9 < gap.literals[1].bound < 1.01
    assert not gap.holds(values).any()


def test_any_member_of_a_family_is_one_rule():
    rng = np.random.default_rng(0)
    sectors = np.column_stack([np.abs(slow(rng)) for _ in range(6)])
    speed = np.abs(slow(rng))
    fast = (sectors.max(axis=1) > 1.5) & (speed > 0.5)
    speed[fast] = 0.5 * rng.random(fast.sum())
    values = np.column_stack([speed, sectors])
    features = [Feature('v'), *(Feature(f's{number}', family='near') for number in range(6))]
    learned = learn_conditional(values, EPISODES, features, bounds=extent(values, [range(1, 7)]))
    (text,) = texts(learned, features)
    assert 'any near > 1.5' in text
    assert 'v > 0.5' in text


def test_without_a_rule_there_is_none():
    rng = np.random.default_rng(0)
    first = slow(rng)
    values = np.column_stack(
        [first, 0.9 * first + 0.44 * slow(rng), slow(rng), modes(rng), np.exp(slow(rng))]
    )
    assert learn(values, [Feature(name) for name in 'abcde']).rules == ()


def test_what_is_kept_apart_is_not_combined():
    settings = ConditionalSettings(apart=(('mode', 'speed'),))
    assert learn(speed_by_mode(), SPEEDY, settings).rules == ()


def test_episodes_of_one_recording_prove_things_once():
    values = speed_by_mode()
    assert learn(values, SPEEDY, recordings=EPISODES // 12).rules == ()
    assert learn(values, SPEEDY, recordings=EPISODES).rules


def test_the_names_of_episodes_and_their_order_do_not_matter():
    values = speed_by_mode()
    expected = texts(learn(values, SPEEDY), SPEEDY)
    names = np.array([f'drive {number}' for number in range(60)])[EPISODES]
    assert texts(learn(values, SPEEDY, episodes=names), SPEEDY) == expected
    # Interleaved: sample by sample of all episodes.
    order = np.argsort(np.tile(np.arange(100), 60), kind='stable')
    learned = learn(values[order], SPEEDY, episodes=EPISODES[order])
    assert texts(learned, SPEEDY) == expected


def test_single_precision_is_learned_from_as_it_is():
    values = speed_by_mode().astype(np.float32)
    learned = learn(values, SPEEDY)
    assert len(learned.rules) == 1
    assert not learned.rules[0].holds(values.astype(float)).any()


def test_bounds_at_the_extremes_move_outward_and_others_stay():
    rng = np.random.default_rng(0)
    values = np.repeat(rng.normal(size=(60, 2)), 100, axis=0)
    box = extent(values)
    box[1] = -0.5, 0.5
    features = [Feature('free', low=box[0, 0] - 0.01), Feature('cut')]
    settings = ConditionalSettings(most_rules=0)
    learned = learn_conditional(values, EPISODES, features, settings, bounds=box)
    # Half way to the physical limit, so that a rule is left.
    assert learned.box[0, 0] == pytest.approx(box[0, 0] - 0.005)
    assert learned.box[0, 1] > box[0, 1]
    np.testing.assert_array_equal(learned.box[1], box[1])
    np.testing.assert_array_equal(learned.demonstrated, extent(values))
    fixed = ConditionalSettings(most_rules=0, outside=None)
    np.testing.assert_array_equal(
        learn_conditional(values, EPISODES, features, fixed, bounds=box).box, box
    )


def test_bad_rows_hide_neither_bound_nor_rule():
    rng = np.random.default_rng(0)
    clearance = 2 + 1.5 * np.sin(slow(rng, keep=0.99))
    speed = np.minimum(0.5 + 0.5 * np.abs(slow(rng, keep=0.98)), clearance - 0.4)
    values = np.column_stack([speed, clearance, slow(rng)])
    bad = rng.random(len(values)) < 0.03
    values[bad, 0], values[bad, 1] = rng.uniform(0, 2, bad.sum()), rng.uniform(0, 4, bad.sum())
    learned = learn(values, [Feature(name) for name in ('v', 'd', 'x')])
    assert 0.3 < learned.box[1, 0] < 0.55
    assert learned.rules
    assert learned.flagged(np.array([[1.5, 1.0, 0.0]])).all()


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'conditions': 'all'}, "conditions is 'all'; allowed are none, pairs, triples"),
        ({'delta': 0.0}, 'delta is 0.0; allowed is 0 < delta < 1'),
        ({'most_rules': -1}, 'most_rules is -1; allowed is 0 or more'),
        ({'outside': 1.0}, 'outside is 1.0; allowed is 0 < outside < 1'),
        ({'apart': (('a', 'b', 'c'),)}, 'apart names'),
    ],
)
def test_settings_that_are_not_allowed(change, message):
    with pytest.raises(OccError, match=message):
        ConditionalSettings(**change)


def test_samples_that_cannot_be_learned_from():
    values = speed_by_mode()
    broken = values.copy()
    broken[7, 0] = np.nan
    with pytest.raises(OccError, match='sample 7, feature 0 is nan'):
        learn_conditional(broken, EPISODES, SPEEDY, bounds=extent(values))
    with pytest.raises(OccError, match=r'samples have shape \(6000, 3\); allowed is \(n, 2\)'):
        learn_conditional(values, EPISODES, SPEEDY[:2], bounds=extent(values))
    with pytest.raises(OccError, match=r'episodes have shape \(3,\); allowed is \(6000,\)'):
        learn_conditional(values, EPISODES[:3], SPEEDY, bounds=extent(values))
    with pytest.raises(OccError, match='recordings have shape'):
        learn_conditional(values, EPISODES, SPEEDY, bounds=extent(values), recordings=EPISODES[:3])
    with pytest.raises(OccError, match=r'bounds have shape \(2, 2\); allowed is \(3, 2\)'):
        learn_conditional(values, EPISODES, SPEEDY, bounds=extent(values)[:2])


def check_rules(learned, features, rng):
    """A rule of a file is true exactly outside the safe set: on bounds, beside them, anywhere."""
    space = FeatureSpace(
        tuple(SpaceFeature(item.name, '1', item.low, item.high, item.family) for item in features)
    )
    formula, _ = as_rules(learned, space, learned.demonstrated)
    bounds = [literal.bound for rule in learned.rules for literal in rule.literals]
    pool = np.array([*bounds, *learned.box[np.isfinite(learned.box)], 0.0])
    with np.errstate(over='ignore'):
        pool = np.concatenate([pool, np.nextafter(pool, np.inf), np.nextafter(pool, -np.inf)])
    rows = rng.choice(pool[np.isfinite(pool)], size=(400, len(learned.box)))
    rows = rows[space.knows(rows)]
    np.testing.assert_array_equal(formula.rule_set.verdicts(rows) == 1, learned.flagged(rows))


def test_rules_of_a_file_say_the_same():
    check_rules(learn(speed_by_mode(), SPEEDY), SPEEDY, np.random.default_rng(0))


@effort(max_examples=60, deadline=None)
@given(st.data(), st.integers(1, 40), st.integers(1, 4), st.sampled_from([1, 3, 8]))
def test_any_finite_samples_are_learned_from(data, rows, features, most_episodes):
    finite = st.floats(allow_nan=False, allow_infinity=False)
    few = st.sampled_from([0.0, -0.0, 1.0, 2.0, -1e300, 1e300, 5e-324])
    values = data.draw(arrays(float, (rows, features), elements=st.one_of(few, finite)))
    episodes = data.draw(arrays(int, rows, elements=st.integers(1, most_episodes)))
    described = [Feature(f'x{number}', family='f' * (number > 1)) for number in range(features)]
    families = [range(2, features)] if features > 3 else []
    learned = learn_conditional(values, episodes, described, bounds=extent(values, families))
    check_rules(learned, described, np.random.default_rng(0))
    assert not learned.flagged_by_rules(values).any()


@effort(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.booleans())
def test_rules_of_many_samples_say_the_same_in_a_file(seed, kinds, coarse):
    rng = np.random.default_rng(seed)
    values = np.column_stack([slow(rng), slow(rng), rng.integers(0, kinds + 1, 6_000)])
    corner = (values[:, 0] > rng.uniform(-0.5, 0.5)) & (values[:, 1] > rng.uniform(-0.5, 0.5))
    values[corner, 0] -= 3
    values[(values[:, 2] == kinds) & (values[:, 1] < 0), 1] *= -1
    if coarse:
        values = np.round(values, 1)
    features = [Feature(name) for name in 'abm']
    learned = learn(values, features)
    assert learned.rules
    check_rules(learned, features, rng)
