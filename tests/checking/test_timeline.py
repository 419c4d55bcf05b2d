# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in time, on data small enough to know the answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.checking.timeline import make_timeline
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict

SPACE = FeatureSpace((Feature('speed', 'm/s', 0.0, 10.0), Feature('range', 'm')))
RULES = RuleSet(
    SPACE,
    (
        Rule('FAST', (Literal(0, '>', 2.0),)),
        Rule('NEAR', (Literal(0, '>=', 1.0), Literal(1, '<', 0.5))),
        Rule('OFF', (Literal(1, '<', 100.0),), enabled=False),
    ),
    np.array([[0.0, 4.0], [0.0, 2.0]]),
)
SAFE, FAST, NEAR, LOST = (0.0, 1.0), (3.0, 1.0), (1.0, 0.25), (np.nan, 1.0)


def dataset(rows, seconds=None, episodes=None, recordings=None):
    count = len(rows)
    times = None if seconds is None else np.round(np.array(seconds) * 1e9).astype(np.int64)
    return Dataset(
        SPACE.names,
        np.array(rows, dtype=np.float64).reshape(count, 2),
        np.arange(count) if times is None else times + 10,
        np.zeros(count, dtype=np.int64) if episodes is None else np.array(episodes),
        times_ns=times,
        recordings=np.zeros(count, dtype=np.int64) if recordings is None else np.array(recordings),
        sources=({'name': 'one'}, {'name': 'two'}),
    )


def timeline(*arguments, timeout=1.0, bridge=0.5, **more):
    data = dataset(*arguments, **more)
    return make_timeline(RULES, data, RULES.judge(data.values), timeout=timeout, bridge=bridge)


def told(item):
    return RULES.rules[item.rule].id, round(item.start, 9), round(item.end, 9)


def test_a_verdict_stands_until_the_next_sample():
    line = timeline([SAFE, FAST, FAST, SAFE, NEAR], [0.5, 1.0, 1.2, 1.4, 1.6], bridge=0.0)
    assert [told(item) for item in line.violations] == [('FAST', 1.0, 1.4), ('NEAR', 1.6, 1.8)]
    fast, near = line.violations
    assert fast.samples.tolist() == [1, 2]
    assert (fast.worst, fast.margin) == (1, -0.25)
    # By its literals: (1 - 1) / 4 and (0.25 - 0.5) / 2.
    assert (near.worst, near.margin) == (4, 0.0)
    # 0.5 s, 0.4 s, 0.2 s, and for the last sample the median, 0.2 s.
    assert line.duration == pytest.approx(1.3)
    assert line.shares == pytest.approx({'SAFE': 0.7 / 1.3, 'VIOLATED': 0.6 / 1.3, 'UNKNOWN': 0.0})


def test_each_true_rule_has_its_own_intervals():
    both = (3.0, 0.25)
    line = timeline([FAST, both, NEAR, both], [0.0, 0.1, 0.2, 0.3], bridge=0.0)
    assert [told(item) for item in line.violations] == [
        ('FAST', 0.0, 0.2),
        ('NEAR', 0.1, 0.4),
        ('FAST', 0.3, 0.4),
    ]


def test_breaks_up_to_the_bridge_are_joined():
    rows, seconds = [FAST, SAFE, FAST, SAFE, FAST], [0.0, 0.2, 0.7, 0.9, 1.5]
    line = timeline(rows, seconds, bridge=0.5)
    assert [told(item) for item in line.violations] == [('FAST', 0.0, 0.9), ('FAST', 1.5, 1.85)]
    assert line.violations[0].active == pytest.approx(0.4)
    assert line.violations[0].samples.tolist() == [0, 2]
    assert len(timeline(rows, seconds, bridge=0.0).violations) == 3
    assert len(timeline(rows, seconds, bridge=0.7).violations) == 1


