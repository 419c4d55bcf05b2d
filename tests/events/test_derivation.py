# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Events from verdicts: the same as the intervals of occ check, whatever the clocks do."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.checking.timeline import make_timeline
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.derivation import RuleSample, Sample, Settings, VerdictEvents
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.events.offline import events_of_rows
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict

SECOND = 10**9
SPACE = FeatureSpace((Feature('speed', 'm/s'), Feature('clearance', 'm')))
RULES = RuleSet(
    SPACE,
    (
        Rule('FAST', (Literal(0, '>', 1.0),)),
        Rule('NEAR', (Literal(0, '>', 0.5), Literal(1, '<', 0.5))),
    ),
    np.array([[0.0, 4.0], [0.0, 2.0]]),
)
VALUES = st.sampled_from([0.0, 0.4, 0.7, 0.95, 1.2, 3.0, math.nan])
STEPS = st.sampled_from([0, 1, 100, 200, 500, 501, 999, 1000, 1001, 1500, 1501, 4000])


@st.composite
def drives(draw):
    """Return rows with stamps, arrivals and episodes, on a grid of ms so that limits are met."""
    count = draw(st.integers(1, 30))
    values = np.array(
        draw(st.lists(st.tuples(VALUES, VALUES), min_size=count, max_size=count)), dtype=float
    )
    columns = [
        np.cumsum(draw(st.lists(STEPS, min_size=count, max_size=count))) * 10**6 for _ in range(2)
    ]
    stamps, times = columns
    if draw(st.booleans()):
        # A clock that was set back.
        stamps[draw(st.integers(0, count - 1)) :] -= 2 * SECOND
    episodes = np.sort(draw(st.lists(st.integers(0, 2), min_size=count, max_size=count)))
    return values, stamps.astype(np.int64), times.astype(np.int64), episodes.astype(np.int64)


@given(drives(), st.sampled_from([0.0, 0.2, 0.5, 1.0]), st.sampled_from([0.5, 1.0]))
def test_they_are_the_intervals_of_occ_check_one_for_one(drive, bridge, timeout):
    values, stamps, times, episodes = drive
    # The same input once more is no other row, neither live nor in a recording.
    new = np.append(True, (np.diff(stamps) != 0) | (np.diff(episodes) != 0))
    values, stamps, times, episodes = values[new], stamps[new], times[new], episodes[new]
    data = Dataset(SPACE.names, values, stamps, episodes, times_ns=times, sources=({'name': 'a'},))
    line = make_timeline(RULES, data, RULES.judge(values), timeout=timeout, bridge=bridge)
    events = events_of_rows(RULES, values, stamps, times, episodes, Settings(bridge, timeout, 0.1))
    assert all(event.ended is not None for event in events)

    def told(rows):
        return int(stamps[rows[0]]), int(stamps[rows[-1]])

    assert sorted(
        (item.rule, item.stamps.began, item.stamps.last, item.stamps.worst, item.margin, item.began)
        for item in events
        if item.kind == 'violation'
    ) == sorted(
        (
            RULES.rules[item.rule].id,
            *told(item.samples),
            int(stamps[item.worst]),
            item.margin,
            int(times[item.samples[0]]),
        )
        for item in line.violations
    )
    unknown = [(e.stamps.began, e.stamps.last) for e in events if e.kind == 'unknown']
    assert sorted(unknown) == sorted(told(item.samples) for item in line.unknown)
    # Only the last of an episode is valid for a time that nothing tells.
    last = set(np.flatnonzero(np.append(np.diff(episodes) != 0, True)).tolist())
    ends = sorted(
        round(item.end * 1e9) for item in line.violations if int(item.samples[-1]) not in last
    )
    assert set(ends) <= {e.ended for e in events if e.kind == 'violation'}
    for event in events:
        if event.kind == 'near_miss':
            assert 0.0 <= event.margin < 0.1
            assert {event.stamps.began, event.stamps.worst, event.stamps.last} <= set(
                stamps.tolist()
            )


def sample(seconds, speed, *, wall=0, stamp=None, **more):
    row = np.array([[speed, 2.0]])
    judgement = RULES.judge(row)
    verdict = Verdict(judgement.verdict[0])
    rules = (
        (RuleSample('FAST', 'speed above 1 m/s', (1.0 - speed) / 4.0, {'speed': speed}),)
        if verdict is Verdict.VIOLATED
        else ()
    )
    steady = round(seconds * SECOND)
    return Sample(
        verdict,
        float(judgement.margin[0]),
        steady if stamp is None else stamp,
        steady + wall,
        steady,
        rules=rules,
        **more,
    )


def phases(changes):
    return [(event.kind, phase) for event, phase in changes]


