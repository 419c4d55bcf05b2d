# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in words: DiagnosticArray messages for people and viewers, and for the gate."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

# Name of the status with a robot's verdict.
VERDICT_NAME = 'monitor: verdict'
# How the name of a violated rule's status begins.
RULE_NAME = 'monitor: rule '
# Key of the wall time of judging, in ns. The stamp is the input's, which a simulation or recording
# sets as it likes, so it does not show whether a verdict is of now or played back.
_JUDGED_AT = 'judged_at'
_IS_TIME = re.compile('[0-9]{1,19}')
# Robots of a batch that one message describes at most.
_MOST_ROBOTS = 4
_LEVELS = {
    Verdict.SAFE: DiagnosticStatus.OK,
    Verdict.VIOLATED: DiagnosticStatus.ERROR,
    Verdict.UNKNOWN: DiagnosticStatus.STALE,
}
# On `/diagnostics`, STALE is what aggregators say of a publisher that is dead.
_REPORTED_LEVELS = {**_LEVELS, Verdict.UNKNOWN: DiagnosticStatus.ERROR}


def violation_message(
    rule_set: RuleSet,
    values: np.ndarray,
    judgement: Judgement,
    stamp_ns: int,
    more: dict[str, object] | None = None,
    episodes: np.ndarray | None = None,
) -> DiagnosticArray:
    """Describe a single robot, or the first few of a batch that are not safe.

    For each robot one status with the verdict, then one for every enabled rule it violates, with
    the rule's id, text, formula, margin and the values of its features.

    Args:
        rule_set: the rules that judged.
        values: (n, k) the features judged.
        judgement: of the n rows.
        stamp_ns: stamp of the input.
        more: further values for robot 0; None for none.
        episodes: (n,) number of each robot's episode; None where the input has none.
    """
    robots = np.flatnonzero(judgement.verdict != Verdict.SAFE)[:_MOST_ROBOTS]
    if not len(robots):
        robots = np.array([0])
    message = DiagnosticArray()
    message.header.stamp = to_time(stamp_ns)
    message.status = [
        status
        for robot in robots
        for status in _robot_statuses(
            rule_set,
            values[robot],
            judgement,
            int(robot),
            {
                **({} if episodes is None else {'episode': float(episodes[robot])}),
                **((more or {}) if robot == 0 else {}),
            },
        )
    ]
    return message


def unknown_message(reason: str, rule_set: RuleSet | None, stamp_ns: int) -> DiagnosticArray:
    """Return that nothing can be judged, and why; ``stamp_ns`` is that of the last input."""
    values = _summary(0, Verdict.UNKNOWN, math.nan, rule_set)
    message = DiagnosticArray()
    message.header.stamp = to_time(stamp_ns)
    message.status = [status(VERDICT_NAME, DiagnosticStatus.STALE, f'UNKNOWN: {reason}', values)]
    return message


def report_message(
    name: str,
    state: Verdict,
    problem: str,
    values: dict[str, object],
    stamp_ns: int,
    hardware_id: str,
) -> DiagnosticArray:
    """Report how the monitor is doing, for ``/diagnostics``.

    Args:
        name: of the status.
        state: the verdict to report.
        problem: why nothing is judged.
        values: further values.
        stamp_ns: now.
        hardware_id: see :func:`hardware_id_of`.
    """
    text = f'{state.name}: {problem}' if problem else state.name
    message = DiagnosticArray(
        status=[status(name, _REPORTED_LEVELS[state], text, values, hardware_id)]
    )
    message.header.stamp = to_time(stamp_ns)
    return message


def sensor_status(name: str, doubts: Sequence[str], hardware_id: str) -> DiagnosticStatus:
    """Return what about the sensors is likely not so; ``OK`` without a doubt."""
    level = DiagnosticStatus.WARN if doubts else DiagnosticStatus.OK
    return status(name, level, '; '.join(doubts) or 'no doubt', None, hardware_id)


def read_verdict(message: DiagnosticArray) -> tuple[Verdict, float, str]:
    """Return the worst verdict in a message on ``violation``, its margin, and its words.

    A message without any is UNKNOWN. The margin is NaN where it is missing or no number.
    """
    worst = Verdict.UNKNOWN, math.nan, 'UNKNOWN: the message on violation has no verdict'
    severity = -1
    for item in message.status:
        if item.name != VERDICT_NAME:
            continue
        verdict = next((key for key, level in _LEVELS.items() if level == item.level), None)
        verdict = Verdict.UNKNOWN if verdict is None else verdict
        if verdict > severity:
            margin = next((entry.value for entry in item.values if entry.key == 'margin'), 'nan')
            severity, worst = verdict, (verdict, _number(margin), item.message)
    return worst


