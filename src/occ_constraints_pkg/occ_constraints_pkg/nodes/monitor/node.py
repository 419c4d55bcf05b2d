# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``monitor``: judges live topics by rules, and says which is violated and how far."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.timer import Timer
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, map_of
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS
from occ_constraints_pkg.files import CONSTRAINTS, check_outputs
from occ_constraints_pkg.nodes.monitor.inputs import TimeLimits
from occ_constraints_pkg.nodes.monitor.outputs import Outputs
from occ_constraints_pkg.nodes.monitor.pipeline import EarlyWarning, Pipeline
from occ_constraints_pkg.nodes.monitor.rules_in_force import RulesInForce
from occ_constraints_pkg.nodes.monitor.rules_reader import RulesReader, check_size
from occ_constraints_pkg.ros.lifecycle import ManagedNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import LATCHED, overridable
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.rules.edits import RuleEdits
from occ_constraints_pkg.rules.forecast import HORIZON_SECONDS, WINDOW_SECONDS
from occ_constraints_pkg.rules.gating import SteadyVerdict

_REPORT_SECONDS = 1.0
_TIMEOUT_CHECK_SECONDS = 0.1
# How often it is checked whether the rules that came are read.
_READ_SECONDS = 0.02
_ORIGIN = 'topic constraints'
_DEBOUNCE = {
    'trigger_count': 'verdicts other than SAFE, of the last trigger_window, that people are told',
    'trigger_window': 'verdicts among which they are counted',
    'release_count': 'safe verdicts in a row until people are shown SAFE again',
}
# Parameters that change the rules, in the order that RuleEdits takes them.
_EDITS = ('disabled_rules', 'enabled_rules', 'moved_bounds')