def test_an_event_is_over_only_once_the_bridge_has_passed():
    derived = VerdictEvents('/', Settings(bridge=0.5))
    assert phases(derived.add(sample(0.0, 2.0))) == [('violation', 'began')]
    assert phases(derived.add(sample(0.1, 3.0))) == [('violation', 'update')]
    assert derived.add(sample(0.2, 0.0)) == []
    # A break of 0.5 s is bridged, one of 0.6 s is not.
    assert derived.add(sample(0.7, 2.0)) == []
    assert derived.add(sample(0.8, 0.0)) == []
    [(event, phase)] = derived.add(sample(1.4, 0.0))
    assert (phase, event.margin) == ('ended', -0.5)
    assert (event.began, event.worst, event.ended) == (0, SECOND // 10, 8 * SECOND // 10)
    assert event.values == {'speed': 3.0}


def test_what_nothing_continues_ends_though_nothing_comes():
    derived = VerdictEvents('/', Settings())
    derived.add(sample(0.0, 2.0))
    assert derived.tick(2 * SECOND) == []
    [(event, phase)] = derived.tick(3 * SECOND)
    assert (phase, event.ended) == ('ended', SECOND)
    assert derived.tick(4 * SECOND) == []


@pytest.mark.parametrize('jump', [-3600, 3600])
def test_a_clock_that_is_set_does_not_change_how_long_an_event_lasted(jump):
    derived = VerdictEvents('/', Settings(bridge=0.0))
    before, after = 10**18, 10**18 + jump * SECOND
    derived.add(sample(0.0, 2.0, wall=before, stamp=before))
    derived.add(sample(0.1, 3.0, wall=after, stamp=before + SECOND // 10))
    changes = derived.add(sample(0.2, 0.0, wall=after, stamp=before + SECOND // 5))
    changes += derived.add(sample(0.3, 0.0, wall=after, stamp=before + 3 * SECOND // 10))
    [(event, _)] = changes
    assert (event.began, event.seconds) == (before, pytest.approx(0.2))
    assert event.worst == before + SECOND // 10
    [(later, _)] = derived.add(sample(5.0, 2.0, wall=after))
    assert later.began == after + 5 * SECOND


def test_a_near_miss_is_told_when_it_is_over_and_only_without_a_violation():
    derived = VerdictEvents('/', Settings(bridge=0.2, near_margin=0.05))
    near = {'nearest': lambda: RuleSample('FAST', 'speed above 1 m/s', 0.0125, {'speed': 0.95})}
    assert derived.add(sample(0.0, 0.95, **near)) == []
    assert derived.add(sample(0.1, 0.0)) == []
    changes = derived.add(sample(0.4, 0.0))
    assert phases(changes) == [('near_miss', 'began'), ('near_miss', 'ended')]
    began, ended = changes[0][0], changes[1][0]
    assert began.ended is None
    assert (ended.rule, ended.seconds) == ('FAST', pytest.approx(0.1))
    assert ended.text == 'margin 0.0125: close to speed above 1 m/s'
    # One that leads to a violation is that violation.
    assert derived.add(sample(1.0, 0.95, **near)) == []
    assert phases(derived.add(sample(1.1, 2.0))) == [('violation', 'began')]
    assert derived.add(sample(1.2, 0.95, **near)) == []
    assert phases(derived.add(sample(1.3, 0.0)) + derived.add(sample(2.0, 0.0))) == [
        ('violation', 'ended')
    ]


def test_that_nothing_can_be_judged_is_an_event_of_its_own():
    derived = VerdictEvents('/', Settings())
    derived.add(sample(0.0, 0.0))
    silence = {
        'verdict': Verdict.UNKNOWN,
        'margin': math.nan,
        'stamp': 0,
        'is_answer': False,
    }
    for second, reason in ((1, 'no input for 1 s'), (2, 'no input for 2 s'), (3, 'disabled')):
        changes = derived.add(
            Sample(**silence, wall=second * SECOND, steady=second * SECOND, reason=reason)
        )
        assert phases(changes) == {1: [('unknown', 'began')], 3: [('unknown', 'update')]}.get(
            second, []
        )
    assert derived.is_unjudged
    assert derived.add(sample(4.0, 0.0)) == []
    [(event, phase)] = derived.tick(round(4.6 * SECOND))
    assert (phase, event.seconds) == ('ended', 3.0)
    assert event.text == 'UNKNOWN: no input for 1 s'
    assert event.reason == 'no input for 1 s; then: disabled'


def test_silence_that_began_with_the_last_verdict_is_one_event():
    derived = VerdictEvents('/', Settings())
    derived.add(sample(1.0, 0.0))
    changes = []
    for second in range(4, 8):
        silence = Sample(
            Verdict.UNKNOWN, math.nan, SECOND, SECOND, SECOND, reason='no verdict', is_answer=False
        )
        changes += derived.add(silence)
        changes += derived.tick(second * SECOND)
    assert phases(changes) == [('unknown', 'began')]


def test_other_rules_end_what_the_earlier_ones_began():
    derived = VerdictEvents('/', Settings())
    derived.add(sample(0.0, 2.0, rule_set='a'))
    changes = derived.add(sample(0.1, 2.0, rule_set='b'))
    assert [(event.rule_set, phase) for event, phase in changes] == [('a', 'ended'), ('b', 'began')]
    assert changes[0][0].reason == 'the rules were changed'


@pytest.mark.parametrize('settings', [{'bridge': -1.0}, {'timeout': math.inf}, {'near_margin': -1}])
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(OccError, match='allowed are finite numbers from 0 on'):
        Settings(**settings)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'schema': 2}, 'schema 2; allowed is 1 at most'),
        ({'kind': 'crash'}, 'kind: got '),
        ({'began': 'now'}, 'began: got '),
        ({'id': '1'}, 'id: got '),
    ],
)
def test_documents_of_another_form_are_refused_with_a_sentence(change, message):
    [(event, phase)] = VerdictEvents('/', Settings()).add(sample(0.0, 2.0))
    document = event.to_document(phase)
    assert Event.from_document(document) == (event, 'began')
    assert Event.from_document({**document, 'later': 1}) == (event, 'began')
    with pytest.raises(OccError, match=message):
        Event.from_document({**document, **change})