def read_judged_at(message: DiagnosticArray) -> int | None:
    """Return the wall time in ns at which a monitor judged; None where no verdict has it.

    One that cannot be read is 0, which is as old as can be.
    """
    times = [
        int(entry.value) if _IS_TIME.fullmatch(entry.value) else 0
        for item in message.status
        if item.name == VERDICT_NAME
        for entry in item.values
        if entry.key == _JUDGED_AT
    ]
    return min(times, default=None)


def violated_rule_ids(message: DiagnosticArray) -> list[str]:
    """Return the ids of the rules that a message on ``violation`` names as violated."""
    return [
        item.name.removeprefix(RULE_NAME)
        for item in message.status
        if item.name.startswith(RULE_NAME)
    ]


def status(
    name: str,
    level: bytes,
    text: str,
    values: dict[str, object] | None = None,
    hardware_id: str = 'robot 0',
) -> DiagnosticStatus:
    """Build one status; values become strings."""
    return DiagnosticStatus(
        name=name,
        level=level,
        message=text,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=_text(value)) for key, value in (values or {}).items()],
    )


def hardware_id_of(namespace: str) -> str:
    """Return what a robot is called on ``/diagnostics`` (REP 107): its namespace, or ``robot``."""
    return namespace.strip('/') or 'robot'


def why_unknown(rule_set: RuleSet, sample: np.ndarray) -> str:
    """Return which features of one sample (k,) cannot be judged, and why."""
    space = rule_set.space
    reasons = []
    for feature, value in zip(space.features, sample, strict=True):
        if np.isnan(value):
            reasons.append(f'{feature.name} is missing, stale or not a number')
        elif not np.isfinite(value) or not feature.low <= value <= feature.high:
            bounds = f'[{feature.low:g}, {feature.high:g}]'
            reasons.append(f'{feature.name} = {value:g} is outside its physical bounds {bounds}')
    return '; '.join(reasons)


def _robot_statuses(
    rule_set: RuleSet,
    sample: np.ndarray,
    judgement: Judgement,
    robot: int,
    more: dict[str, object],
) -> list[DiagnosticStatus]:
    verdict, name = Verdict(judgement.verdict[robot]), f'robot {robot}'
    summary = _summary(robot, verdict, float(judgement.margin[robot]), rule_set)
    summary |= more
    if verdict is Verdict.UNKNOWN:
        text = f'UNKNOWN: {summary.get("reason") or why_unknown(rule_set, sample)}'
        return [status(VERDICT_NAME, _LEVELS[verdict], text, summary, name)]
    if verdict is Verdict.SAFE:
        words = summary.get('warning', '')
        text = f'SAFE: {words}' if words else 'SAFE'
        return [status(VERDICT_NAME, _LEVELS[verdict], text, summary, name)]
    margins = rule_set.rule_margins(sample)
    violated = rule_set.violated_rules(sample)
    words = '; '.join(rule_set.rules[index].words(rule_set.space, sample) for index in violated)
    text = f'{verdict.name}: {words}'
    statuses = [status(VERDICT_NAME, _LEVELS[verdict], text, summary, name)]
    for index in violated:
        rule = rule_set.rules[index]
        details = {
            'id': rule.id,
            'text': rule.words(rule_set.space),
            'formula': rule.formula(rule_set.space),
            'margin': float(margins[index]),
            **{
                rule_set.space.names[feature]: float(sample[feature])
                for feature in rule.fired(sample)
            },
        }
        told = rule.words(rule_set.space, sample)
        statuses.append(
            status(f'{RULE_NAME}{rule.id}', DiagnosticStatus.ERROR, told, details, name)
        )
    return statuses


def _summary(
    robot: int, verdict: Verdict, margin: float, rule_set: RuleSet | None
) -> dict[str, object]:
    summary = {
        'robot': robot,
        'verdict': verdict.name,
        'margin': margin,
        _JUDGED_AT: time.time_ns(),
    }
    return summary if rule_set is None else {**summary, 'rule_set': rule_set.fingerprint}


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
