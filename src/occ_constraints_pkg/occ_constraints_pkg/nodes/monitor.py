# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``monitor``: judges live topics by a rule set, and says which rule is broken and how far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from occ_constraints_pkg.bags.extract import FeatureExtractor, FeatureRows
from occ_constraints_pkg.bags.feature_map import map_of
from occ_constraints_pkg.bags.fields import header_stamp_ns
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.ros.arrival import ArrivalClock
from occ_constraints_pkg.ros.diagnostics import report_message, unknown_message, violation_message
from occ_constraints_pkg.ros.mapped_topics import MappedTopics
from occ_constraints_pkg.ros.markers import verdict_marker
from occ_constraints_pkg.ros.messages import table_message
from occ_constraints_pkg.ros.process import OccNode, run_node
from occ_constraints_pkg.ros.qos import LATCHED, VERDICTS, overridable
from occ_constraints_pkg.ros.tables import costs_table, rule_stats_table
from occ_constraints_pkg.rules import Judgement
from occ_constraints_pkg.rules.constraints_file import (
    Constraints,
    load_constraints,
    parse_constraints,
)
from occ_constraints_pkg.rules.kept_counts import KeptCounts

_REPORT_SECONDS = 1.0
_DISABLED = 'the monitor is disabled'


@dataclass
class _Answer:
    """What was published for the newest input, for when that is repeated; none if unjudged."""

    rows: FeatureRows
    judgement: Judgement


