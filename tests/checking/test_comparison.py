# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What got worse, on data small enough to know the answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.checking.comparison import Side, compare_sides
from occ_constraints_pkg.checking.comparison_text import (
    comparison_document,
    describe_comparison,
)
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet

SPACE = FeatureSpace((Feature('speed', 'm/s', 0.0, 10.0), Feature('range', 'm', 0.0)))
RULES = RuleSet(
    SPACE,
    (Rule('FAST', (Literal(0, '>', 2.0),)), Rule('NEAR', (Literal(1, '<', 0.5),))),
    np.array([[0.0, 4.0], [0.0, 2.0]]),
)
SAFE, FAST, FASTER, NEAR, BOTH, LOST = (
    (1.0, 1.0), (3.0, 1.0), (6.0, 1.0), (1.0, 0.4), (3.0, 0.4), (np.nan, 1.0),
)  # fmt: skip
MIRROR = {
    'new': 'gone',
    'longer': 'shorter',
    'deeper': 'shallower',
    'same': 'same',
}
MIRROR |= {other: one for one, other in MIRROR.items()}


def side(*recordings, names=None, rules=RULES, step=0.1, times=True, offset=0.0, stamps=0):
    """Return recordings, each a list of samples ``step`` apart, judged."""
    count = [len(rows) for rows in recordings]
    places = np.concatenate([np.arange(own) for own in count])
    numbers = np.repeat(np.arange(len(count)), count)
    ns = np.round((places * step + offset) * 1e9).astype(np.int64)
    data = Dataset(
        SPACE.names,
        np.concatenate([np.array(rows, dtype=np.float64) for rows in recordings]),
        np.round(places * step * 1e9).astype(np.int64) + stamps if times else places,
        numbers,
        times_ns=ns if times else None,
        recordings=numbers,
        sources=tuple({'name': f'r{number}'} for number in range(len(count))),
    )
    names = names or tuple(f'r{number}' for number in range(len(count)))
    return Side('side', check_data(data, rules), rules, tuple(names))


def compare(before, after, **options):
    return compare_sides(before, after, [(0, 0), (1, 1)], **options)


def kinds(result):
    return [change.kind for item in result.recordings for change in item.changes]


def test_new_and_gone():
    before, after = side([SAFE] * 20 + [FAST] * 10), side([NEAR] * 10 + [SAFE] * 20)
    result = compare(before, after)
    assert kinds(result) == ['new', 'gone']
    assert result.is_worse
    assert compare(side([FAST] * 10 + [SAFE] * 5), side([SAFE] * 15)).is_worse is False


@pytest.mark.parametrize(('length', 'kind'), [(16, 'longer'), (14, 'same'), (4, 'shorter')])
def test_lengths_within_the_tolerance_are_the_same(length, kind):
    before = side([SAFE] * 5 + [FAST] * 10 + [SAFE] * 20)
    after = side([SAFE] * 5 + [FAST] * length + [SAFE] * (30 - length))
    result = compare(before, after)
    assert kinds(result) == [kind]
    assert result.is_worse is (kind == 'longer')
    assert kinds(compare(before, after, tolerance=0.0)) == ['shorter' if length == 4 else 'longer']


def test_a_deeper_violation_is_worse_and_a_shorter_one_may_be():
    before = side([FAST] * 10 + [SAFE] * 10)
    result = compare(before, side([FASTER] * 10 + [SAFE] * 10))
    assert kinds(result) == ['deeper']
    assert result.is_worse
    assert 'margin -0.25 -> -1' in describe_comparison(result)
    assert kinds(compare(before, side([FASTER] * 2 + [SAFE] * 18))) == ['shorter']
    assert compare(before, side([FASTER] * 2 + [SAFE] * 18)).is_worse


def test_what_cannot_be_judged_any_more_is_not_gone():
    before = side([SAFE] * 10 + [FAST] * 4 + [SAFE] * 10)
    hidden = compare(before, side([SAFE] * 10 + [LOST] * 4 + [SAFE] * 10))
    (change,) = hidden.recordings[0].changes
    assert (change.kind, change.is_worse) == ('gone', True)
    assert change.unjudged == pytest.approx(0.4)
    assert 'cannot be judged after' in describe_comparison(hidden)
    # Nor is a sample that never came: the gap is longer than a verdict is valid.
    rows = [SAFE] * 10
    silent = side([*rows, *rows], step=0.1)
    gap = Side(silent.name, check_data(_late(silent.timeline.data, 3.0), RULES), RULES, ('r0',))
    assert compare(silent, gap).recordings[0].findings == ('unknown',)


