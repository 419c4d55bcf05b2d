# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of the screen: what they say, and that every line fits."""

import math

import numpy as np
import pytest
from occ_constraints_pkg.fleet.model import GateReport, MonitorReport
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.listing import rules_in_force_text
from occ_constraints_pkg.watch.panels import (
    change_lines,
    cut,
    detail_lines,
    robot_lines,
    rule_lines,
)


def text(lines):
    return [''.join(part for part, _ in line) for line in lines]


@pytest.fixture
def known(fleet, robot, report, rule_set):
    """Return a robot with a verdict, features and a gate."""
    robot.hear(report(0.1), 100.0)
    robot.hear_features(np.array([[0.9, 1.0]]), rule_set.fingerprint, 100.0)
    gate = GateReport('STOP', 0.0, 'VIOLATED: FAST', topics=(robot.topic,))
    fleet.hear_gate('/robot1/gate', gate, 100.0)
    fleet.tick(100.0)
    return robot


def test_a_robot_has_its_verdict_in_words(fleet, known, report):
    fleet.robot('/robot2/violation', 100.0)
    lines = text(robot_lines(fleet, known.topic, 100, 9, 100.0))
    assert lines[0].startswith('> /robot1 SAFE       0.100 ')
    assert 'gate STOP' in lines[0]
    assert '█' in lines[0]
    assert lines[1].startswith('  /robot2 UNKNOWN')
    late = text(robot_lines(fleet, known.topic, 100, 9, 200.0))
    assert all(' LOST ' in line and 'SAFE' not in line for line in late)
    known.hear(report(-0.2, 'FAST'), 200.0)
    lines = text(robot_lines(fleet, known.topic, 100, 9, 200.0))
    assert '/robot1 VIOLATED  -0.200' in lines[0]
    assert 'x ' in lines[0]
    assert lines[0].rstrip().endswith('FAST: FAST is true')


def test_of_many_robots_the_chosen_one_is_shown_and_the_others_are_counted(fleet, known, report):
    for number in range(10, 30):
        fleet.robot(f'/robot{number}/violation', 100.0)
    fleet.robots['/robot10/violation'].hear(report(-1.0, 'FAST'), 100.0)
    lines = text(robot_lines(fleet, '/robot25/violation', 80, 6, 100.0))
    assert len(lines) == 6
    assert any(line.startswith('> /robot25') for line in lines)
    assert lines[-1] == '  16 more: 14 UNKNOWN 1 VIOLATED 1 SAFE'
    assert text(robot_lines(fleet, '', 80, 6, 100.0))[0].startswith('  /robot1 ')
    assert len(robot_lines(fleet, '', 80, 21, 100.0)) == 21


def test_what_is_odd_is_said(fleet, known, report):
    known.publishers = 2
    known.hear(report(0.1, judged_at_ns=10**18), 100.0, 2 * 10**18)
    (line,) = text(robot_lines(fleet, known.topic, 160, 9, 100.0))
    assert line.endswith('2 publishers of verdicts; played back, not live')
    known.problem = 'topic rules: what is wrong'
    assert 'topic rules: what is wrong' in text(detail_lines(known, fleet, 100, 100.0))


def test_rules_are_listed_with_values_and_bounds(known):
    lines = text(rule_lines(known, 'NEAR', 100, 10, 100.0))
    assert lines[1].startswith('  FAST   0.100  speed 0.9')
    assert 'speed above 1 m/s' in lines[1]
    assert lines[2].startswith('> NEAR')
    assert '  OFF      off' in lines[3]


def test_of_many_rules_those_are_shown_that_matter_and_the_chosen_one(fleet, report):
    space = FeatureSpace((Feature('x'),))
    rules = tuple(Rule(f'R{n:03}', (Literal(0, '>', 1.0 + n),)) for n in range(200))
    rule_set = RuleSet(space, rules, [[0.0, 1.0]])
    robot = fleet.robot('/violation', 100.0)
    robot.hear_rules(rules_in_force_text(rule_set), 100.0)
    robot.hear(report(1.0), 100.0)
    robot.hear_features(np.array([[0.0]]), '', 100.0)
    lines = text(rule_lines(robot, '', 80, 10, 100.0))
    assert len(lines) == 10
    assert '(191 more)' in lines[0]
    assert lines[1].startswith('  R000')
    assert any(line.startswith('> R150') for line in text(rule_lines(robot, 'R150', 80, 10, 100.0)))
    assert text(rule_lines(robot, 'gone', 80, 10, 100.0)) == lines


@pytest.mark.parametrize('width', [1, 5, 20, 40, 60, 80, 90, 120, 300])
@pytest.mark.parametrize('height', [0, 1, 2, 30])
def test_every_line_fits(fleet, known, report, width, height):
    known.hear(report(-0.2, 'FAST', 'NEAR'), 100.1)
    known.hear(report(reason='word ' * 50), 100.2)
    fleet.note(100.0, 'x' * 50, 'failed', 'y' * 500)
    fleet.tick(100.2)
    panels = (
        robot_lines(fleet, known.topic, width, height, 100.2),
        detail_lines(known, fleet, width, 100.2),
        rule_lines(known, 'FAST', width, height, 100.2),
        change_lines(fleet, width, height, 100.2),
    )
    assert all(len(line) <= width for panel in panels for line in text(panel))
    assert len(panels[0]) <= height
    assert len(panels[3]) <= height


def test_text_of_others_cannot_control_the_terminal(fleet, known):
    known.hear_monitor(MonitorReport('\x1b[2Jgone'), 300.0)
    fleet.note(100.0, '/evil\x1b[2J', 'failed', '\x1b]0;x\x07')
    lines = text(change_lines(fleet, 200, 20, 100.0))
    assert not any('\x1b' in line or '\x07' in line for line in lines)


def test_a_line_is_cut_or_filled():
    line = [('abc', 'bold'), ('def', '')]
    assert cut(line, 5) == [('abc', 'bold'), ('d…', '')]
    assert cut(line, 8, fill=True) == [*line, ('  ', '')]
    assert cut(line, 0) == []


def test_margins_of_any_size_are_drawn(fleet, known, report):
    for number, margin in enumerate((math.inf, 1e300, 1e-300, 0.0, -math.inf, math.nan)):
        known.hear(report(margin), 100.0 + number)
    (line,) = text(robot_lines(fleet, '', 100, 9, 105.0))
    assert '█' in line
