# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the page is told: whole messages, and never SAFE without a verdict that says so."""

import json
import math

import numpy as np
import pytest
from fleets import RULE_SET
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.dashboard.access import access_of, is_loopback, new_token, read_token
from occ_constraints_pkg.dashboard.documents import PAST_SECONDS, REPEAT_SECONDS, Documents
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.fleet.events import MOST_EVENTS, EventLog, read_event
from occ_constraints_pkg.fleet.health import Health
from occ_constraints_pkg.fleet.model import LOST_SECONDS, Fleet, GateReport, MonitorReport, Report
from occ_constraints_pkg.rules import Verdict


def told(documents, now, **options):
    return {key: json.loads(data) for key, data in documents.messages(now, **options).items()}


def test_each_kind_is_told_to_who_is_new_and_then_when_it_is_due(fleet, robot, report):
    documents = Documents(fleet)
    robot.hear(report(0.5), 100.0)
    fleet.tick(100.0)
    assert set(told(documents, 100.1)) == {'now', 'past', 'rules', 'log'}
    assert set(told(documents, 100.3)) == {'now'}
    assert set(told(documents, 100.5, anew=True)) == {'now', 'past', 'rules', 'log'}
    assert 'past' in told(documents, 100.5 + PAST_SECONDS)
    fleet.note(103.0, '/x', 'note', 'something')
    assert set(told(documents, 103.0)) == {'now', 'log'}
    assert set(told(documents, 103.1 + REPEAT_SECONDS)) == {'now', 'past', 'rules', 'log'}


def test_a_robot_is_told_with_rules_margins_gate_and_health(fleet, robot, report):
    robot.hear(report(0.25, judged_at_ns=2_050_000_000, stamp_ns=2_000_000_000), 100.0)
    robot.hear_features(np.array([[0.75, 2.0]]), RULE_SET.fingerprint, 100.0)
    robot.hear_counts(np.array([[9.0, 0.0], [9.0, 4.0], [5.0, 0.0]]))
    robot.hear_monitor(MonitorReport(doubts='scan may be upside down'), 100.0)
    fleet.hear_gate('/robot1/gate', GateReport('SLOW', 0.5, topics=(robot.topic,)), 100.0)
    messages = told(Documents(fleet), 100.2)
    (one,) = messages['now']['robots']
    assert (one['standing'], one['margin'], one['why']) == ('SAFE', 0.25, '')
    words = messages['rules']['sets'][one['rule_set']]
    index, margin, values, violated, evaluated = one['rules'][0]
    assert words[index][0] == 'FAST'
    assert (margin, values, violated, evaluated) == (0.25, 'speed 0.75', 4, 9)
    assert [words[row[0]][2] for row in one['rules']] == [True, True, False]
    assert one['gates'][0]['state'] == 'SLOW'
    assert one['health']['delay'] == 0.05
    assert one['health']['doubts'] == 'scan may be upside down'
    assert one['recent'][-1] == 0.25
    assert messages['past']['margins'][robot.topic][-1] == 0.25


def test_unknown_has_no_margin_and_a_mark_of_its_own(fleet, robot, report):
    robot.hear(report(reason='no input'), 100.0)
    messages = told(Documents(fleet), 100.1)
    (one,) = messages['now']['robots']
    assert (one['standing'], one['margin'], one['why']) == ('UNKNOWN', None, 'no input')
    assert one['recent'][-2:] == [None, '?'] or one['recent'][-1] == '?'


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 5.0),
            st.sampled_from(list(Verdict)),
            st.floats(allow_nan=True, allow_infinity=True),
        ),
        max_size=12,
    ),
    st.floats(0.0, 5.0),
)
def test_safe_is_told_only_on_a_verdict_of_late_that_says_so(verdicts, silence):
    fleet, now = Fleet(), 100.0
    robot = fleet.robot('/a/violation', now)
    documents, last = Documents(fleet), None
    for pause, verdict, margin in verdicts:
        now += pause
        robot.hear(Report(verdict, margin), now)
        last = now, verdict
        fleet.tick(now)
    now += silence
    fleet.tick(now)
    (one,) = told(documents, now, anew=True)['now']['robots']
    is_safe = last is not None and last[1] is Verdict.SAFE and now - last[0] <= LOST_SECONDS
    assert one['standing'] != 'SAFE' or is_safe
    assert one['standing'] in ('SAFE', 'VIOLATED') or one['margin'] is None
    if last is None or now - last[0] > LOST_SECONDS:
        assert one['standing'] == 'LOST' or last is None