def _late(data, seconds):
    times = data.times_ns.copy()
    times[len(times) // 2 :] += round(seconds * 1e9)
    return Dataset(
        data.names, data.values, data.stamps_ns, data.episodes, times_ns=times,
        recordings=data.recordings, sources=data.sources,
    )  # fmt: skip


def test_more_unknown_time_is_worse():
    result = compare(side([SAFE] * 30), side([SAFE] * 20 + [LOST] * 10))
    assert result.recordings[0].findings == ('unknown',)
    assert 'UNKNOWN    0.00 -> 1.00 s (+1.00 s)' in describe_comparison(result)
    assert not compare(side([LOST] * 30), side([SAFE] * 30)).is_worse


def test_a_recording_that_ends_early_is_worse_unless_allowed():
    before, after = side([SAFE] * 20 + [FAST] * 10), side([SAFE] * 15)
    result = compare(before, after)
    assert result.recordings[0].findings == ('too_short',)
    assert result.recordings[0].changes[0].is_worse
    assert not compare(before, after, allow_shorter=True).is_worse


def test_a_recording_without_a_counterpart_is_a_finding():
    one = side([SAFE] * 5, [SAFE] * 5, names=('a', 'b'))
    other = side([SAFE] * 5, [SAFE] * 5, names=('b', 'c'))
    result = compare(one, other)
    assert [(item.name, item.findings) for item in result.recordings] == [
        ('a', ('missing',)),
        ('b', ()),
        ('c', ('missing',)),
    ]
    assert [item.name for item in compare(one, other, by_order=True).recordings] == [
        'a and b',
        'b and c',
    ]
    with pytest.raises(DataError, match=r'no recording of side \(r0, r1\) has the name'):
        compare(side([SAFE], [SAFE]), one)
    with pytest.raises(DataError, match="two recordings of the name 'a'"):
        compare(side([SAFE], [SAFE], names=('a', 'a')), one)
    with pytest.raises(DataError, match='recordings and tables'):
        compare(one, side([SAFE], times=False))


def test_one_recording_on_each_side_needs_no_name():
    result = compare(side([SAFE], names=('a',)), side([SAFE], names=('b',)))
    assert [item.name for item in result.recordings] == ['a and b']


def test_another_rule_at_the_same_moment_is_told_as_such():
    before, after = side([SAFE] * 5 + [FAST] * 10), side([SAFE] * 5 + [NEAR] * 10)
    result = compare(before, after)
    (change,) = result.recordings[0].changes
    assert (change.kind, change.is_same_rule, change.is_worse) == ('same', False, False)
    # A second rule beside the first is one more thing that is wrong.
    both = compare(before, side([SAFE] * 5 + [BOTH] * 10))
    assert sorted(kinds(both)) == ['new', 'same']
    # At another moment it is not the same violation.
    apart = compare(before, side([NEAR] * 5 + [SAFE] * 10))
    assert sorted(kinds(apart)) == ['gone', 'new']


def test_a_violation_that_breaks_up_stays_one():
    before = side([FAST] * 20 + [SAFE] * 5)
    after = side([FAST] * 8 + [SAFE] * 7 + [FAST] * 5 + [SAFE] * 5)
    (change,) = compare(before, after, tolerance=0.0).recordings[0].changes
    assert (change.kind, len(change.before), len(change.after)) == ('shorter', 1, 2)


def test_moments_are_matched_by_stamps_where_both_have_them():
    rows = [SAFE] * 30 + [FAST] * 5 + [SAFE] * 30
    later = side(rows, offset=7.0)
    assert kinds(compare(side(rows), later)) == ['same']
    assert compare(side(rows), later).recordings[0].shift == pytest.approx(-7.0)
    longer = side([SAFE] * 30 + [FAST] * 15 + [SAFE] * 20, offset=7.0)
    text = describe_comparison(compare(side(rows), longer))
    assert 'shifted    -7.00 s, by header stamps' in text
    # By the clock of the recording that shows it.
    assert 'longer     10.000 s to 11.500 s' in text
    assert kinds(compare(side(rows), later, clock='start')) == ['gone', 'new']
    # Two drives of different days: by the time since the start.
    assert kinds(compare(side(rows), side(rows, stamps=10**15))) == ['same']
    assert kinds(compare(side(rows), side(rows, stamps=10**15, offset=7.0))) == ['gone', 'new']


SAMPLES = st.lists(
    st.sampled_from([SAFE, SAFE, FAST, FASTER, NEAR, BOTH, LOST]), min_size=1, max_size=40
)
TIMES = st.booleans()


@given(SAMPLES, SAMPLES, TIMES, st.sampled_from([0.0, None]))
def test_nothing_differs_from_itself(first, second, times, tolerance):
    both = side(first, second, times=times)
    result = compare(both, both, tolerance=tolerance)
    assert set(kinds(result)) <= {'same'}
    assert len(kinds(result)) <= len(both.timeline.violations)
    assert not result.is_worse
    assert all(change.seconds == 0.0 for item in result.recordings for change in item.changes)


@given(SAMPLES, SAMPLES, TIMES, st.sampled_from([0.0, 0.25, 0.5]))
def test_swapped_sides_are_mirrored(first, second, times, tolerance):
    one, other = side(first, times=times), side(second, times=times)
    there = compare(one, other, tolerance=tolerance)
    back = compare(other, one, tolerance=tolerance)
    assert sorted(MIRROR[kind] for kind in kinds(there)) == sorted(kinds(back))
    (item,), (mirrored,) = there.recordings, back.recordings
    assert (item.before, item.after) == (mirrored.after, mirrored.before)


@given(SAMPLES, SAMPLES, TIMES)
def test_every_violation_is_in_one_change(first, second, times):
    one, other = side(first, times=times), side(second, times=times)
    (item,) = compare(one, other).recordings
    for place, own in enumerate((one, other)):
        told = [
            id(interval)
            for change in item.changes
            for interval in (change.before, change.after)[place]
        ]
        assert sorted(told) == sorted(map(id, own.timeline.violations))


@given(SAMPLES, SAMPLES, TIMES)
def test_a_side_with_more_of_the_bad_is_worse(first, second, times):
    one, other = side(first, times=times), side(second, times=times)
    result = compare(one, other, tolerance=0.0)
    before, after = result.recordings[0].before, result.recordings[0].after
    if after.unknown > before.unknown + 1e-9:
        assert result.is_worse
    if not one.timeline.violations and other.timeline.violations:
        assert result.is_worse
    document = comparison_document(result)
    assert document['worse'] is result.is_worse
    assert describe_comparison(result).startswith('worse' if result.is_worse else 'not worse')
