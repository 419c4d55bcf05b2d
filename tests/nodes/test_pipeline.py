# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Every input is answered by the verdict of its rows, or by UNKNOWN and the reason."""

from types import SimpleNamespace

import numpy as np
import pytest
from occ_constraints_pkg.errors import InputError
from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.gating import SteadyVerdict
from occ_constraints_pkg.rules.persistent_counts import PersistentCounts

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.monitor import pipeline as module
from occ_constraints_pkg.nodes.monitor.inputs import TimeLimits

SPACE = FeatureSpace((Feature('x', '1', 0.0, 10.0),))
RULES = RuleSet(SPACE, (Rule('HIGH', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]]))
SAFE, HIGH, OUT = 0.5, 2.0, -1.0


class Inputs:
    """Stands in for live topics: a message is its row, or the reason why it gives none."""

    def __init__(self, _node, _feature_map, _limits, callback):
        self.callback, self.silence, self.clock = callback, '', ''
        self.refreshed, self.last = 0, None

    def rows(self, _topic, message, stamp_ns):
        if isinstance(message, str):
            raise InputError(message)
        if message is None:
            return None
        repeat, self.last = (message, stamp_ns) == self.last, (message, stamp_ns)
        return FeatureRows(stamp_ns, np.array([[message]]), None, repeat)

    def stamp_ns(self, _message):
        return 99

    def refresh(self):
        self.refreshed += 1

    def check_timeout(self):
        return self.silence

    def check_clock(self):
        return self.clock

    def close(self):
        pass


class Outputs:
    """Keeps what is published."""

    wants_forecast = wants_markers = False

    def __init__(self):
        self.costs, self.told = [], []

    def publish_costs(self, answer):
        self.costs.append((answer.rows.stamp_ns, float(answer.judgement.cost[0])))

    def publish_verdict(self, answer, state, _foreseen):
        self.told.append((answer.rows.stamp_ns, answer.verdict.name, state.name))

    def publish_unknown(self, reason, _rule_set, stamp_ns):
        self.told.append((stamp_ns, 'UNKNOWN', reason))


@pytest.fixture
def monitor(monkeypatch):
    """Return an active pipeline with its inputs, outputs and rules."""
    monkeypatch.setattr(module, 'Inputs', Inputs)
    logger = SimpleNamespace(error=lambda *_, **__: None)
    node = SimpleNamespace(get_logger=lambda: logger)
    rules, outputs = SimpleNamespace(rule_set=RULES, counts=PersistentCounts(RULES, '')), Outputs()
    pipeline = module.Pipeline(node, rules, outputs)
    pipeline.subscribe(None, TimeLimits(1.0, 1.0, 1.0))
    pipeline.activate()
    inputs = pipeline._inputs
    return SimpleNamespace(pipeline=pipeline, inputs=inputs, outputs=outputs, rules=rules)


def send(monitor, message, stamp_ns):
    """Send a message; return what was published of it: on costs, and for people."""
    monitor.outputs.costs.clear()
    monitor.outputs.told.clear()
    monitor.inputs.callback('x', message, stamp_ns)
    return monitor.outputs.costs[:], monitor.outputs.told[:]


def test_each_row_is_judged_and_counted_once(monitor):
    assert send(monitor, None, 1) == ([], [])
    assert send(monitor, SAFE, 1) == ([(1, 0.0)], [(1, 'SAFE', 'SAFE')])
    assert send(monitor, HIGH, 2) == ([(2, 1.0)], [(2, 'VIOLATED', 'VIOLATED')])
    assert send(monitor, OUT, 3) == ([(3, 1.0)], [(3, 'UNKNOWN', 'UNKNOWN')])
    assert monitor.pipeline.state is Verdict.UNKNOWN
    assert monitor.rules.counts.evaluated.tolist() == [2]
    assert monitor.rules.counts.violated.tolist() == [1]


def test_a_repeat_has_the_same_answer_and_ends_no_silence(monitor):
    first = send(monitor, SAFE, 1)
    refreshed = monitor.inputs.refreshed
    assert send(monitor, SAFE, 1) == first
    monitor.inputs.silence = 'no new input for 1 s'
    monitor.pipeline.check_timeout()
    assert monitor.outputs.told[-1] == (1, 'UNKNOWN', 'no new input for 1 s')
    assert monitor.pipeline.state is Verdict.UNKNOWN
    # Whoever waits in lock-step is answered; people are not told SAFE.
    assert send(monitor, SAFE, 1) == (first[0], [])
    assert monitor.inputs.refreshed == refreshed
    monitor.pipeline.republish_timeout()
    assert monitor.outputs.told == [(1, 'UNKNOWN', 'no new input for 1 s')]
    assert send(monitor, SAFE, 2)[1] == [(2, 'SAFE', 'SAFE')]
    assert monitor.rules.counts.evaluated.tolist() == [2]


def test_input_that_cannot_be_used_is_unknown_and_so_is_its_repeat(monitor):
    send(monitor, SAFE, 1)
    assert send(monitor, 'the table is broken', 2) == ([], [(99, 'UNKNOWN', 'the table is broken')])
    assert monitor.pipeline.problem == 'the table is broken'
    # The answer to the row before is gone, so that is judged anew.
    assert send(monitor, SAFE, 1)[1] == [(1, 'SAFE', 'SAFE')]


@pytest.mark.parametrize('why', ['disabled', 'clock', 'rules'])
def test_what_cannot_be_judged_is_unknown(monitor, why):
    send(monitor, SAFE, 1)
    if why == 'disabled':
        monitor.pipeline.enable(False)
        reason = 'the monitor is disabled'
        assert monitor.outputs.told[-1] == (1, 'UNKNOWN', reason)
    elif why == 'clock':
        monitor.inputs.clock = reason = '/clock has stood still for 1 s'
    else:
        off = RuleSet(SPACE, (), np.array([[0.0, 1.0]]))
        monitor.rules.rule_set, reason = off, off.problem
    assert send(monitor, SAFE, 2) == ([], [(2, 'UNKNOWN', reason)])
    assert send(monitor, SAFE, 2) == ([], [(2, 'UNKNOWN', reason)])


def test_nothing_is_published_while_inactive(monitor):
    monitor.pipeline.deactivate()
    assert monitor.outputs.told == [(0, 'UNKNOWN', 'the monitor is not active')]
    for message in (SAFE, 'broken', None):
        assert send(monitor, message, 1) == ([], [])
    monitor.pipeline.check_timeout()
    assert monitor.outputs.told == []


def test_people_are_shown_the_debounced_verdict(monitor):
    monitor.pipeline.configure(SteadyVerdict(2, 3, 2), module.EarlyWarning(), is_enabled=True)
    values = [SAFE, SAFE, HIGH, SAFE, HIGH, SAFE, SAFE]
    shown = [send(monitor, value, stamp)[1][0][2] for stamp, value in enumerate(values)]
    assert shown == ['UNKNOWN', 'SAFE', 'SAFE', 'SAFE', 'VIOLATED', 'VIOLATED', 'SAFE']
