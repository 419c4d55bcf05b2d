# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the page is told, as JSON: four kinds of messages, each whole in itself.

A page that has missed some, or has only come, needs nothing but the newest message of each kind:

- ``now``, at each tick: how each robot stands, its closest rules, gates, health, and the margins of
  the last seconds.
- ``past``: the margins of the last minutes.
- ``rules``: the words of all rules, by fingerprint.
- ``log``: events, and what has changed.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from typing import Any

from occ_constraints_pkg.fleet.events import HeardEvent
from occ_constraints_pkg.fleet.margins import BUCKET_SECONDS, BUCKETS
from occ_constraints_pkg.fleet.model import (
    LOST_SECONDS,
    Change,
    Fleet,
    Gate,
    Robot,
    Standing,
)
from occ_constraints_pkg.rules import RuleSet

PAST_SECONDS = 2.0
"""How often ``past`` is told; ``now`` has the margins of a longer time."""
REPEAT_SECONDS = 10.0
"""How often ``rules`` and ``log`` are told though nothing has changed."""
_RECENT = int(2 * PAST_SECONDS / BUCKET_SECONDS)
MOST_RULES = 12
"""Rules that are told of each robot, the closest ones."""
_MOST_CHANGES = 100
# Words come from the network: nobody reads more.
_MOST_TEXT = 400


class Documents:
    """Makes the messages for the page.

    Args:
        fleet: what is shown.
        allows_control: whether the page may offer to change something.
    """

    def __init__(self, fleet: Fleet, *, allows_control: bool = False) -> None:
        self._fleet, self._allows_control = fleet, allows_control
        self._past_at = self._rules_at = self._log_at = -math.inf
        self._told_rules: frozenset[str] = frozenset()
        self._told_log: tuple[int, int] | None = None

    def messages(self, now: float, *, anew: bool = False) -> dict[str, bytes]:
        """Return what has to be told now, by kind.

        Args:
            now: on the steady clock of the fleet.
            anew: whether somebody may know nothing yet, so that each kind is told.
        """
        if anew:
            self._past_at = self._rules_at = self._log_at = -math.inf
        robots = list(self._fleet.robots.values())
        told = {'now': self._now(robots, now)}
        if now - self._past_at >= PAST_SECONDS:
            self._past_at = now
            told['past'] = self._past(robots, now)
        sets = {robot.rule_set.fingerprint: robot.rule_set for robot in robots if robot.rule_set}
        if sets.keys() != self._told_rules or now - self._rules_at >= REPEAT_SECONDS:
            self._told_rules, self._rules_at = frozenset(sets), now
            told['rules'] = {'sets': {name: _rule_texts(item) for name, item in sets.items()}}
        version = self._fleet.events.version, self._fleet.change_count
        if version != self._told_log or now - self._log_at >= REPEAT_SECONDS:
            self._told_log, self._log_at = version, now
            told['log'] = self._log(now)
        return {kind: _json(document) for kind, document in told.items()}

    def _now(self, robots: list[Robot], now: float) -> dict[str, Any]:
        return {
            'time': round(time.time(), 3),
            'bucket': int(now / BUCKET_SECONDS),
            'control': self._allows_control,
            'robots': [self._robot(robot, now) for robot in robots],
            'gates': [
                _gate(gate, now)
                for gate in self._fleet.gates.values()
                if not any(robot.topic in gate.report.topics for robot in robots)
            ],
        }

    def _robot(self, robot: Robot, now: float) -> dict[str, Any]:
        standing = robot.standing(now)
        order, margins = robot.closeness(now)
        rows = [(int(index), robot.rule_row(index, margins, now)) for index in order[:MOST_RULES]]
        report = robot.report
        is_known = standing < Standing.UNKNOWN
        return {
            'id': robot.topic,
            'name': _cut(robot.name),
            'standing': standing.name,
            'why': _cut(robot.why(now)),
            'margin': _number(report.margin) if is_known and report else None,
            'next': [_cut(report.next_rule), _number(report.seconds)]
            if is_known and report and report.next_rule
            else None,
            'recorded': robot.is_recorded,
            'problem': _cut(robot.problem),
            'rule_set': robot.rule_set.fingerprint if robot.rule_set else None,
            'rules': [
                [index, _number(row.margin), _cut(row.values), *(row.counted or (None, None))]
                for index, row in rows
            ],
            'gates': [_gate(gate, now) for gate in self._fleet.gates_of(robot)],
            'recent': [_margin(item) for item in robot.margins(_RECENT, now)],
            'health': _health(robot, now),
        }

    def _past(self, robots: list[Robot], now: float) -> dict[str, Any]:
        return {
            'bucket': int(now / BUCKET_SECONDS),
            'bucket_seconds': BUCKET_SECONDS,
            'margins': {
                robot.topic: [_margin(item) for item in robot.margins(BUCKETS, now)]
                for robot in robots
            },
        }

    def _log(self, now: float) -> dict[str, Any]:
        wall = time.time()
        events = sorted(self._fleet.events, key=lambda event: event.began_ns, reverse=True)
        changes = itertools.islice(self._fleet.changes(), _MOST_CHANGES)
        return {
            'events': [_event(event) for event in events],
            'recorders': len(self._fleet.events.sources),
            'changes': [_change(change, wall - (now - change.time)) for change in changes],
        }


