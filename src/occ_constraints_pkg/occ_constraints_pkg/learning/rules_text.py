# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rules of a constraints file, and how they were learned, as text and as plain values."""

from __future__ import annotations

from typing import Any

from occ_constraints_pkg.learning.guarantee import guarantee_words
from occ_constraints_pkg.learning.simplification import size
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.listing import rules_document
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of


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


def describe_guarantee(constraints: Constraints) -> str:
    """Return what the file guarantees about false alarms in one sentence; empty if nothing."""
    calibration = constraints.learner.get('calibration')
    if not calibration:
        return ''
    edited = '; the rules were edited since, and this was not checked again'
    return guarantee_words(calibration) + (edited if constraints.is_edited else '')


def describe_file(constraints: Constraints) -> str:
    """Return the rules with their counters, and the guarantee on false alarms if there is one."""
    guarantee = describe_guarantee(constraints)
    rules = describe_rules(constraints, counters=True)
    return f'{rules}\n\n{printable(guarantee)}' if guarantee else rules


def file_document(constraints: Constraints) -> dict[str, Any]:
    """Return the same as plain values, ready for JSON."""
    document = rules_document(constraints.rule_set)
    for entry, rule in zip(document['rules'], constraints.rule_set.rules, strict=True):
        entry.update(evaluated=rule.evaluated, violated=rule.violated)
    calibration = constraints.learner.get('calibration')
    return {**document, 'edited': constraints.is_edited, 'calibration': calibration}


def describe_learned(constraints: Constraints) -> str:
    """Return rules that have just been learned, how much they cover and what they guarantee."""
    learner, coverage = constraints.learner, constraints.coverage
    extracted = learner['extracted_rules'], learner['extracted_literals']
    rules, literals = size(constraints.rule_set)
    before = f'{count_of(extracted[0], "rule")} with {count_of(extracted[1], "literal")}'
    if learner['full_conditions']:
        simplified = f'{before}, not simplified'
    elif (rules, literals) == extracted:
        simplified = f'{before}; there was nothing to simplify'
    else:
        simplified = f'Simplified from {before} to {rules} with {literals}'
    inside = (
        f'Inside the safe set: {coverage["training"]:.2%} of '
        f'{count_of(coverage["training_samples"], "training sample")}'
    )
    if coverage['held_out'] is not None:
        inside += (
            f', {coverage["held_out"]:.2%} of {coverage["held_out_samples"]} samples of '
            f'{count_of(coverage["held_out_episodes"], "held-out episode")}'
        )
    lines = [describe_rules(constraints), '', simplified, inside]
    if guarantee := describe_guarantee(constraints):
        lines.append(guarantee)
    return '\n'.join(lines)


def learned_document(constraints: Constraints) -> dict[str, Any]:
    """Return the numbers of :func:`describe_learned` as plain values, ready for JSON."""
    learner = constraints.learner
    rules, literals = size(constraints.rule_set)
    calibration = learner.get('calibration')
    return {
        'rules': rules,
        'literals': literals,
        'extracted_rules': learner['extracted_rules'],
        'extracted_literals': learner['extracted_literals'],
        **constraints.coverage,
        **({'calibration': calibration} if calibration else {}),
    }
