# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``gate``: lets velocity commands pass, slows them down, or stops, by the verdicts."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped

from occ_constraints_pkg.ros.diagnostics import read_verdict, status
from occ_constraints_pkg.ros.messages import scaled_twist
from occ_constraints_pkg.ros.process import OccNode, run_node
from occ_constraints_pkg.ros.qos import COMMANDS, VERDICTS, overridable
from occ_constraints_pkg.rules.gating import GateSettings, Passage, SpeedGate

_REPORT_SECONDS = 1.0


class Gate(OccNode):
    """Publishes each command scaled; while stopped, zero at a steady rate."""

    def __init__(self) -> None:
        super().__init__('gate')
        stamped = self.parameter('stamped', False, 'commands are TwistStamped, not Twist')
        rate = self.parameter('rate', 20.0, 'zero commands per second while stopped', low=1.0)
        self._command_timeout = self.parameter(
            'command_timeout', 0.5, 'seconds without a command until zero is sent', low=0.01
        )
        defaults = GateSettings()
        self._gate = SpeedGate(
            GateSettings(
                slow_margin=self.parameter(
                    'slow_margin',
                    defaults.slow_margin,
                    'margin under which speed is scaled down; 0: never',
                    low=0.0,
                ),
                slowest=self.parameter(
                    'slowest',
                    defaults.slowest,
                    'part of the speed that is left at margin 0',
                    low=0.0,
                    high=1.0,
                ),
                trigger_count=self.parameter(
                    'trigger_count',
                    defaults.trigger_count,
                    'violated verdicts of the last trigger_window that stop',
                    low=1,
                ),
                trigger_window=self.parameter(
                    'trigger_window',
                    defaults.trigger_window,
                    'verdicts among which they are counted',
                    low=1,
                ),
                release_count=self.parameter(
                    'release_count',
                    defaults.release_count,
                    'safe verdicts in a row that let go again',
                    low=1,
                ),
                timeout=self.parameter(
                    'timeout', defaults.timeout, 'seconds without a verdict that stop', low=0.01
                ),
            )
        )
        self.declared()
        self._kind = TwistStamped if stamped else Twist
        self._commanded = self.steady_seconds()
        self._frame = ''
        self._said: tuple[bytes, str] | None = None
        self._output = self.create_publisher(
            self._kind, 'cmd_vel', COMMANDS, qos_overriding_options=overridable()
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        for kind, topic, callback, qos in (
            (self._kind, 'cmd_vel_in', self._on_command, COMMANDS),
            (DiagnosticArray, 'violation', self._on_violation, VERDICTS),
        ):
            self.create_subscription(
                kind, topic, callback, qos, qos_overriding_options=overridable()
            )
        self.steady_timer(1.0 / rate, self._hold)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def _on_command(self, message: Any) -> None:
        now = self.steady_seconds()
        self._commanded = now
        passage = self._gate.passage(now)
        if self._kind is TwistStamped:
            self._frame = message.header.frame_id
        twist = scaled_twist(
            message.twist if self._kind is TwistStamped else message, passage.scale
        )
        if twist is None:
            self.get_logger().error(
                'a command with a value that is not finite is replaced by zero',
                throttle_duration_sec=1.0,
            )
            self._stop()
            return
        self._send(twist)
        self._tell(passage)

    def _on_violation(self, message: DiagnosticArray) -> None:
        was_open = self._gate.passage(self.steady_seconds()).scale > 0.0
        self._gate.judge(*read_verdict(message), self.steady_seconds())
        passage = self._gate.passage(self.steady_seconds())
        if was_open and passage.scale == 0.0:
            # At once, not when the next command or the timer comes.
            self._stop()
        self._tell(passage)

    def _hold(self) -> None:
        """Send zero while stopped, or while nobody commands; runs on the steady clock."""
        now = self.steady_seconds()
        passage = self._gate.passage(now)
        if passage.scale == 0.0 or now - self._commanded > self._command_timeout:
            self._stop()
        self._tell(passage)

    def _stop(self) -> None:
        self._send(Twist())

    def _send(self, twist: Twist) -> None:
        if self._kind is Twist:
            self._output.publish(twist)
            return
        message = TwistStamped(twist=twist)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        self._output.publish(message)

    def _tell(self, passage: Passage) -> None:
        """Report a change of state at once, to the log and to /diagnostics."""
        level = _level(passage)
        if self._said is not None and self._said[0] == level:
            self._said = level, _words(passage)
            return
        self._said = level, _words(passage)
        self.get_logger().info(self._said[1])
        self._report()

    def _report(self) -> None:
        passage = self._gate.passage(self.steady_seconds())
        name = f'{self.get_fully_qualified_name().lstrip("/")}: passage'
        message = DiagnosticArray(
            status=[status(name, _level(passage), _words(passage), {'scale': passage.scale})]
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def close(self) -> None:
        """Leave the robot with a zero command."""
        self._stop()
        self.let_leave(self._output)


def _level(passage: Passage) -> bytes:
    if passage.scale == 0.0:
        return DiagnosticStatus.ERROR
    return DiagnosticStatus.WARN if passage.scale < 1.0 else DiagnosticStatus.OK


def _words(passage: Passage) -> str:
    if passage.scale == 0.0:
        return f'STOP: {passage.reason}'
    return f'SLOW, {passage.scale:.0%}: {passage.reason}' if passage.scale < 1.0 else 'PASS'


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Gate, argv)