@settings(max_examples=30)
@given(st.text(max_size=20), st.floats(allow_nan=True))
def test_whatever_is_said_becomes_json_of_bounded_length(text, number):
    fleet = Fleet()
    robot = fleet.robot(f'/{text}/violation', 1.0)
    robot.monitor = robot.problem = robot.health.doubts = text * 1000
    robot.hear(Report(Verdict.UNKNOWN, number, reason=text * 1000), 1.0)
    fleet.hear_gate(text, GateReport(text * 1000, number, text * 1000), 1.0)
    fleet.tick(1.0)
    for data in Documents(fleet).messages(1.0).values():
        json.loads(data)
        assert len(data) < 200_000


def test_events_are_kept_once_and_not_for_ever():
    log = EventLog()
    event = {'id': '1', 'kind': 'violation', 'phase': 'began', 'values': {'x': 1.25}}
    first = read_event(json.dumps(event), '/a/events')
    log.hear(first)
    log.hear(first)
    assert log.version == 1
    log.hear(read_event(json.dumps({**event, 'ended': 5}), '/a/events'))
    assert [item.ended_ns for item in log] == [5]
    for number in range(2 * MOST_EVENTS):
        log.hear(read_event(json.dumps({**event, 'id': str(number)}), '/b/events'))
    assert len(list(log)) == MOST_EVENTS
    version = log.version
    for _ in range(2):
        log.find(['/a/events', '/b/events'])
    assert (log.version - version, len(log.sources)) == (1, 2)


def test_an_event_is_read_as_the_recorder_tells_it():
    said = {
        **{'schema': 1, 'id': 'ab', 'phase': 'ended', 'kind': 'stop', 'robot': '/a', 'rule': None},
        **{'text': 'stopped', 'values': {'x': 1.23456, 'y': None}, 'bounds': [], 'margin': None},
        **{'began': 10, 'worst': 11, 'ended': 12, 'reason': 'r', 'bag': '/b', 'cause': None},
    }
    event = read_event(json.dumps(said), '/a/events')
    assert (event.kind, event.robot, event.rule, event.text) == ('stop', '/a', '', 'stopped')
    assert (event.began_ns, event.worst_ns, event.ended_ns) == (10, 11, 12)
    assert (event.values, event.bag) == ('x 1.235, y ', '/b')
    assert math.isnan(event.margin)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        max_leaves=8,
    ),
    st.sampled_from(['id', 'kind', 'values', 'began', 'margin', 'text', 'robot']),
)
def test_any_message_on_events_is_an_event_or_none(value, key):
    said = {'id': '1', 'kind': 'violation', key: value}
    event = read_event(json.dumps(said), '/events')
    assert event is None or (event.began_ns >= 0 and len(event.text) <= 401)
    assert read_event(json.dumps(value), '/events') is None or isinstance(value, dict)


def test_texts_that_are_no_events_are_passed_over():
    for text in ('', 'hello', '[' * 100_000, '{"id": 1}', '{"kind": "x"}', ' ' * 100_000):
        assert read_event(text, '/events') is None


def test_the_rate_is_of_the_last_seconds():
    health = Health()
    assert health.rate(10.0) == 0.0
    for step in range(200):
        health.hear(10.0 + step / 20.0, None, 0)
    assert health.rate(20.0) == pytest.approx(20.0)
    assert health.rate(22.5) == pytest.approx(10.0)
    assert health.rate(100.0) == 0.0
    assert math.isnan(health.delay)


@pytest.mark.parametrize('name', ['', 'http://x', 'a/b', 'a b', 'x@y', '*'])
def test_hosts_are_names(name):
    with pytest.raises(ConfigurationError, match='hosts: got'):
        access_of('127.0.0.1', [name], '')


def test_names_of_this_host():
    assert access_of('0.0.0.0', [], '').names == ['127.0.0.1', '::1', 'localhost']
    assert 'robot.local' in access_of('::', ['Robot.local'], '').names
    assert '10.0.0.5' in access_of('10.0.0.5', [], '').names
    assert all(map(is_loopback, ('127.0.0.53', '::1', 'LOCALHOST')))
    assert not any(map(is_loopback, ('0.0.0.0', 'robot.local')))


def test_tokens():
    assert len({new_token() for _ in range(100)}) == 100
    assert read_token(f'{"x" * 16}\n', 'file') == 'x' * 16
    for text in ('', 'short', 'x' * 15 + ' y', 'é' * 20):
        with pytest.raises(ConfigurationError, match='got a token of'):
            read_token(text, 'file')
