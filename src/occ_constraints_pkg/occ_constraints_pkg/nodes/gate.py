# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``gate``: lets velocity commands pass, slows them down, or stops, by the verdicts."""

from __future__ import annotations

import math
import time
from operator import attrgetter
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped, Vector3

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.ros.clocks import with_source_time
from occ_constraints_pkg.ros.diagnostics import (
    hardware_id_of,
    read_judged_at,
    read_verdict,
    status,
    violated_rule_ids,
)
from occ_constraints_pkg.ros.messages import to_nanoseconds
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import COMMANDS, LATCHED, VERDICTS, overridable
from occ_constraints_pkg.rules.gating import GateOutput, GateSettings, SpeedGate, Timing
from occ_constraints_pkg.wording import count_of

_REPORT_SECONDS = 1.0
# Least time between two lines of the log: when the state changes, and when only the reason does.
_LOG_SECONDS, _SAME_STATE_LOG_SECONDS = 1.0, 2.0
# Of each field of GateSettings, its description as a parameter, and its range.
_SETTINGS = {
    'slow_margin': ('margin under which speed is scaled down; 0: never', 0.0, None),
    'min_speed_scale': ('part of the speed that is left at margin 0', 0.0, 1.0),
    'trigger_count': ('verdicts other than SAFE, of the last trigger_window, that stop', 1, None),
    'trigger_window': ('verdicts among which they are counted', 1, None),
    'release_count': ('safe verdicts in a row that release again', 1, None),
    'timeout': ('seconds without a verdict that stop; largest age of a verdict', 0.01, None),
}
_LEVELS = {
    'PASS': DiagnosticStatus.OK,
    'SLOW': DiagnosticStatus.WARN,
    'STOP': DiagnosticStatus.ERROR,
}


class _VerdictTopic:
    """A topic of verdicts, which exactly one monitor must publish.

    Attributes:
        topic: its full name.
        gate: decides by the verdicts on it.
        publishers: how many there are.
        rules: ids of the rules that the newest verdict names.
    """

    def __init__(self, node: Gate, topic: str, settings: GateSettings) -> None:
        self._node = node
        self.topic = node.full_name(topic)
        self.gate = SpeedGate(settings)
        self.publishers = 0
        self.rules: list[str] = []

        def on_message(message: DiagnosticArray, sent_ns: int) -> None:
            node.on_verdict(self, message, sent_ns)

        node.create_subscription(
            DiagnosticArray,
            topic,
            with_source_time(on_message),
            VERDICTS,
            qos_overriding_options=overridable(),
        )

    def judge(self, message: DiagnosticArray, sent_ns: int, now: float) -> None:
        """Take a message that was sent at wall time ``sent_ns``."""
        timing = Timing(
            to_nanoseconds(message.header.stamp),
            sent_ns,
            read_judged_at(message),
            time.time_ns(),
            self._node.ros_ns(),
        )
        self.gate.judge(*read_verdict(message), timing, now)
        self.rules = violated_rule_ids(message)

    def check_publishers(self, now: float) -> None:
        """Stop unless there is exactly one publisher."""
        self.publishers = self._node.count_publishers(self.topic)
        if self.publishers > 1:
            self.gate.trip(
                f'{self.publishers} publishers on {self.topic}; allowed is one on each of '
                'violation_topics',
                now,
            )
        elif not self.publishers:
            since = 'more' if self.gate.has_begun else 'yet'
            self.gate.trip(f'no verdict {since}: nobody publishes {self.topic}', now)


