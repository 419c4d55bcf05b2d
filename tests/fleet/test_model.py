# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What is known of robots: standing, events and margins; silence is never safe."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.fleet.model import (
    LOST_SECONDS,
    Fleet,
    GateReport,
    MonitorReport,
    Report,
    Robot,
    Standing,
    ViolatedRule,
    robot_name,
)
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.listing import rules_in_force_text


def told(fleet, now):
    fleet.tick(now)
    return [(change.kind, change.text) for change in fleet.fresh_changes()]


def test_a_violation_begins_and_ends_with_its_worst_values(fleet, robot, report):
    robot.hear(report(0.5), 100.0)
    assert [kind for kind, _ in told(fleet, 100.1)] == ['note', 'rules', 'SAFE']
    robot.hear(report(-0.1, 'FAST'), 100.2)
    assert told(fleet, 100.3) == [('VIOLATED', 'FAST: FAST is true (speed 1.5), margin -0.1')]
    robot.hear(report(-0.4, 'FAST'), 100.4)
    robot.hear(report(-0.2, 'FAST'), 101.2)
    robot.hear(report(0.1), 101.3)
    # It may only flicker: it is shown as violated until it has been over for a while.
    assert robot.standing(101.3) is Standing.VIOLATED
    assert told(fleet, 101.4) == []
    robot.hear(report(0.2), 101.8)
    assert told(fleet, 101.8) == [
        ('ended', 'after 1.00 s: FAST: FAST is true; worst margin -0.4 (speed 1.5)'),
        ('SAFE', 'margin 0.2'),
    ]


def test_a_violation_of_one_input_between_two_looks_is_told(fleet, robot, report):
    told(fleet, 100.0)
    for number in range(50):
        rules = ['FAST'] if number == 20 else []
        robot.hear(report(-0.1 if rules else 0.5, *rules), 101.0 + 0.02 * number)
    told_now = told(fleet, 102.1)
    assert [kind for kind, _ in told_now] == ['VIOLATED', 'ended', 'SAFE']
    assert -0.1 in robot.margins(8, 102.1)


def test_a_rule_that_flickers_is_one_violation(fleet, robot, report):
    told(fleet, 100.0)
    for number in range(100):
        rules = ['FAST'] if number % 2 else []
        robot.hear(report(-0.1 if rules else 0.1, *rules), 100.0 + 0.02 * number)
        fleet.tick(100.0 + 0.02 * number)
    assert [kind for kind, _ in told(fleet, 102.0)] == ['SAFE', 'VIOLATED']


def test_two_rules_are_two_violations(fleet, robot, report):
    told(fleet, 100.0)
    robot.hear(report(-0.1, 'FAST'), 101.0)
    robot.hear(report(-0.1, 'FAST', 'NEAR'), 101.1)
    robot.hear(report(-0.1, 'NEAR'), 101.9)
    assert [text.partition(':')[0] for kind, text in told(fleet, 102.0) if kind != 'ended'] == [
        'FAST',
        'NEAR',
    ]
    assert robot.why(102.0) == 'NEAR: NEAR is true'


def test_a_rule_of_each_robot_of_a_batch_is_a_violation(fleet, robot):
    told(fleet, 100.0)
    rules = tuple(ViolatedRule('FAST', 'too fast', -0.1, '', number) for number in (0, 3))
    robot.hear(Report(Verdict.VIOLATED, -0.1, rules=rules), 101.0)
    assert [text for _, text in told(fleet, 101.0)] == [
        'FAST: too fast, margin -0.1',
        'FAST: too fast (robot 3), margin -0.1',
    ]


def test_unknown_is_told_with_its_reason_and_other_numbers_are_no_news(fleet, robot, report):
    robot.hear(report(0.5), 100.0)
    told(fleet, 100.0)
    for number in range(3):
        robot.hear(report(reason=f'no new input for {number + 1}.5 s'), 101.0 + number)
        fleet.tick(101.0 + number)
    assert told(fleet, 103.0) == [('UNKNOWN', 'no new input for 1.5 s')]
    assert robot.why(103.0) == 'no new input for 3.5 s'
    robot.hear(report(reason='x is not a number'), 103.1)
    assert told(fleet, 103.2) == [('UNKNOWN', 'x is not a number')]


def test_a_robot_that_falls_silent_is_lost_and_may_come_again(fleet, robot, report):
    robot.hear(report(-0.1, 'FAST'), 100.0)
    told(fleet, 100.0)
    now = 100.0 + LOST_SECONDS + 0.1
    assert robot.standing(now) is Standing.LOST
    kinds = told(fleet, now)
    assert [kind for kind, _ in kinds] == ['ended', 'LOST']
    assert kinds[0][1].endswith('nothing was heard since')
    assert told(fleet, now + 50.0) == []
    robot.hear(report(0.3), now + 60.0)
    assert told(fleet, now + 60.0) == [('SAFE', 'margin 0.3')]


