# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What comes into force of a rule set, of edits to it, and of pruning."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.rules.edits import RuleEdits

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.monitor.rules_in_force import RulesInForce

SPACE = FeatureSpace((Feature('x'),))


def constraints(*rules):
    return Constraints(RuleSet(SPACE, rules, np.array([[0.0, 1.0]])))


HIGH, LOW = Rule('HIGH', (Literal(0, '>', 1.0),)), Rule('LOW', (Literal(0, '<', 0.0),))
BOTH = constraints(HIGH, LOW, Rule('OFF', (Literal(0, '>', 5.0),), enabled=False))


class Node:
    """A node that keeps what is published and logged."""

    def __init__(self):
        self.told, self.logged, self.seconds = [], [], 0.0

    def steady_seconds(self):
        return self.seconds

    def create_publisher(self, *_, **__):
        return SimpleNamespace(publish=lambda message: self.told.append(json.loads(message.data)))

    def get_logger(self):
        return SimpleNamespace(info=self.logged.append, warning=self.logged.append)

    @property
    def enabled(self):
        return [rule['id'] for rule in self.told[-1]['rules'] if rule['enabled']]


@pytest.fixture
def node():
    return Node()


def test_every_change_is_told_and_edits_can_be_taken_back(node):
    rules = RulesInForce(node)
    assert (rules.rule_set, rules.counts) == (None, None)
    rules.edit(RuleEdits(disabled=('LOW',)))
    assert node.told == []
    rules.use(rules.prepare(BOTH, 'file', strict=True))
    assert node.enabled == ['HIGH']
    assert node.told[-1]['rule_set'] == rules.rule_set.fingerprint
    rules.edit(RuleEdits.parse([], ['OFF'], ['HIGH: x > 2']))
    assert node.enabled == ['HIGH', 'LOW', 'OFF']
    assert node.told[-1]['rules'][0]['formula'] == 'x > 2.0'
    rules.edit(RuleEdits())
    assert rules.rule_set.fingerprint == BOTH.rule_set.fingerprint
    rules.clear()
    assert (rules.rule_set, rules.counts) == (None, None)


def test_edits_that_fit_hold_for_the_next_rule_set(node):
    rules = RulesInForce(node)
    rules.edits = RuleEdits(disabled=('LOW', 'HIGH'))
    other = constraints(HIGH, Rule('NEW', (Literal(0, '>', 9.0),)))
    with pytest.raises(OccError, match="no rule 'LOW'"):
        rules.prepare(other, 'file', strict=True)
    rules.use(rules.prepare(other, 'topic constraints', strict=False))
    assert node.enabled == ['NEW']
    assert any('are of no rule of topic constraints' in line for line in node.logged)
    rules.use(rules.prepare(BOTH, 'topic constraints', strict=False))
    assert node.enabled == []
    assert any('enables no rule' in line for line in node.logged)


def test_what_was_pruned_stays_so_when_edits_change(node, tmp_path):
    rules = RulesInForce(node)
    with pytest.raises(OccError, match='no rule set yet'):
        rules.prune(0.5, '')
    rules.edits = RuleEdits.parse([], ['OFF'], ['HIGH: x > 0.5'])
    rules.use(rules.prepare(BOTH, 'file', strict=True))
    rules.counts.add_stamped(rules.rule_set.judge(np.array([[0.7]] * 4 + [[0.2]])), 1)
    words = rules.prune(0.5, str(tmp_path / 'pruned.yaml'))
    assert words.startswith('pruned 2 rules, kept 1')
    assert node.enabled == ['HIGH']
    written = load_constraints(tmp_path / 'pruned.yaml').rule_set
    assert written.fingerprint == rules.rule_set.fingerprint
    assert written.rules[0].literals[0].bound == 0.5
    # The parameters still list the rule that was enabled and then pruned.
    changed = RuleEdits.parse([], ['OFF'], ['HIGH: x > 2'])
    rules.check(changed)
    rules.edit(changed)
    assert node.enabled == ['HIGH']
    assert rules.rule_set.rules[0].literals[0].bound == 2.0
    with pytest.raises(OccError, match="rule 'LOW' is to be enabled, but was pruned"):
        rules.check(RuleEdits(enabled=('LOW', 'OFF')))
    # Nor is it forgotten by another pruning.
    rules.counts.add_stamped(rules.rule_set.judge(np.array([[3.0]])), 1)
    assert rules.prune(0.5, '').startswith('pruned 0 rules')
    rules.edit(RuleEdits(enabled=('OFF',)))
    assert node.enabled == ['HIGH']
    rules.edit(RuleEdits())
    assert node.enabled == ['HIGH']
    assert rules.rule_set.rules[0].literals[0].bound == 1.0
    with pytest.raises(OccError, match="rule 'OFF' is to be enabled, but was pruned"):
        rules.check(RuleEdits(enabled=('OFF',)))
    rules.use(rules.prepare(BOTH, 'file', strict=True))
    rules.check(RuleEdits(enabled=('OFF',)))
    rules.edit(RuleEdits(enabled=('OFF',)))
    assert node.enabled == ['HIGH', 'LOW', 'OFF']


def test_counters_that_cannot_be_kept_are_told_now_and_then_and_stop_nothing(node, tmp_path):
    (tmp_path / 'full').touch()
    rules = RulesInForce(node)
    rules.counts_file = tmp_path / 'full' / 'counts.json'
    rules.use(rules.prepare(BOTH, 'file', strict=True))
    node.logged.clear()
    for node.seconds in range(150):
        rules.save_counts()
    assert len(node.logged) == 3
    assert all('counters are not kept: cannot write' in line for line in node.logged)
    rules.clear()
    rules.use(rules.prepare(BOTH, 'file', strict=True))
    (tmp_path / 'full').unlink()
    node.logged.clear()
    for node.seconds in range(150, 300):
        rules.save_counts()
    assert node.logged == [f'counters are kept again in {rules.counts_file}']
