# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in words say what is violated, what may come, and nothing that a gate would misread."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.forecast import Forecast
from strategies import COARSE, rule_sets

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.monitor.pipeline import foreseen_values
from occ_constraints_pkg.ros.diagnostics import (
    hardware_id_of,
    read_verdict,
    report_message,
    sensor_status,
    unknown_message,
    violation_message,
)


@given(rule_sets(), st.data())
def test_every_violated_rule_is_explained_and_the_verdict_reads_back(rule_set, data):
    row = data.draw(
        st.lists(COARSE | st.just(math.nan), min_size=len(rule_set.space), max_size=None)
    )[: len(rule_set.space)]
    values = np.array([row])
    judgement = rule_set.judge(values)
    message = violation_message(rule_set, values, judgement, 7, {'state': 'SAFE'})
    first, *others = message.status
    told = {item.key: item.value for item in first.values}
    assert (told['rule_set'], told['state']) == (rule_set.fingerprint, 'SAFE')
    verdict, margin, words = read_verdict(message)
    assert verdict == judgement.verdict[0]
    np.testing.assert_equal(margin, judgement.margin[0])
    assert words == first.message
    if verdict is Verdict.VIOLATED:
        true = [rule_set.rules[place] for place in rule_set.violated_rules(values[0])]
        assert [item.name for item in others] == [f'monitor: rule {rule.id}' for rule in true]
        margins = rule_set.rule_margins(values[0])
        for place, status in zip(rule_set.violated_rules(values[0]), others, strict=True):
            rule, entries = rule_set.rules[place], {e.key: e.value for e in status.values}
            assert entries['text'] == rule.words(rule_set.space)
            assert entries['formula'] == rule.formula(rule_set.space)
            assert float(entries['margin']) == margins[place]
            for literal in rule.literals:
                # Of a family, those members that make the rule true.
                fired = [one for one in literal.members if literal.holds(np.array([row[one]]))[0]]
                assert fired
                for one in fired:
                    assert float(entries[rule_set.space.names[one]]) == row[one]
    else:
        assert others == []


@given(rule_sets())
def test_a_forecast_is_put_in_words_within_the_horizon_only(rule_set):
    assert foreseen_values(rule_set, Forecast(math.inf), 1.0) == {'time_to_violation': math.inf}
    if not len(rule_set.order):
        return
    place = int(rule_set.order[0])
    rule = rule_set.rules[place]
    for seconds, is_warned in ((0.5, True), (1.5, False), (0.0, False)):
        told = foreseen_values(rule_set, Forecast(seconds, place, rule.literals[0].members[0]), 1.0)
        assert (told['time_to_violation'], told['next_rule']) == (seconds, rule.id)
        assert ('warning' in told) == is_warned


def test_unknown_is_read_as_unknown():
    message = unknown_message('no input', None, 7)
    assert read_verdict(message)[0] is Verdict.UNKNOWN
    assert message.status[0].message == 'UNKNOWN: no input'


@pytest.mark.parametrize(('namespace', 'hardware'), [('/', 'robot'), ('/a/b', 'a/b')])
def test_diagnostics_tell_robots_and_dead_publishers_apart(namespace, hardware):
    robot = hardware_id_of(namespace)
    message = report_message('monitor: judging', Verdict.UNKNOWN, 'late', {}, 7, robot)
    (judging,) = message.status
    # An aggregator takes STALE for the level of a publisher that is dead.
    assert judging.level == b'\x02'
    assert judging.hardware_id == hardware
    assert sensor_status('monitor: sensors', [], robot).hardware_id == hardware
    told = report_message('monitor: judging', Verdict.SAFE, '', {}, 7, robot)
    assert told.status[0].level == b'\x00'
