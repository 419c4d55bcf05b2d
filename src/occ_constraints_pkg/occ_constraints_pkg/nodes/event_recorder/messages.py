# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What monitors and gates publish, read for events."""

from __future__ import annotations

import math
import re
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.derivation import RuleSample, Sample
from occ_constraints_pkg.events.offline import bounds_of, nearest_rule
from occ_constraints_pkg.events.stops import GateSample
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.diagnostics import RULE_NAME, VERDICT_NAME
from occ_constraints_pkg.ros.messages import to_nanoseconds
from occ_constraints_pkg.rules import RuleSet, Verdict
from occ_constraints_pkg.rules.listing import read_rules_in_force

# Keys of a violated rule's status that are no features.
_RULE_KEYS = ('id', 'text', 'formula', 'margin')
# Robots that one message on `violation` describes at most; others may then be unsafe too.
MOST_ROBOTS = 4
_MOST_RULE_SETS, _MOST_ROWS = 8, 200
_ROBOT = re.compile('robot ([0-9]{1,9})')
_WHOLE = re.compile('[0-9]{1,19}')
_SOURCE = ': verdicts on '


@dataclass
class Judged:
    """What is known of the rules in force and of what they judged, of monitors on one topic.

    Attributes:
        rule_sets: by fingerprint.
        rows: (robots, k) of the newest inputs, by fingerprint and stamp.
    """

    rule_sets: OrderedDict[str, RuleSet] = field(default_factory=OrderedDict)
    rows: OrderedDict[tuple[str, int], np.ndarray] = field(default_factory=OrderedDict)

    def hear_rules(self, message: String) -> None:
        """Take a message on ``rules``.

        Raises:
            OccError: it cannot be read.
        """
        rule_set = read_rules_in_force(message.data, 'topic rules')
        self.rule_sets[rule_set.fingerprint] = rule_set
        self.rule_sets.move_to_end(rule_set.fingerprint)
        while len(self.rule_sets) > _MOST_RULE_SETS:
            self.rule_sets.popitem(last=False)

    def hear_features(self, message: PointCloud2) -> None:
        """Take a message on ``features``.

        Raises:
            OccError: it is no table.
        """
        key = message.header.frame_id, to_nanoseconds(message.header.stamp)
        self.rows[key] = Table.from_message(message).values
        while len(self.rows) > _MOST_ROWS:
            self.rows.popitem(last=False)

    def bounds(self, rule_set: str | None, rule: str) -> tuple[dict[str, object], ...]:
        """Return the literals of a rule; none if the rules have not come."""
        rules = self.rule_sets.get(rule_set or '')
        return () if rules is None else bounds_of(rules, rule)

    def nearest(self, rule_set: str | None, stamp: int, robot: int) -> RuleSample | None:
        """Return the rule that was closest to a violation; None if the features have not come."""
        rules = self.rule_sets.get(rule_set or '')
        rows = self.rows.get((rule_set or '', stamp))
        if rules is None or rows is None or robot >= len(rows) or rows.shape[1] != len(rules.space):
            return None
        try:
            return nearest_rule(rules, np.asarray(rows[robot], dtype=np.float64))
        except OccError:
            return None


def read_samples(
    message: DiagnosticArray, judged: Judged, wall: int, steady: int
) -> dict[int, Sample]:
    """Return what a message on ``violation`` says, by the number of the robot.

    Args:
        message: as the monitor publishes it; of another one, what has its form.
        judged: what the rules and the features are.
        wall: wall time in ns at which it came.
        steady: the same on a clock that is never set.
    """
    stamp = to_nanoseconds(message.header.stamp)
    statuses: dict[int, DiagnosticStatus] = {}
    rules: dict[int, list[tuple[DiagnosticStatus, dict[str, str]]]] = {}
    for status in message.status:
        found = _ROBOT.fullmatch(status.hardware_id)
        robot = int(found[1]) if found else 0
        if status.name == VERDICT_NAME:
            statuses[robot] = status
        elif status.name.startswith(RULE_NAME):
            own = {item.key: item.value for item in status.values}
            rules.setdefault(robot, []).append((status, own))
    samples = {}
    for robot, status in statuses.items():
        own = {item.key: item.value for item in status.values}
        verdict = _verdict(own.get('verdict', ''))
        rule_set = own.get('rule_set') or None
        violated = [
            RuleSample(
                item.name.removeprefix(RULE_NAME),
                item.message,
                _number(values.get('margin', '')),
                {key: _number(text) for key, text in values.items() if key not in _RULE_KEYS},
                judged.bounds(rule_set, item.name.removeprefix(RULE_NAME)),
            )
            for item, values in rules.get(robot, ())
        ]
        is_unknown = verdict is Verdict.UNKNOWN
        samples[robot] = Sample(
            verdict,
            math.nan if is_unknown else _number(own.get('margin', '')),
            stamp,
            wall,
            steady,
            rules=tuple(violated) if verdict is Verdict.VIOLATED else (),
            reason=status.message.removeprefix('UNKNOWN: ') if is_unknown else '',
            rule_set=rule_set,
            episode=_number(own.get('episode', '0')),
            # Without an input, as after a timeout, there is no state for people either.
            is_answer=not is_unknown or 'state' in own or robot > 0,
            nearest=_Nearest(judged, rule_set, stamp, robot),
        )
    return samples


@dataclass(frozen=True)
class _Nearest:
    """Asks for the rule that was closest to a violation."""

    judged: Judged
    rule_set: str | None
    stamp: int
    robot: int

    def __call__(self) -> RuleSample | None:
        return self.judged.nearest(self.rule_set, self.stamp, self.robot)


def read_gate_sample(message: DiagnosticArray, wall: int, steady: int) -> GateSample | None:
    """Return what a message on a gate's ``~/state`` says; None where it is of no gate."""
    if not message.status or not message.status[0].name.endswith(': output'):
        return None
    own = {item.key: item.value for item in message.status[0].values}
    rules: list[str] = []
    safe = []
    for values in _sources(message):
        rules += [name for name in values.get('rules', '').split(', ') if name]
        if _WHOLE.fullmatch(values.get('safe_in_a_row', '')):
            safe.append(int(values['safe_in_a_row']))
    since = own.get('since', '')
    return GateSample(
        own.get('state', ''),
        own.get('reason', ''),
        int(since) if _WHOLE.fullmatch(since) else 0,
        wall,
        steady,
        tuple(rules),
        min(safe, default=None),
    )


def _sources(message: DiagnosticArray) -> Iterator[dict[str, str]]:
    for status in message.status[1:]:
        if _SOURCE in status.name:
            yield {item.key: item.value for item in status.values}


def _verdict(name: str) -> Verdict:
    """Return the verdict of this name; anything else is UNKNOWN."""
    return Verdict[name] if name in Verdict.__members__ else Verdict.UNKNOWN


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
