# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Why the robot stopped: a gate's states with the events that caused them."""

from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.stops import LOST_NS, GateSample, StopEvents

SECOND = 10**9
NOW = 1_796_000_000 * SECOND


def gate(state, seconds, *, since=None, **more):
    time = round(seconds * SECOND)
    told = NOW + round((seconds if since is None else since) * SECOND)
    return GateSample(state, more.pop('reason', ''), told, NOW + time, time, **more)


def violation(rule, seconds, *, ended=None, margin=-0.08):
    began = NOW + round(seconds * SECOND)
    return Event(
        id=new_id(began),
        kind='violation',
        robot='/',
        text='clearance below 0.35 m and speed above 0.6 m/s',
        began=began,
        worst=began,
        ended=None if ended is None else NOW + round(ended * SECOND),
        rule=rule,
        margin=margin,
    )


def test_a_stop_names_its_cause_its_duration_and_what_released_it():
    stops, cause = StopEvents('/'), violation('R1', 1.0)
    others = [violation('R2', 1.1), violation('R1', -60.0, ended=-50.0)]
    assert stops.add(gate('PASS', 0.0), []) == []
    [(began, phase)] = stops.add(
        gate('STOP', 1.05, since=1.0, reason='VIOLATED: near', rules=('R1',)),
        [others[1], cause, others[0]],
    )
    assert (phase, began.cause, began.rule, began.ended) == ('began', cause.id, 'R1', None)
    assert began.began == NOW + SECOND
    # It follows its cause as that gets worse.
    worse = Event(**{**vars(cause), 'margin': -0.2})
    [(event, phase)] = stops.add(gate('STOP', 2.0, since=1.0, rules=('R1',)), [worse])
    assert (phase, event.margin) == ('update', -0.2)
    [(event, phase)] = stops.add(gate('PASS', 13.45, since=13.4, safe_in_a_row=5), [worse])
    assert (phase, event.id, event.seconds) == ('ended', began.id, 12.4)
    assert event.text.endswith(
        ' for 12.4 s: clearance below 0.35 m and speed above 0.6 m/s (rule R1, margin -0.2), '
        'released after 5 safe verdicts'
    )
    assert stops.add(gate('PASS', 14.0), []) == []


def test_a_cause_that_is_heard_of_a_moment_later_is_found():
    stops, cause = StopEvents('/'), violation('R1', 0.9)
    stops.add(gate('PASS', 0.0), [])
    [(event, _)] = stops.add(gate('STOP', 1.0, reason='VIOLATED: near', rules=('R1',)), [])
    assert event.cause is None
    assert event.text.endswith(': VIOLATED: near')
    [(event, _)] = stops.add(gate('PASS', 2.0), [cause])
    assert event.cause == cause.id


def test_a_gate_that_was_stopped_before_the_start_is_believed():
    [(event, _)] = StopEvents('/').add(gate('STOP', 100.0, since=40.0, reason='no verdict'), [])
    assert event.began == NOW + 40 * SECOND


def test_a_time_of_another_clock_is_not_believed():
    stops = StopEvents('/')
    stops.add(gate('PASS', 0.0), [])
    [(event, _)] = stops.add(gate('STOP', 1.0, since=-3600.0), [])
    assert event.began == NOW + SECOND


def test_a_gate_that_dies_is_a_stop_until_it_is_heard_again():
    stops = StopEvents('/')
    assert stops.tick(NOW, 0, []) == []
    stops.add(gate('PASS', 0.0), [])
    assert stops.tick(NOW + LOST_NS, LOST_NS, []) == []
    [(event, phase)] = stops.tick(NOW + LOST_NS + 1, LOST_NS + 1, [])
    assert (phase, event.began) == ('began', NOW)
    assert 'the gate is silent' in event.text
    assert stops.tick(NOW + 2 * LOST_NS, 2 * LOST_NS, []) == []
    [(event, phase)] = stops.add(gate('PASS', 10.0), [])
    assert (phase, event.seconds) == ('ended', 10.0)


def test_further_reasons_are_told_once_each():
    stops = StopEvents('/')
    stops.add(gate('STOP', 0.0, reason='VIOLATED: x at 0.3'), [])
    assert stops.add(gate('STOP', 1.0, reason='VIOLATED: x at 0.4'), []) == []
    [(event, _)] = stops.add(gate('STOP', 2.0, reason='no verdict for 1 s'), [])
    assert event.reason == 'VIOLATED: x at 0.3; then: no verdict for 1 s'
    [(event, phase)] = stops.close(3 * SECOND, 'the recorder was ended')
    assert phase == 'ended'
    assert 'released' not in event.text
    assert event.reason.endswith('; then: the recorder was ended')
