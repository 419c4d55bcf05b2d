# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The oracle of the gate's soak finds what it is there for, and the soak runs."""

import pytest
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.gating import GateSettings

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from benchmarks.gate import Oracle, run  # noqa: E402

LETTERS = {'S': Verdict.SAFE, 'V': Verdict.VIOLATED, 'U': Verdict.UNKNOWN}


def judged(letters, command, *, begun=0.0, period=0.1):
    """Return why a command at this time is a breach, after verdicts from 0.1 s on."""
    oracle = Oracle(GateSettings())
    oracle.begun.append(begun)
    oracle.verdicts = [
        (period * (number + 1), LETTERS[letter])
        for number, letter in enumerate(letters)
        if letter != ' '
    ]
    oracle.commands.append(command)
    return oracle.breaches()


@pytest.mark.parametrize(
    ('letters', 'command', 'breaches'),
    [
        ('SSSSS', 0.55, []),
        ('SSSSS', 1.05, []),
        ('SSSSS', 1.15, ['no verdict']),
        ('', 0.1, ['no verdict']),
        ('SSSS', 0.45, ['not released']),
        ('SSSSSV', 0.75, []),
        ('SSSSSVV', 0.75, []),
        ('SSSSSVV', 0.85, ['VIOLATED']),
        ('SSSSSU', 0.75, ['UNKNOWN']),
        ('SSSSSUSSSS', 1.05, ['not released']),
        ('SSSSSUSSSSS', 1.15, []),
        ('SSSSS      SSSS', 1.55, ['not released']),
        ('SSSSS      SSSSS', 1.65, []),
    ],
)
def test_the_oracle_judges_commands(letters, command, breaches):
    assert judged(letters, command) == breaches


def test_five_safe_verdicts_within_the_grace_release():
    assert judged('SSSSSSSSSUSSSSS', 0.305, period=0.02) == []
    assert judged('SSSSSSSSSUSSSS', 0.305, period=0.02) == ['UNKNOWN']


def test_a_gate_that_is_started_knows_nothing_of_before():
    assert judged('SSSSSSSSSSSSSSS', 1.55, begun=1.4) == []
    assert judged('SSSSS     S', 1.15, begun=1.0) == ['not released']


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_short_soak_finds_nothing():
    metrics = run(15.0)['metrics']
    assert metrics['breaches'] == 0.0
    assert min(metrics['interleavings'], metrics['commands_not_zero']) > 0.0