class Gate(OccNode):
    """Publishes each command scaled by the gate output; while stopped, zero at a steady rate."""

    # A flood of commands must not keep a verdict waiting.
    takes_turns = True

    def __init__(self) -> None:
        super().__init__('gate')
        stamped = self.parameter('stamped', False, 'commands are TwistStamped, not Twist')
        rate = self.parameter('rate', 20.0, 'zero commands per second while stopped', low=1.0)
        self._command_timeout = self.parameter(
            'command_timeout', 0.5, 'seconds without a command until zero is sent', low=0.01
        )
        topics = self.parameter(
            'violation_topics',
            [],
            'topics of verdicts, one for each monitor; the worst acts; none: violation',
        )
        settings = self._settings()
        self.declared()
        self._hardware_id = hardware_id_of(self.get_namespace())
        self._period, self._timeout = 1.0 / rate, settings.timeout
        self._command_type = TwistStamped if stamped else Twist
        now = self.steady_seconds()
        # When the last command came, and when the timer ran last.
        self._commanded = self._ticked = now
        self._frame = ''
        self._output = self.create_publisher(
            self._command_type,
            'cmd_vel',
            COMMANDS,
            qos_overriding_options=overridable(with_promises=True),
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._state_publisher = self.create_publisher(
            DiagnosticArray,
            '~/state',
            LATCHED,
            qos_overriding_options=overridable(with_promises=True),
        )
        self._sources = [_VerdictTopic(self, topic, settings) for topic in topics or ['violation']]
        self.create_subscription(
            self._command_type,
            'cmd_vel_in',
            self._on_command,
            COMMANDS,
            qos_overriding_options=overridable(),
        )
        names = [source.topic for source in self._sources]
        if len(set(names)) < len(names):
            raise ConfigurationError(
                f'violation_topics: got {", ".join(names)}; allowed is each topic only once'
            )
        # The present output and since when (wall time), and what was logged last and when.
        self._present = GateOutput(0.0)
        self._since_ns = time.time_ns()
        self._logged, self._log_time = GateOutput(1.0), -_SAME_STATE_LOG_SECONDS
        self._changes = 0
        self.steady_timer(self._period, self._on_timer)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def begin(self) -> None:
        """Expect the timer from now on; the start may have taken longer than it may be late."""
        self._ticked = self.steady_seconds()

    def _settings(self) -> GateSettings:
        defaults = GateSettings()
        values = {
            name: self.parameter(name, getattr(defaults, name), description, low=low, high=high)
            for name, (description, low, high) in _SETTINGS.items()
        }
        return GateSettings(**values)

    def on_verdict(self, source: _VerdictTopic, message: DiagnosticArray, sent_ns: int) -> None:
        """Take a verdict from one of the topics."""
        now = self.steady_seconds()
        was_open = self._present.scale > 0.0
        source.judge(message, sent_ns, now)
        output = self._decide(now)
        if was_open and output.scale == 0.0:
            # At once, not when the next command or the timer comes.
            self._stop()
        self._set_output(output, now)

    def _on_command(self, message: Any) -> None:
        now = self.steady_seconds()
        self._commanded = now
        output = self._decide(now)
        if self._command_type is TwistStamped:
            self._frame = message.header.frame_id
        twist = scaled_twist(
            message.twist if self._command_type is TwistStamped else message, output.scale
        )
        if twist is None:
            self.get_logger().error(
                'a command with a value that is not finite is replaced by zero',
                throttle_duration_sec=1.0,
            )
            self._stop()
            return
        self._send(twist)
        self._set_output(output, now)

    def _on_timer(self) -> None:
        """Send zero while stopped, or while nobody commands; runs on the steady clock."""
        now = self.steady_seconds()
        output = self._decide(now)
        self._ticked = now
        if output.scale == 0.0 or now - self._commanded > self._command_timeout:
            self._stop()
        self._set_output(output, now)

    def _decide(self, now: float) -> GateOutput:
        """Return what to do with commands now: what the worst of the verdicts allows."""
        # Until the timer has run again, for what is queued came in the meantime.
        was_paused = now - self._ticked > self._period + self._timeout
        for source in self._sources:
            if was_paused:
                reason = f'the gate itself was paused for more than {self._timeout:g} s'
                source.gate.trip(reason, now)
            source.check_publishers(now)
        return min((source.gate.output(now) for source in self._sources), key=attrgetter('scale'))

    def _stop(self) -> None:
        self._send(Twist())

    def _send(self, twist: Twist) -> None:
        if self._command_type is Twist:
            self._output.publish(twist)
            return
        message = TwistStamped(twist=twist)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        self._output.publish(message)

    def _set_output(self, output: GateOutput, now: float) -> None:
        """Note the present output: publish a change at once, and log it unless it flaps."""
        before, self._present = self._present, output
        if output.state != before.state:
            self._since_ns = time.time_ns()
            self._changes += 1
        is_stop_for_another_reason = output.state == 'STOP' and output != before
        if output.state != before.state or is_stop_for_another_reason:
            self._publish_state(output, now)
        self._log(output, now)

    def _log(self, output: GateOutput, now: float) -> None:
        is_new_state = output.state != self._logged.state
        if not is_new_state and (output.state != 'STOP' or output == self._logged):
            return
        if now - self._log_time < (_LOG_SECONDS if is_new_state else _SAME_STATE_LOG_SECONDS):
            return
        # Those between are not logged one by one.
        flapping = f' (changed {self._changes} times since the last line)'
        self.get_logger().info(f'{output}{flapping if self._changes > 1 else ""}')
        self._logged, self._log_time, self._changes = output, now, 0

    def _report(self) -> None:
        now = self.steady_seconds()
        self._publish_state(self._decide(now), now)
        others = self.count_publishers(self._output.topic_name) - 1
        if others > 0:
            self.get_logger().warning(
                f'{count_of(others, "other publisher")} on {self._output.topic_name}: what they '
                'command is not gated',
                throttle_duration_sec=60.0,
            )

    def _publish_state(self, output: GateOutput, now: float) -> None:
        name = self.get_fully_qualified_name().lstrip('/')
        summary = status(
            f'{name}: output',
            _LEVELS[output.state],
            str(output),
            {
                'state': output.state,
                'scale': output.scale,
                'reason': output.reason,
                'since': self._since_ns,
                'other_cmd_vel_publishers': self.count_publishers(self._output.topic_name) - 1,
            },
            self._hardware_id,
        )
        message = DiagnosticArray(status=[summary])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        message.status = [
            summary,
            *(self._source_status(name, item, now) for item in self._sources),
        ]
        self._state_publisher.publish(message)

    def _source_status(self, name: str, source: _VerdictTopic, now: float) -> DiagnosticStatus:
        output = source.gate.output(now)
        return status(
            f'{name}: verdicts on {source.topic}',
            _LEVELS[output.state],
            str(output),
            {
                'state': output.state,
                'verdict': source.gate.verdict.name,
                'rules': ', '.join(source.rules),
                'age': source.gate.age(now),
                'publishers': source.publishers,
                'safe_in_a_row': source.gate.safe_in_a_row,
            },
            self._hardware_id,
        )

    def close(self) -> None:
        """Leave the robot with a zero command."""
        self._stop()
        self.flush(self._output)


def scaled_twist(twist: Twist, scale: float) -> Twist | None:
    """Return a velocity command times ``scale``, or ``None`` if a value is not finite."""
    parts = [
        [getattr(vector, axis) * scale for axis in 'xyz']
        for vector in (twist.linear, twist.angular)
    ]
    if not all(math.isfinite(value) for part in parts for value in part):
        return None
    linear, angular = (Vector3(x=x, y=y, z=z) for x, y, z in parts)
    return Twist(linear=linear, angular=angular)


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Gate, argv)
