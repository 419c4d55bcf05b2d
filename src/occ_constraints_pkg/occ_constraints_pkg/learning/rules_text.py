# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rules of a constraints file as text for people."""

from __future__ import annotations

from occ_constraints_pkg.learning.guarantee import promise_words
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.terminal import printable


def describe_rules(constraints: Constraints, *, counters: bool = False) -> str:
    """Return the rules of a constraints file as text, one line each."""
    rule_set = constraints.rule_set
    enabled = len(rule_set.order)
    head = '1 rule; it describes' if enabled == 1 else f'{enabled} rules; each describes'
    lines = [f'{head} a violation:']
    for rule in sorted(rule_set.rules, key=lambda rule: (not rule.enabled, len(rule.literals))):
        line = f'  {rule.id:<9} {rule.words(rule_set.space)}'
        if counters and rule.evaluated:
            line += f'   [violated {rule.violated} of {rule.evaluated}]'
        if not rule.enabled:
            line += '   (disabled)'
        if rule.note:
            line += f'   # {rule.note}'
        lines.append(line)
    return '\n'.join(map(printable, lines))


def describe_promise(constraints: Constraints) -> str:
    """Return what the file promises about false alarms in one sentence; empty if nothing."""
    calibration = constraints.learner.get('calibration')
    if not calibration:
        return ''
    edited = '; the rules were edited since, and this was not checked again'
    return promise_words(calibration) + (edited if constraints.is_edited else '')