def _gate(gate: Gate, now: float) -> dict[str, Any]:
    report = gate.report
    return {
        'name': _cut(gate.name),
        'state': 'LOST' if gate.is_lost or now - gate.heard > LOST_SECONDS else report.state,
        'scale': _number(report.scale),
        'reason': _cut(report.reason),
        'since': round(report.since_ns / 1e9, 3) if report.since_ns else None,
    }


def _health(robot: Robot, now: float) -> dict[str, Any]:
    health = robot.health
    return {
        'monitor': _cut(robot.monitor),
        'rate': round(health.rate(now), 1),
        'age': round(max(0.0, now - robot.heard), 2) if robot.report else None,
        'delay': _number(health.delay),
        'publishers': robot.publishers,
        'subscribers': health.subscribers,
        'queue': health.queue,
        'doubts': _cut(health.doubts),
    }


def _rule_texts(rule_set: RuleSet) -> list[Any]:
    return [
        [_cut(rule.id), _cut(rule.words(rule_set.space)), rule.enabled, _cut(rule.note)]
        for rule in rule_set.rules
    ]


def _event(event: HeardEvent) -> dict[str, Any]:
    return {
        'id': event.id,
        'phase': event.phase,
        'kind': event.kind,
        'robot': event.robot,
        'rule': event.rule,
        'text': event.text,
        'values': event.values,
        'margin': _number(event.margin),
        'began': _seconds(event.began_ns),
        'ended': _seconds(event.ended_ns),
        'reason': event.reason,
        'bag': event.bag,
    }


def _change(change: Change, wall: float) -> list[Any]:
    return [round(wall, 2), _cut(change.source), change.kind, _cut(change.text)]


def _seconds(nanoseconds: int) -> float | None:
    return round(nanoseconds / 1e9, 3) if nanoseconds else None


def _number(value: float) -> float | None:
    # JSON has neither NaN nor infinity, which the largest numbers are rounded to.
    rounded = float(f'{value:.5g}')
    return rounded if math.isfinite(rounded) else None


def _margin(value: float | None) -> float | str | None:
    """Return a margin of a span: ``?`` where it holds UNKNOWN, None where nothing was said."""
    if value is None:
        return None
    return round(value, 4) if math.isfinite(value) else '?'


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_TEXT else f'{text[:_MOST_TEXT]}…'


def _json(document: dict[str, Any]) -> bytes:
    # A name may hold half of a pair of surrogates, which UTF-8 cannot: escapes can.
    return json.dumps(document, allow_nan=False, separators=(',', ':')).encode('ascii')
