# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The monitor's log tells every change of state while there are few, and sums up many."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.monitor.state_log import StateLog

RULES = RuleSet(
    FeatureSpace((Feature('v2', 'm/s'), Feature('gap', 'm', 0.0))),
    (
        Rule('FAST', (Literal(0, '>', 1.0),)),
        Rule('BOTH', (Literal(0, '>', 0.5), Literal(1, '<', 1))),
    ),
    np.array([[0.0, 1.0], [0.0, 2.0]]),
)
SAFE, BOTH, FAST, OUT = [0.4, 1.5], [0.7, 0.5], [1.5, 0.5], [0.4, -1.0]


class Node:
    """A node with a clock by hand that keeps what is logged."""

    def __init__(self):
        self.seconds, self.lines, self.timers = 0.0, [], []

    def steady_seconds(self):
        return self.seconds

    def steady_timer(self, _seconds, callback):
        self.timers.append(callback)

    def get_logger(self):
        return SimpleNamespace(
            info=lambda words: self.lines.append(('info', words)),
            warning=lambda words: self.lines.append(('warning', words)),
        )

    def go_on(self, seconds):
        for _ in range(round(seconds * 10)):
            self.seconds += 0.1
            for callback in self.timers:
                callback()


def judge(log, *rows, state=None, note=''):
    rows = np.array(rows)
    judgement = RULES.judge(rows)
    state = Verdict(judgement.verdict[0]) if state is None else state
    log.log_judgement(RULES, SimpleNamespace(values=rows, note=note), judgement, state)


def test_each_change_is_told_with_what_it_is_about():
    node = Node()
    log = StateLog(node)
    for row in (SAFE, SAFE, BOTH, BOTH, FAST, OUT, OUT, SAFE):
        node.go_on(5.0)
        judge(log, row)
    assert node.lines == [
        ('info', 'SAFE, margin 0.25'),
        ('warning', 'VIOLATED: BOTH: v2 above 0.5 m/s and gap below 1 m (v2 = 0.7, gap = 0.5)'),
        (
            'warning',
            'VIOLATED: FAST: v2 above 1 m/s (v2 = 1.5), and 1 other rule',
        ),
        ('warning', 'UNKNOWN: gap = -1 is outside its physical bounds [0, inf]'),
        ('info', 'SAFE, margin 0.25'),
    ]


def test_a_reason_with_other_numbers_or_a_steady_state_is_no_change():
    node = Node()
    log = StateLog(node)
    for ahead in (3.25, 4.5, 1e9, -2):
        log.log_unknown(f'the stamp on d_l2 is {ahead} s ahead')
    log.log_unknown('the stamp on d_l3 is 4 s ahead')
    assert len(node.lines) == 2
    judge(log, FAST)
    judge(log, SAFE, state=Verdict.VIOLATED)
    assert len(node.lines) == 3
    judge(log, SAFE, note='unused')
    assert node.lines[3][0] == 'info'


def test_of_several_robots_the_worst_is_named():
    node = Node()
    judge(StateLog(node), SAFE, FAST, SAFE)
    assert node.lines[0][1].endswith('(robot 1 of 3)')


@given(st.lists(st.sampled_from([SAFE, BOTH, FAST, OUT]), max_size=300))
def test_flicker_does_not_flood_and_the_end_is_always_told(rows):
    node = Node()
    log = StateLog(node)
    for row in rows:
        node.go_on(0.1)
        judge(log, row)
    assert len(node.lines) <= 5 + node.seconds / 5.0
    node.go_on(6.0)
    if rows:
        words = {0: 'SAFE', 1: 'VIOLATED', 2: 'UNKNOWN'}[int(RULES.judge(rows[-1:]).verdict[0])]
        assert node.lines[-1][1].startswith(words)
    told = len(node.lines)
    node.go_on(20.0)
    assert len(node.lines) == told


def test_a_violation_that_is_over_by_the_time_of_the_line_is_told():
    node = Node()
    log = StateLog(node)
    for row in [SAFE, FAST] * 3 + [SAFE]:
        judge(log, row)
    node.go_on(6.0)
    assert len(node.lines) == 6
    level, words = node.lines[-1]
    assert level == 'warning'
    assert words.startswith('SAFE, margin 0.25 (2 changes since the last line; before: VIOLATED')
