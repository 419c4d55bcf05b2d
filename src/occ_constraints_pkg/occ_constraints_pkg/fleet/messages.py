# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What monitors and gates publish, read for the model."""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from occ_constraints_pkg.fleet.model import GateReport, MonitorReport, Report, ViolatedRule
from occ_constraints_pkg.ros.diagnostics import (
    RULE_NAME,
    VERDICT_NAME,
    read_judged_at,
    read_verdict,
)
from occ_constraints_pkg.ros.messages import to_nanoseconds
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.terminal import printable

# How the names of a monitor's statuses on `/diagnostics` end; how that of a gate's source begins.
JUDGING = ': judging'
_SENSORS = ': sensors'
_SOURCE = ': verdicts on '
# Keys of a violated rule's status that are no features.
_RULE_KEYS = ('id', 'text', 'formula', 'margin')
_MOST_VALUES = 4


def read_report(message: DiagnosticArray) -> Report:
    """Return what a message on ``violation`` says; one without a verdict is UNKNOWN."""
    verdict, margin, words = read_verdict(message)
    values: dict[str, str] = {}
    rules = []
    for status in message.status:
        own = {item.key: item.value for item in status.values}
        robot = _whole(status.hardware_id.removeprefix('robot '))
        if status.name == VERDICT_NAME and status.message == words and not values:
            values = {**own, 'robot': str(robot)}
        elif status.name.startswith(RULE_NAME):
            rules.append(
                ViolatedRule(
                    printable(status.name.removeprefix(RULE_NAME)),
                    printable(status.message),
                    _number(own.get('margin', '')),
                    _feature_values(own),
                    robot,
                )
            )
    # What follows the name of the verdict.
    reason = words.partition(': ')[2]
    return Report(
        verdict,
        margin,
        _whole(values.get('robot', '')),
        '' if verdict is Verdict.VIOLATED and rules else printable(reason),
        tuple(rules),
        values.get('rule_set', ''),
        printable(values.get('next_rule', '')),
        _number(values.get('time_to_violation', 'inf')),
        read_judged_at(message),
        to_nanoseconds(message.header.stamp),
    )


def read_gate(message: DiagnosticArray) -> GateReport | None:
    """Return what a message on a gate's ``~/state`` says; None where it is of no gate."""
    if not message.status or not message.status[0].name.endswith(': output'):
        return None
    values = {item.key: item.value for item in message.status[0].values}
    topics = [item.name.partition(_SOURCE)[2] for item in message.status[1:]]
    return GateReport(
        printable(values.get('state', '?')),
        _number(values.get('scale', '')),
        printable(values.get('reason', '')),
        _whole(values.get('since', '')),
        tuple(topic for topic in topics if topic),
    )


def read_monitors(message: DiagnosticArray) -> dict[str, MonitorReport]:
    """Return what the monitors that a message on ``/diagnostics`` is about say of themselves.

    Returns:
        By the full name of the node.
    """
    doubts = {
        status.name.removesuffix(_SENSORS): printable(status.message)
        for status in message.status
        if status.name.endswith(_SENSORS) and status.level != DiagnosticStatus.OK
    }
    names = [item.name.removesuffix(JUDGING) for item in message.status]
    return {
        f'/{name}': MonitorReport(_idle(status), doubts.get(name, ''))
        for name, status in zip(names, message.status, strict=True)
        if status.name.endswith(JUDGING)
    }


def _idle(status: DiagnosticStatus) -> str:
    verdict, _, reason = status.message.partition(': ')
    return printable(reason) if verdict == Verdict.UNKNOWN.name else ''


def _feature_values(values: dict[str, str]) -> str:
    told = [
        f'{printable(key)} {_number(value):.4g}'
        for key, value in values.items()
        if key not in _RULE_KEYS
    ]
    # A rule about a family has the value of each member that makes it true.
    more = [f'{len(told) - _MOST_VALUES} more'] if len(told) > _MOST_VALUES else []
    return ', '.join(told[:_MOST_VALUES] + more)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _whole(text: str) -> int:
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 20 else 0