class Monitor(OccNode):
    """Publishes cost, verdict and margin for every row of features."""

    def __init__(self) -> None:
        super().__init__('monitor')
        path = self.parameter(
            'constraints_file', '', 'rules to start with; none: wait for the topic constraints'
        )
        self._timeout = self.parameter(
            'timeout', 1.0, 'seconds without input until the verdict is UNKNOWN', low=0.01
        )
        self._threshold = self.parameter(
            'prune_threshold', 0.001, 'ratio under which ~/prune disables rules', low=0.0, high=1.0
        )
        self._pruned_file = self.parameter(
            'pruned_file', '', 'where ~/prune writes the constraints file; none: nowhere'
        )
        self._counts_file = self.parameter('counts_file', '', 'where counters outlive a restart')
        self._enabled = self.parameter('enabled', True, 'judge from the start; see ~/enable')

        self._constraints: Constraints | None = None
        self._received: str | None = None
        self._counts: KeptCounts | None = None
        self._extractor: FeatureExtractor | None = None
        self._topics: MappedTopics | None = None
        self._answer: _Answer | None = None
        # Why nothing is judged; empty while the newest input is.
        self._problem = 'no rule set yet'
        self._stamp_ns = 0
        self._arrival = ArrivalClock(self, self._timeout)
        self._heard, self._is_stale = self.steady_seconds(), False

        self._cost = self._publisher(Float64, 'cost')
        self._costs = self._publisher(PointCloud2, 'costs')
        self._violation = self._publisher(DiagnosticArray, 'violation')
        self._rule_stats = self._publisher(PointCloud2, 'rule_stats')
        self._markers = self._publisher(MarkerArray, 'markers')
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        if path:
            self._use(load_constraints(path), path)
        self.create_subscription(
            String,
            'constraints',
            self._on_constraints,
            LATCHED,
            qos_overriding_options=overridable(),
        )
        self.create_service(Trigger, '~/prune', self._on_prune)
        self.create_service(Trigger, '~/reset_stats', self._on_reset_stats)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self.steady_timer(min(self._timeout / 2, 0.1), self._watch)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def _publisher(self, kind: Any, topic: str) -> Any:
        return self.create_publisher(kind, topic, VERDICTS, qos_overriding_options=overridable())

    def _on_constraints(self, message: String) -> None:
        # A latched rule set comes again when its publisher restarts; the counters stay.
        if message.data == self._received:
            return
        try:
            self._use(parse_constraints(message.data, 'topic constraints'), 'topic constraints')
            self._received = message.data
        except OccError as error:
            self.get_logger().error(f'rule set refused, the one before stays: {error}')

    def _use(self, constraints: Constraints, where: str) -> None:
        feature_map, rule_set = map_of(constraints, where), constraints.rule_set
        # The same topics are kept, so that no message is missed when only the rules change.
        if self._extractor is None or self._extractor.feature_map != feature_map:
            topics = MappedTopics(self, feature_map, self._on_input)
            if self._topics is not None:
                self._topics.close()
            self._topics, self._extractor = topics, FeatureExtractor(feature_map)
            self._heard = self.steady_seconds()
        self._constraints, self._counts = constraints, KeptCounts(rule_set, self._counts_file)
        self._answer, self._problem = None, 'no input since the rules came'
        self.get_logger().info(
            f'{len(rule_set.order)} enabled rules from {where}, rule set {rule_set.fingerprint}'
            + (f'; counters go on from {self._counts_file}' if self._counts.resumed else '')
        )
        if not len(rule_set.order):
            self.get_logger().warning(f'{where} enables no rule, so nothing will be a violation')

    def _on_input(self, topic: str, message: Any) -> None:
        now = self._arrival.now_ns()
        try:
            rows = self._extractor.push(topic, message, now)
            if rows is not None and not len(rows.values):
                raise OccError(f'topic {topic!r} brought a table without rows')
        except OccError as error:
            self._heard, self._is_stale = self.steady_seconds(), False
            self.get_logger().error(f'input refused: {error}', throttle_duration_sec=1.0)
            self._answer = None
            self._say_unknown(str(error), header_stamp_ns(message) or now)
            return
        if rows is None:
            return
        if rows.repeat and self._answer is not None:
            # Nothing new: in lock-step somebody may wait for the answer, but a sensor that only
            # repeats itself must not pass for a live one.
            self._costs.publish(table_message(costs_table(self._answer.judgement), rows.stamp_ns))
            if not self._is_stale:
                self._publish_verdict(self._answer)
            return
        self._heard, self._is_stale = self.steady_seconds(), False
        problem = self._arrival.problem() if self._enabled else _DISABLED
        if problem:
            self._answer = None
            self._say_unknown(problem, rows.stamp_ns)
            return
        judgement = self._constraints.rule_set.judge(rows.values)
        self._counts.add_stamped(judgement, rows.stamp_ns)
        self._answer = answer = _Answer(rows, judgement)
        self._costs.publish(table_message(costs_table(judgement), rows.stamp_ns))
        self._publish_verdict(answer)

    def _publish_verdict(self, answer: _Answer) -> None:
        judgement, stamp = answer.judgement, answer.rows.stamp_ns
        self._problem, self._stamp_ns = '', stamp
        self._cost.publish(Float64(data=float(judgement.cost[0])))
        rule_set, values = self._constraints.rule_set, answer.rows.values
        if self._violation.get_subscription_count():
            self._violation.publish(violation_message(rule_set, values, judgement, stamp))
        if self._markers.get_subscription_count():
            self._markers.publish(verdict_marker(rule_set, judgement, stamp))

    def _watch(self) -> None:
        """Turn to UNKNOWN when the input falls silent; runs on the steady clock."""
        if self._constraints is None or self._is_stale:
            return
        if self.steady_seconds() - self._heard > self._timeout:
            self._is_stale = True
            self._say_stale()

    def _say_stale(self) -> None:
        reason = self._topics.problem() or f'no new input for {self._timeout:g} s'
        self._say_unknown(reason, self._stamp_ns)

    def _say_unknown(self, reason: str, stamp_ns: int) -> None:
        self._problem, self._stamp_ns = reason, stamp_ns
        self._cost.publish(Float64(data=1.0))
        self._violation.publish(unknown_message(reason, stamp_ns))

    def close(self) -> None:
        """Keep the counters."""
        if self._counts is not None:
            self._counts.keep()

    def _report(self) -> None:
        self.close()
        if self._is_stale:
            # Again, for whoever has come since.
            self._say_stale()
        now = self.get_clock().now().nanoseconds
        values: dict[str, object] = {
            'enabled': self._enabled,
            # Lets a test or a launch script start the input only when its listeners are there.
            'subscribers': min(p.get_subscription_count() for p in (self._costs, self._violation)),
        }
        if self._constraints is not None:
            values['rule_set'] = self._constraints.rule_set.fingerprint
            if self._constraints.rule_set.rules:
                self._rule_stats.publish(table_message(rule_stats_table(self._counts), now))
        name = f'{self.get_fully_qualified_name().lstrip("/")}: judging'
        judgement = None if self._problem else self._answer.judgement
        self._diagnostics.publish(report_message(name, judgement, self._problem, values, now))

    def _on_prune(self, _request: Any, response: Any) -> Any:
        try:
            if self._constraints is None:
                raise OccError('there is no rule set yet')
            result = prune(self._constraints.rule_set.with_counts(self._counts), self._threshold)
            pruned = self._constraints.with_rule_set(result.rule_set)
            response.success, response.message = True, result.words
            if self._pruned_file:
                pruned.save(self._pruned_file)
                response.message += f'; written to {self._pruned_file}'
            self._constraints, self._counts = pruned, KeptCounts(result.rule_set, self._counts_file)
            self._answer, self._problem = None, 'no input since the rules were pruned'
        except OccError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset_stats(self, _request: Any, response: Any) -> Any:
        if self._counts is not None:
            self._counts.reset()
        response.success, response.message = True, 'all counters are 0'
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._enabled = bool(request.data)
        if not self._enabled:
            self._answer = None
            self._say_unknown(_DISABLED, self._stamp_ns)
        response.success, response.message = True, 'enabled' if self._enabled else 'disabled'
        return response


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Monitor, argv)
