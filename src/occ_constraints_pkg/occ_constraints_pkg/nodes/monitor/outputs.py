# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the monitor publishes of a verdict; for people only what somebody subscribes to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from visualization_msgs.msg import MarkerArray

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TableSerializer
from occ_constraints_pkg.nodes.monitor.markers import Sector, sector_markers, verdict_markers
from occ_constraints_pkg.nodes.monitor.state_log import StateLog
from occ_constraints_pkg.ros.diagnostics import (
    hardware_id_of,
    report_message,
    sensor_status,
    unknown_message,
    violation_message,
)
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import VERDICTS, overridable
from occ_constraints_pkg.ros.tables import table_bytes, table_message
from occ_constraints_pkg.rules import Judgement, RuleSet, Verdict
from occ_constraints_pkg.rules.ruleset import RuleCounts

COST_COLUMNS = ('cost', 'verdict', 'margin', 'rule')
RULE_COLUMNS = ('evaluated', 'violated')


@dataclass(frozen=True, eq=False)
class Answer:
    """The judgement of one input.

    Attributes:
        rule_set: the rules that judged.
        rows: what they judged.
        judgement: of these rows.
    """

    rule_set: RuleSet
    rows: FeatureRows
    judgement: Judgement

    @property
    def verdict(self) -> Verdict:
        """The verdict on robot 0."""
        return Verdict(self.judgement.verdict[0])


class Outputs:
    """The topics and the log of the monitor.

    Args:
        node: publishes.
    """

    def __init__(self, node: OccNode) -> None:
        def publisher(message_type: Any, topic: str) -> Publisher:
            return node.create_publisher(
                message_type,
                topic,
                VERDICTS,
                qos_overriding_options=overridable(with_promises=True),
            )

        self._log = StateLog(node)
        self._costs = publisher(PointCloud2, 'costs')
        self._features = publisher(PointCloud2, 'features')
        self._cost = publisher(Float64, 'cost')
        self._margin = publisher(Float64, 'margin')
        self._time = publisher(Float64, 'time_to_violation')
        self._violation = publisher(DiagnosticArray, 'violation')
        self._markers = publisher(MarkerArray, 'markers')
        self._rule_stats = publisher(PointCloud2, 'rule_stats')
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._name = node.get_fully_qualified_name().lstrip('/')
        self._hardware_id = hardware_id_of(node.get_namespace())

    @property
    def subscribers(self) -> int:
        """The smaller one of the numbers of subscribers of ``costs`` and ``violation``."""
        topics = (self._costs, self._violation)
        return min(publisher.get_subscription_count() for publisher in topics)

    @property
    def wants_forecast(self) -> bool:
        """Whether anybody would receive the estimated time to a violation."""
        topics = (self._time, self._violation)
        return any(publisher.get_subscription_count() for publisher in topics)

    @property
    def wants_markers(self) -> bool:
        """Whether anybody would receive markers."""
        return self._markers.get_subscription_count() > 0

    def publish_costs(self, answer: Answer) -> None:
        """Answer an input with one row per robot, in the name of the rule set that judged."""
        if self._costs.get_subscription_count():
            self._costs.publish(
                costs_message(answer.judgement, answer.rows.stamp_ns, answer.rule_set.fingerprint)
            )

    def publish_verdict(self, answer: Answer, state: Verdict, foreseen: dict[str, object]) -> None:
        """Publish and log all but ``costs`` and ``markers``.

        Args:
            answer: the input's rows and judgement.
            state: the steady verdict on robot 0, for people.
            foreseen: what is expected next, with the key ``time_to_violation``; may be empty if
                :attr:`wants_forecast` is false.
        """
        rule_set, rows, judgement = answer.rule_set, answer.rows, answer.judgement
        if self._features.get_subscription_count():
            self._features.publish(features_message(answer))
        if self._cost.get_subscription_count():
            self._cost.publish(Float64(data=0.0 if answer.verdict is Verdict.SAFE else 1.0))
        if self._margin.get_subscription_count():
            self._margin.publish(Float64(data=float(judgement.margin[0])))
        if foreseen and self._time.get_subscription_count():
            self._time.publish(Float64(data=foreseen['time_to_violation']))
        if foreseen and self._violation.get_subscription_count():
            reason = {'reason': rows.note} if rows.note else {}
            more = {**reason, 'state': state.name, **foreseen}
            self._violation.publish(
                violation_message(
                    rule_set, rows.values, judgement, rows.stamp_ns, more, _episodes(rows)
                )
            )
        self._log.log_judgement(rule_set, rows, judgement, state)

    def publish_markers(self, answer: Answer, state: Verdict, sectors: Iterable[Sector]) -> None:
        """Publish the markers of robot 0: its state, the rules violated now and their sectors.

        Args:
            answer: the input's rows and judgement.
            state: the steady verdict.
            sectors: the features that can be outlined.
        """
        rule_set, sample = answer.rule_set, answer.rows.values[0]
        violated = [rule_set.rules[index] for index in rule_set.violated_rules(sample)]
        fired = {
            rule_set.space.names[feature]: float(sample[feature])
            for rule in violated
            for feature in rule.fired(sample)
        }
        words = '\n'.join(rule.words(rule_set.space, sample) for rule in violated)
        outlines = sector_markers(sectors, fired)
        self._markers.publish(verdict_markers(state, words, answer.rows.stamp_ns, outlines))

    def publish_unknown(self, reason: str, rule_set: RuleSet | None, stamp_ns: int) -> None:
        """Publish that nothing can be judged, and why; ``stamp_ns`` is that of the last input."""
        self._cost.publish(Float64(data=1.0))
        self._margin.publish(Float64(data=math.nan))
        self._time.publish(Float64(data=math.nan))
        self._violation.publish(unknown_message(reason, rule_set, stamp_ns))
        if self.wants_markers:
            self._markers.publish(verdict_markers(Verdict.UNKNOWN, reason, stamp_ns))
        self._log.log_unknown(reason)

    def publish_rule_stats(self, counts: RuleCounts, stamp_ns: int) -> None:
        """Publish the counters, one row per rule."""
        columns = (counts.evaluated, counts.violated)
        table = Table(RULE_COLUMNS, np.stack(columns, axis=1).astype(np.float64))
        self._rule_stats.publish(table_message(table, stamp_ns))

    def publish_report(
        self,
        state: Verdict,
        problem: str,
        values: dict[str, object],
        doubts: Sequence[str],
        stamp_ns: int,
    ) -> None:
        """Publish on ``/diagnostics`` how the monitor and its sensors are doing.

        Args:
            state: see `report_message`, as for the next two.
            problem: why nothing is judged.
            values: further values.
            doubts: what about the sensors is likely not so; each is logged when it is new.
            stamp_ns: now.
        """
        robot = self._hardware_id
        message = report_message(f'{self._name}: judging', state, problem, values, stamp_ns, robot)
        message.status.append(sensor_status(f'{self._name}: sensors', doubts, robot))
        self._diagnostics.publish(message)
        self._log.log_doubts(doubts)