def test_a_monitor_that_is_heard_on_diagnostics_only_is_unknown_for_its_reason(fleet):
    robot = fleet.robot('/violation', 0.0)
    assert robot.standing(0.5) is Standing.UNKNOWN
    robot.hear_monitor(MonitorReport('no rule set yet'), 1.0)
    told(fleet, 1.1)
    assert (robot.standing(2.9), robot.why(2.9)) == (Standing.UNKNOWN, 'no rule set yet')
    assert robot.standing(3.5) is Standing.LOST
    assert robot.why(3.5) == 'no verdict has come yet'


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 3.0),
            st.sampled_from(['safe', 'FAST', 'NEAR', 'unknown', 'tick', 'idle']),
        )
    )
)
def test_safe_is_shown_only_on_a_fresh_safe_verdict(steps):
    """Whatever comes in whatever order: SAFE needs a SAFE verdict younger than the limit."""
    robot, now, last = Robot('/violation', 0.0), 0.0, (-math.inf, '')
    for seconds, what in steps:
        now += seconds
        if what == 'tick':
            robot.tick(now)
        elif what == 'idle':
            robot.hear_monitor(MonitorReport(), now)
        else:
            last = now, what
            rules = () if what in ('safe', 'unknown') else (ViolatedRule(what, 'w', -1.0),)
            verdict = {'safe': Verdict.SAFE, 'unknown': Verdict.UNKNOWN}.get(what, Verdict.VIOLATED)
            robot.hear(Report(verdict, 0.0, reason='r', rules=rules), now)
        if robot.standing(now) is Standing.SAFE:
            assert last[1] == 'safe'
            assert now - last[0] <= LOST_SECONDS
        begun = [change for change in robot.changes if change.kind == 'VIOLATED']
        ended = [change for change in robot.changes if change.kind == 'ended']
        assert 0 <= len(begun) - len(ended) <= 2


def test_margins_keep_the_smallest_of_each_span(robot, report):
    robot.hear(report(0.5), 100.1)
    robot.hear(report(0.2), 100.2)
    robot.hear(report(0.9), 100.4)
    robot.hear(report(reason='why'), 101.1)
    robot.hear(report(0.9), 101.2)
    assert robot.margins(4, 101.6) == [0.2, None, -math.inf, None]


def test_rules_are_listed_by_closeness_as_the_monitor_judges(robot, report, rule_set):
    order, margins = robot.closeness(100.0)
    assert np.isnan(margins).all()
    robot.hear(report(0.1), 100.0)
    robot.hear_features(np.array([[0.9, 1.0]]), rule_set.fingerprint, 100.0)
    order, margins = robot.closeness(100.0)
    np.testing.assert_array_equal(margins, rule_set.rule_margins(np.array([0.9, 1.0])))
    robot.hear_counts(np.array([[0, 0], [9, 2], [7, 1]]))
    rows = [robot.rule_row(index, margins, 100.0) for index in order]
    assert [(row.id, row.enabled, row.values, row.counted) for row in rows] == [
        ('FAST', True, 'speed 0.9', (2, 9)),
        ('NEAR', True, 'clearance 1', (1, 7)),
        ('OFF', False, 'speed 0.9, clearance 1', (0, 0)),
    ]
    # Old values say nothing of now.
    assert np.isnan(robot.closeness(110.0)[1]).all()


@pytest.mark.parametrize(
    ('rows', 'is_known'),
    [([[0.9, 1.0]], False), ([[0.9, 1.0, 2.0]], True), (np.zeros((0, 2)), True)],
)
def test_features_of_other_rules_are_left_out(robot, report, rule_set, rows, is_known):
    robot.hear(report(0.1), 100.0)
    robot.hear_features(np.array(rows), rule_set.fingerprint if is_known else 'another', 100.0)
    assert robot.sample is None


def test_values_that_are_not_finite_can_be_listed(robot, report, rule_set):
    robot.hear(report(reason='speed is missing'), 100.0)
    robot.hear_features(np.array([[np.nan, 1.0]]), rule_set.fingerprint, 100.0)
    order, margins = robot.closeness(100.0)
    assert [robot.rule_row(index, margins, 100.0).values for index in order]


def test_rules_that_cannot_be_read_are_said_and_those_before_stay(fleet, robot, rule_set):
    robot.hear_rules('{', 101.0)
    assert 'topic rules' in robot.problem
    assert robot.rule_set.rules == rule_set.rules
    told(fleet, 101.0)
    robot.hear_rules(rules_in_force_text(rule_set), 102.0)
    assert robot.problem == ''
    assert told(fleet, 102.0) == []


def test_a_verdict_made_long_before_it_was_sent_is_a_recording(robot, report):
    robot.hear(report(0.1, judged_at_ns=10**18), 100.0, 10**18 + 10**6)
    assert not robot.is_recorded
    robot.hear(report(0.1, judged_at_ns=10**18), 100.0, 10**18 + 10**11)
    assert robot.is_recorded


def test_a_gate_is_told_when_it_stops_or_opens_and_when_it_is_lost(fleet, robot):
    def hear(state, when, reason=''):
        report = GateReport(state, 0.5, reason, topics=('/robot1/violation',))
        fleet.hear_gate('/robot1/gate', report, when)
        return [text for kind, text in told(fleet, when) if kind == 'gate']

    assert hear('STOP', 100.0, 'no verdict yet') == ['STOP: no verdict yet']
    assert hear('PASS', 101.0) == ['PASS']
    assert hear('SLOW', 101.1, 'margin 0.05') == []
    assert hear('STOP', 102.0, 'VIOLATED: x') == ['STOP: VIOLATED: x']
    assert hear('STOP', 103.0, 'VIOLATED: x') == []
    assert [gate.words for gate in fleet.gates_of(robot)] == ['STOP']
    assert told(fleet, 106.0)[-1] == ('gate', 'LOST: silent for 2 s')
    assert fleet.gates['/robot1/gate'].words == 'LOST'
    assert hear('STOP', 107.0, 'VIOLATED: x') == ['STOP: VIOLATED: x']


def test_what_is_lost_can_be_dropped(fleet, robot, report):
    fleet.robot('/robot2/violation', 100.0)
    robot.hear(report(0.1), 110.0)
    assert fleet.forget_lost(110.0) == ['/robot2/violation']
    assert list(fleet.robots) == ['/robot1/violation']


def test_a_robot_is_called_by_its_namespace():
    assert [robot_name(topic) for topic in ('/violation', '/a/b/violation', '/alarms')] == [
        '/',
        '/a/b',
        '/alarms',
    ]
    assert list(Fleet().robots) == []
