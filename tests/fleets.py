# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots, rules and reports for the model that views share, without ROS."""

import pytest
from occ_constraints_pkg.fleet.model import Fleet, Report, ViolatedRule
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.listing import rules_in_force_text

SPACE = FeatureSpace((Feature('speed', 'm/s'), Feature('clearance', 'm')))
FAST = Rule('FAST', (Literal(0, '>', 1.0),))
NEAR = Rule('NEAR', (Literal(1, '<', 0.5),))
OFF = Rule('OFF', (Literal(0, '>', 0.9), Literal(1, '<', 0.6)), enabled=False)
RULE_SET = RuleSet(SPACE, (OFF, FAST, NEAR), [[0.0, 1.0], [0.0, 2.0]])


@pytest.fixture
def rule_set():
    return RULE_SET


@pytest.fixture
def fleet():
    return Fleet()


@pytest.fixture
def robot(fleet):
    """Return a robot that was found at 100 s and has told its rules."""
    robot = fleet.robot('/robot1/violation', 100.0)
    robot.monitor = '/robot1/monitor'
    robot.hear_rules(rules_in_force_text(RULE_SET), 100.0)
    return robot


@pytest.fixture
def report():
    """Return a function that makes a report: of a margin, of violated rules, or of a reason."""

    def make(margin=0.5, *rules, reason='', **more):
        if reason:
            return Report(Verdict.UNKNOWN, reason=reason, **more)
        violated = tuple(
            ViolatedRule(name, f'{name} is true', margin, 'speed 1.5') for name in rules
        )
        verdict = Verdict.VIOLATED if violated else Verdict.SAFE
        return Report(verdict, margin, rules=violated, rule_set=RULE_SET.fingerprint, **more)

    return make