def features_message(answer: Answer) -> bytes:
    """Return what was judged, a row for each robot, serialized."""
    rule_set, rows = answer.rule_set, answer.rows
    table = Table(rule_set.space.names, np.asarray(rows.values, np.float64))
    return table_bytes(table, rows.stamp_ns, rule_set.fingerprint)


def costs_table(judgement: Judgement) -> Table:
    """Return a judgement as the table that ``costs`` carries: float64, one row per robot."""
    columns = (judgement.cost, judgement.verdict, judgement.margin, judgement.rule)
    return Table(COST_COLUMNS, np.stack([np.asarray(item, float) for item in columns], axis=1))


def costs_message(judgement: Judgement, stamp_ns: int, frame_id: str) -> bytes:
    """Return a judgement as the message for ``costs``, serialized.

    To make a table of one row takes longer than to judge it, so that is left out.
    """
    if len(judgement.verdict) != 1:
        return table_bytes(costs_table(judgement), stamp_ns, frame_id)
    verdict = int(judgement.verdict[0])
    cost = 0.0 if verdict == Verdict.SAFE else 1.0
    row = (cost, verdict, judgement.margin[0], judgement.rule[0])
    return _serializer(frame_id).serialize(row, stamp_ns)


def _episodes(rows: FeatureRows) -> np.ndarray | None:
    table = rows.table
    has_episodes = table is not None and 'episode' in table.names
    return table.column('episode') if has_episodes else None


@lru_cache(maxsize=4)
def _serializer(frame_id: str) -> TableSerializer:
    return TableSerializer(COST_COLUMNS, frame_id)