class Monitor(ManagedNode):
    """Parameters, lifecycle and services; what is done with inputs is in `Pipeline.process`."""

    subscribes_later = True

    def __init__(self) -> None:
        super().__init__('monitor')
        self._declare()
        self.declared()
        # The newest text on the topic constraints, and that of the rules in force.
        self._offered: str | None = None
        self._received: str | None = None
        self._reader = RulesReader(_ORIGIN)
        self._reading: Timer | None = None
        self._rules = RulesInForce(self)
        self._outputs = Outputs(self)
        self._pipeline = Pipeline(self, self._rules, self._outputs)
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
        self.add_on_set_parameters_callback(self._check_edits)
        self.add_post_set_parameters_callback(self._on_edits)
        self.steady_timer(_TIMEOUT_CHECK_SECONDS, self._pipeline.check_timeout)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def _declare(self) -> None:
        self.setting(
            'constraints_file', '', 'rules to start with; none: wait for the topic constraints'
        )
        self.setting('timeout', 1.0, 'seconds without input until the verdict is UNKNOWN', low=0.01)
        self.setting(
            'max_lead', 1.0, 'seconds that a stamp may be ahead of the clock; 0: any', low=0.0
        )
        self.setting(
            'max_lag',
            MAX_LAG_SECONDS,
            'seconds that a message may come late until the verdict is UNKNOWN; 0: any',
            low=0.0,
        )
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
            'seconds over which rates of change are estimated',
            low=0.001,
        )
        self.setting(
            'frozen_after',
            10,
            'seconds without any change after which a value is told as frozen; 0: never',
            low=0,
        )
        for name, description in _DEBOUNCE.items():
            self.setting(name, 1, description, low=1)
        self.live_setting('disabled_rules', [], 'ids of rules to disable')
        self.live_setting('enabled_rules', [], 'ids of rules to enable though the file does not')
        self.live_setting('moved_bounds', [], "other bounds, each like 'RULE: FEATURE > 0.9'")
        self.setting('enabled', True, 'judge from the start; see ~/enable')

    def configure(self) -> None:
        """Load the rules and subscribe to their topics."""
        self._pipeline.configure(
            SteadyVerdict(*(self.value(name) for name in _DEBOUNCE)),
            EarlyWarning(self.value('warning_horizon'), self.value('warning_window')),
            is_enabled=self.value('enabled'),
        )
        self._rules.counts_file = self.value('counts_file')
        self._rules.edits = self._edits()
        path = self.value('constraints_file')
        if self.value('pruned_file'):
            inputs = [name for name in (path, self.value('counts_file')) if name]
            check_outputs({self.value('pruned_file'): CONSTRAINTS}, inputs)
        if path:
            constraints = load_constraints(path)
            self._use(constraints, map_of(constraints, path), path, strict=True)
        if self._offered is not None:
            self._read(self._offered)

    def activate(self) -> None:
        """Begin to judge."""
        self._pipeline.activate()
        if self._rules.rule_set is None:
            self.get_logger().info(f'waiting for rules on {self.full_name("constraints")}')

    def deactivate(self) -> None:
        """Publish UNKNOWN once more, and then nothing."""
        self._pipeline.deactivate()

    def cleanup(self) -> None:
        """Drop the rules and their topics; the counters are kept."""
        self._rules.clear()
        self._pipeline.unsubscribe()
        self._reader.clear()
        self._received = None

    def close(self) -> None:
        """Keep the counters."""
        self._reader.close()
        self._rules.save_counts()

    def _on_constraints(self, message: String) -> None:
        self._offered = message.data
        if self.state in ('inactive', 'active'):
            self._read(message.data)

    def _read(self, text: str) -> None:
        # A latched rule set comes again when its publisher restarts; the counters stay.
        if text == self._received:
            self._reader.clear()
            return
        try:
            check_size(text, _ORIGIN)
        except OccError as error:
            self._reader.clear()
            self._refuse(error)
            return
        self._reader.offer(text)
        if self._reading is None:
            self._reading = self.steady_timer(_READ_SECONDS, self._use_if_read)

    def _use_if_read(self) -> None:
        """Use the rules that came once they are read."""
        answer = self._reader.poll()
        if not self._reader.is_busy:
            self.destroy_timer(self._reading)
            self._reading = None
        if answer is None:
            return
        try:
            if answer.problem:
                raise ConfigurationError(answer.problem)
            self._use(answer.constraints, answer.feature_map, _ORIGIN)
            self._received = answer.text
        # Nothing that others send may end the node, whatever is wrong with it.
        except Exception as error:
            self._refuse(error)

    def _refuse(self, error: Exception) -> None:
        kind = '' if isinstance(error, OccError | OSError) else f'{type(error).__name__} '
        self.get_logger().error(f'rule set refused, the one before stays: {kind}{error}')

    def _use(
        self, constraints: Constraints, feature_map: FeatureMap, where: str, *, strict: bool = False
    ) -> None:
        # All that may fail comes first; then rules and topics change together.
        rules = self._rules.prepare(constraints, where, strict=strict)
        self._rules.save_counts()
        names = ('timeout', 'max_lead', 'max_lag', 'frozen_after')
        limits = (self.value(name) for name in names)
        self._pipeline.subscribe(feature_map, TimeLimits(*limits))
        self._rules.use(rules)
        self._pipeline.reset('no input since the rules came')

    def _edits(self, changed: Sequence[Parameter] = ()) -> RuleEdits:
        """Return the edits that the parameters ask for, once some of them have changed."""
        values = {name: self.value(name) for name in _EDITS}
        for item in changed:
            if item.name in values:
                values[item.name] = [text for text in item.value if text]
        return RuleEdits.parse(*values.values())

    def _check_edits(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            if _is_edit(parameters):
                self._rules.check(self._edits(parameters))
        except OccError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_edits(self, parameters: list[Parameter]) -> None:
        if _is_edit(parameters):
            self._rules.edit(self._edits())
            self._pipeline.reset('no input since the rules were edited')

    def _report(self) -> None:
        self._rules.save_counts()
        self._pipeline.republish_timeout()
        now = self.get_clock().now().nanoseconds
        values: dict[str, object] = {
            'state': self.state,
            'enabled': self._pipeline.is_enabled,
            # Lets a test or a launch script start the input only when its listeners are there.
            'subscribers': self._outputs.subscribers,
        }
        rule_set = self._rules.rule_set
        if rule_set is not None:
            values['rule_set'] = rule_set.fingerprint
            if rule_set.rules and self.is_active:
                self._outputs.publish_rule_stats(self._rules.counts, now)
        doubts = self._pipeline.doubts()
        self._outputs.publish_report(
            self._pipeline.state, self._pipeline.problem, values, doubts, now
        )

    def _on_prune(self, _request: Any, response: Any) -> Any:
        try:
            response.message = self._rules.prune(
                self.value('prune_threshold'), self.value('pruned_file')
            )
            response.success = True
            self._pipeline.reset('no input since the rules were pruned')
        except OccError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_reset_stats(self, _request: Any, response: Any) -> Any:
        if self._rules.counts is not None:
            self._rules.counts.reset()
        response.success, response.message = True, 'all counters are 0'
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._pipeline.enable(bool(request.data))
        word = 'enabled' if self._pipeline.is_enabled else 'disabled'
        response.success, response.message = True, word
        return response


def _is_edit(parameters: Sequence[Parameter]) -> bool:
    return any(item.name in _EDITS for item in parameters)


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Monitor, argv)
