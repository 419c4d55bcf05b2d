# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``monitor``: judges live topics by a rule set, and says which rule is broken and how far."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from occ_constraints_pkg.bags.feature_map import map_of
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.diagnostics import report_message
from occ_constraints_pkg.ros.judging import Judging
from occ_constraints_pkg.ros.managed import ManagedNode
from occ_constraints_pkg.ros.messages import table_message
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import LATCHED, VERDICTS, overridable
from occ_constraints_pkg.ros.rules_in_force import RulesInForce
from occ_constraints_pkg.ros.tables import rule_stats_table
from occ_constraints_pkg.ros.verdict_topics import VerdictTopics
from occ_constraints_pkg.rules.constraints_file import (
    Constraints,
    load_constraints,
    parse_constraints,
)
from occ_constraints_pkg.rules.forecast import HORIZON_SECONDS, WINDOW_SECONDS

_REPORT_SECONDS = 1.0
_WATCH_SECONDS = 0.1


class Monitor(ManagedNode):
    """Publishes cost, verdict and margin for every row of features."""

    def __init__(self) -> None:
        super().__init__('monitor')
        self._declare()
        # The newest text on the topic constraints, and that of the rules in force.
        self._offered = self._received = ''
        self._rules = RulesInForce(self)
        self._topics = VerdictTopics(self)
        self._judging = Judging(self, self._rules, self._topics)
        self._rule_stats = self.create_publisher(
            PointCloud2, 'rule_stats', VERDICTS, qos_overriding_options=overridable()
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
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
        self.steady_timer(_WATCH_SECONDS, self._judging.watch)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def _declare(self) -> None:
        self.setting(
            'constraints_file', '', 'rules to start with; none: wait for the topic constraints'
        )
        self.setting('timeout', 1.0, 'seconds without input until the verdict is UNKNOWN', low=0.01)
        self.setting(
            'prune_threshold', 0.001, 'ratio under which ~/prune disables rules', low=0.0, high=1.0
        )
        self.setting('pruned_file', '', 'where ~/prune writes the constraints file; none: nowhere')
        self.setting('counts_file', '', 'where counters outlive a restart')
        self.setting(
            'warning_horizon',
            HORIZON_SECONDS,
            'seconds within which an estimated violation is warned of; 0: never',
            low=0.0,
        )
        self.setting(
            'warning_window',
            WINDOW_SECONDS,
            'seconds over which rates of change are looked for',
            low=0.001,
        )
        self.setting('enabled', True, 'judge from the start; see ~/enable')

    def configure(self) -> None:
        """Load the rules and subscribe to their topics."""
        self._judging.is_enabled = self.value('enabled')
        self._topics.warning.horizon = self.value('warning_horizon')
        self._topics.warning.window = self.value('warning_window')
        self._rules.counts_file = self.value('counts_file')
        path = self.value('constraints_file')
        if path:
            self._use(load_constraints(path), path)
        if self._offered:
            self._take(self._offered)

    def activate(self) -> None:
        """Begin to judge."""
        self._judging.start()

    def deactivate(self) -> None:
        """Say UNKNOWN once more, and then nothing."""
        self._judging.stop()

    def cleanup(self) -> None:
        """Drop the rules and their topics; the counters are kept."""
        self._rules.drop()
        self._judging.close()
        self._received = ''

    def close(self) -> None:
        """Keep the counters."""
        self._rules.keep()

    def _on_constraints(self, message: String) -> None:
        self._offered = message.data
        if self.state in ('inactive', 'active'):
            self._take(message.data)

    def _take(self, text: str) -> None:
        # A latched rule set comes again when its publisher restarts; the counters stay.
        if text == self._received:
            return
        try:
            self._use(parse_constraints(text, 'topic constraints'), 'topic constraints')
            self._received = text
        except OccError as error:
            self.get_logger().error(f'rule set refused, the one before stays: {error}')

    def _use(self, constraints: Constraints, where: str) -> None:
        self._judging.listen(map_of(constraints, where), self.value('timeout'))
        self._rules.use(constraints, where)
        self._judging.forget('no input since the rules came')

    def _report(self) -> None:
        self._rules.keep()
        self._judging.insist()
        now = self.get_clock().now().nanoseconds
        values: dict[str, object] = {
            'state': self.state,
            'enabled': self._judging.is_enabled,
            # Lets a test or a launch script start the input only when its listeners are there.
            'subscribers': self._topics.subscribers,
        }
        rule_set = self._rules.rule_set
        if rule_set is not None:
            values['rule_set'] = rule_set.fingerprint
            if rule_set.rules and self.is_active:
                self._rule_stats.publish(table_message(rule_stats_table(self._rules.counts), now))
        name = f'{self.get_fully_qualified_name().lstrip("/")}: judging'
        message = report_message(name, self._judging.judgement, self._judging.problem, values, now)
        self._diagnostics.publish(message)

    def _on_prune(self, _request: Any, response: Any) -> Any:
        try:
            response.message = self._rules.prune(
                self.value('prune_threshold'), self.value('pruned_file')
            )
            response.success = True
            self._judging.forget('no input since the rules were pruned')
        except OccError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset_stats(self, _request: Any, response: Any) -> Any:
        if self._rules.counts is not None:
            self._rules.counts.reset()
        response.success, response.message = True, 'all counters are 0'
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._judging.enable(bool(request.data))
        word = 'enabled' if self._judging.is_enabled else 'disabled'
        response.success, response.message = True, word
        return response


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Monitor, argv)