def test_a_verdict_lapses_when_nothing_comes():
    line = timeline([FAST, FAST, SAFE], [0.0, 3.0, 3.5], bridge=0.0)
    assert [told(item) for item in line.violations] == [('FAST', 0.0, 1.0), ('FAST', 3.0, 3.5)]
    assert line.silence.tolist() == [2.0, 0.0, 0.75]
    assert line.shares['UNKNOWN'] == pytest.approx(2.75 / line.duration)


def test_what_cannot_be_judged_has_intervals_too():
    line = timeline([SAFE, LOST, LOST, (11.0, 1.0), FAST], [0.0, 0.1, 0.2, 0.3, 0.4])
    (lost,) = line.unknown
    assert (lost.rule, lost.start, lost.end) == (-1, 0.1, pytest.approx(0.4))
    assert lost.samples.tolist() == [1, 2, 3]
    assert [told(item)[0] for item in line.violations] == ['FAST']


def test_episodes_and_recordings_are_apart():
    """Two robots in one table, then another recording."""
    rows = [FAST, SAFE, FAST, FAST, FAST, SAFE]
    seconds = [0.0, 0.0, 0.2, 0.2, 0.0, 0.1]
    line = timeline(rows, seconds, [0, 1, 0, 1, 2, 2], [0, 0, 0, 0, 1, 1])
    assert [(item.source, item.episode, *told(item)) for item in line.violations] == [
        (0, 0, 'FAST', 0.0, 0.4),
        (0, 1, 'FAST', 0.2, 0.4),
        (1, 2, 'FAST', 0.0, 0.1),
    ]
    assert line.duration == pytest.approx(0.4 + 0.4 + 0.2)


def test_tables_know_rows_and_no_time():
    line = timeline([FAST, FAST, SAFE, FAST], timeout=0.1, bridge=9.0)
    assert line.unit == 'row'
    assert [told(item) for item in line.violations] == [('FAST', 0.0, 2.0), ('FAST', 3.0, 4.0)]
    assert line.shares == {'SAFE': 0.25, 'VIOLATED': 0.75, 'UNKNOWN': 0.0}


def test_a_single_sample_takes_no_time_and_is_counted():
    line = timeline([FAST], [4.0])
    assert [told(item) for item in line.violations] == [('FAST', 4.0, 4.0)]
    assert line.duration == 0.0
    assert line.shares == {'SAFE': 0.0, 'VIOLATED': 1.0, 'UNKNOWN': 0.0}


rows_and_steps = st.lists(
    st.tuples(
        st.sampled_from([SAFE, FAST, NEAR, LOST, (3.0, 0.25)]),
        st.sampled_from([0.0, 0.1, 0.3, 2.0]),
        st.integers(0, 2),
    ),
    max_size=40,
)


@given(rows_and_steps, st.sampled_from([0.0, 0.25]))
def test_intervals_hold_exactly_the_violations(cases, bridge):
    rows = [row for row, _, _ in cases]
    seconds = np.cumsum([step for _, step, _ in cases])
    episodes = [episode for _, _, episode in cases]
    line = timeline(rows, seconds, episodes, bridge=bridge)
    judgement = line.judgement
    held = {place: [] for place in range(3)}
    for item in line.violations:
        held[item.rule] += item.samples.tolist()
        assert item.start <= item.end
        assert item.active <= item.end - item.start + 1e-9
        assert set(line.data.episodes[item.samples]) == {item.episode}
        margins = [RULES.rule_margins(line.data.values[row])[item.rule] for row in item.samples]
        assert item.margin == min(margins) == margins[item.samples.tolist().index(item.worst)]
    for place, samples in held.items():
        true = [
            row
            for row, sample in enumerate(line.data.values)
            if judgement.verdict[row] == Verdict.VIOLATED and place in RULES.violated_rules(sample)
        ]
        assert sorted(samples) == true
    unknown = np.flatnonzero(judgement.verdict == Verdict.UNKNOWN).tolist()
    assert sorted(row for item in line.unknown for row in item.samples) == unknown
    if cases:
        assert sum(line.shares.values()) == pytest.approx(1.0)
