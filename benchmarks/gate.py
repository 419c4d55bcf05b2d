# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Does a gate ever let a command through that no fresh verdict allows?

A monitor and a gate run as processes of their own. In each interleaving, once the robot drives,
they are stopped, continued, killed and started again at random times, while obstacles come and go
and the sensor falls silent. An oracle in this process reads when each verdict and each command was
sent, by the middleware's clock, and judges every command that is not zero.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.ros.diagnostics import read_verdict
from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.ros.qos import COMMANDS, VERDICTS
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.gating import GateSettings
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Range

_PERIOD = 0.02
_FAULT_SECONDS = 1.2
_START_SECONDS = 60.0
# How much later than allowed a command may be: the machine is not a real-time one.
_GRACE = 0.1
_MOST_ACTIONS = 4
_ACTIONS = (
    'stop monitor',
    'stop gate',
    'continue monitor',
    'continue gate',
    'kill monitor',
    'kill gate',
    'start monitor',
    'start gate',
    'obstacle',
    'no obstacle',
    'sensor silent',
)
_FAR, _NEAR = 2.0, 0.2
_FEATURE_MAP = {
    'schema_version': 1,
    'pace': 'distance',
    'max_age': 0.5,
    'features': [{'name': 'distance', 'topic': 'distance', 'field': 'range', 'unit': 'm'}],
}


class Oracle:
    """Judges commands by the verdicts before them; all times are of sending, in seconds.

    Attributes:
        settings: of the gate.
        verdicts: time and verdict of each, in order.
        commands: time of each command that was not zero.
        begun: times from which the gate may know nothing of earlier verdicts: it was started, or
            continued after it had stood still for longer than its timeout.
    """

    def __init__(self, settings: GateSettings) -> None:
        self.settings = settings
        self.verdicts: list[tuple[float, Verdict]] = []
        self.commands: list[float] = []
        self.begun: list[float] = []

    def breaches(self) -> list[str]:
        """Say for each command that was not zero, and should have been, why."""
        return [reason for sent in self.commands if (reason := self._breach(sent))]

    def _breach(self, sent: float) -> str:
        limit = self.settings.timeout + _GRACE
        before = [item for item in self.verdicts if item[0] <= sent]
        if not before or sent - before[-1][0] > limit:
            return 'no verdict'
        settled = [verdict for at, verdict in before if at <= sent - _GRACE]
        count = self.settings.trigger_count
        if len(settled) >= count and set(settled[-count:]) == {Verdict.VIOLATED}:
            return 'VIOLATED'
        if self._is_released(before, sent, limit):
            # Also after an UNKNOWN: at 50 Hz, five safe verdicts take no longer than the grace.
            return ''
        return 'UNKNOWN' if settled and settled[-1] is Verdict.UNKNOWN else 'not released'

    def _is_released(self, before: list[tuple[float, Verdict]], sent: float, limit: float) -> bool:
        """Whether enough safe verdicts have come in a row since the last stop."""
        since = max((at for at in self.begun if at <= sent - _GRACE), default=0.0)
        # A gate that is started takes no earlier verdict; one that is continued takes young ones.
        row = 0
        for index, (at, verdict) in enumerate(before):
            is_gap = index > 0 and at - before[index - 1][0] > limit
            if is_gap or at < since - limit or verdict is Verdict.UNKNOWN:
                row = 0
            row += verdict is Verdict.SAFE
        return row >= self.settings.release_count


class _Pair:
    """A monitor and a gate in a namespace of their own, and the traffic to them."""

    def __init__(self, context: Context, folder: Path, domain: int, number: int) -> None:
        self._folder, self._domain = folder, domain
        self._namespace = f'/soak_{number}'
        self.node = Node('soak', namespace=self._namespace, context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self.distance: float | None = _FAR
        self.oracle = Oracle(GateSettings())
        self._sensor = self.node.create_publisher(Range, 'distance', 10)
        self._command = self.node.create_publisher(Twist, 'cmd_vel_in', COMMANDS)

        def on_verdict(message: DiagnosticArray, info: dict[str, Any]) -> None:
            verdict = read_verdict(message)[0]
            self.oracle.verdicts.append((info['source_timestamp'] * 1e-9, verdict))

        def on_output(message: Twist, info: dict[str, Any]) -> None:
            if message.linear.x or message.angular.z:
                self.oracle.commands.append(info['source_timestamp'] * 1e-9)

        self.node.create_subscription(DiagnosticArray, 'violation', on_verdict, VERDICTS)
        self.node.create_subscription(Twist, 'cmd_vel', on_output, VERDICTS)
        self._processes: dict[str, NodeProcess] = {}
        self._stopped: dict[str, float] = {}
        self.monitor_was_killed = False
        for name in ('monitor', 'gate'):
            self.start(name)

    def start(self, name: str) -> None:
        """Start a node, unless it runs."""
        if name in self._processes and self._processes[name].is_running:
            return
        rules = {'constraints_file': self._folder / 'rules.yaml'} if name == 'monitor' else {}
        if name == 'gate':
            self.oracle.begun.append(time.time())
        self._stopped.pop(name, None)
        self._processes[name] = NodeProcess(
            name,
            rules,
            self._folder / self._namespace.strip('/'),
            self._domain,
            namespace=self._namespace,
        )

    def stop(self, name: str) -> None:
        """Stop a process as a debugger does; it may be continued."""
        if self._processes[name].is_running and name not in self._stopped:
            self._processes[name].send_signal(signal.SIGSTOP)
            self._stopped[name] = time.time()

    def go_on(self, name: str) -> None:
        """Continue a process that was stopped."""
        since = self._stopped.pop(name, None)
        if since is not None:
            now = time.time()
            if name == 'gate' and now - since > self.oracle.settings.timeout + 2 * _GRACE:
                self.oracle.begun.append(now)
            self._processes[name].send_signal(signal.SIGCONT)

    def kill(self, name: str) -> None:
        """Kill a process."""
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes[name].join()
        self._stopped.pop(name, None)
        self.monitor_was_killed |= name == 'monitor'

    def act(self, action: str) -> None:
        """Carry out one of the actions."""
        verb, _, what = action.partition(' ')
        if what in self._processes:
            {
                'stop': self.stop,
                'continue': self.go_on,
                'kill': self.kill,
                'start': self.start,
            }[verb](what)
        else:
            self.distance = {'obstacle': _NEAR, 'no obstacle': _FAR}.get(action)

    def run(self, seconds: float, is_enough: Callable[[], bool] = lambda: False) -> bool:
        """Send inputs and commands for a while; return whether ``is_enough`` became true."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.distance is not None:
                message = Range(range=self.distance, min_range=0.1, max_range=10.0)
                message.header.stamp = to_time(time.time_ns())
                self._sensor.publish(message)
            command = Twist()
            command.linear.x = 1.0
            self._command.publish(command)
            until = time.monotonic() + _PERIOD
            while (left := until - time.monotonic()) > 0:
                self._executor.spin_once(left)
            if is_enough():
                return True
        return False

    def recover(self) -> None:
        """Undo all faults and wait until the robot drives again.

        Raises:
            OccError: it does not.
        """
        self.distance = _FAR
        for name in self._processes:
            self.go_on(name)
            self.start(name)
        begin = time.time()
        if not self.run(
            _START_SECONDS,
            lambda: bool(self.oracle.commands) and self.oracle.commands[-1] > begin,
        ):
            raise OccError(
                f'{self._namespace}: the robot did not drive within {_START_SECONDS:g} s without a '
                f'fault; the last line of the gate: {self._processes["gate"].last_words()}'
            )

    def close(self) -> None:
        """End the processes."""
        for process in self._processes.values():
            process.send_signal(signal.SIGKILL)
            process.join()
        self._executor.shutdown()
        self.node.destroy_node()


def run(seconds: float = 300.0) -> dict[str, Any]:
    """Try random interleavings.

    Args:
        seconds: for how long; each takes two to three.
    """
    seed = time.time_ns() % 2**32
    rng = np.random.default_rng(seed)
    context = Context()
    count, commands, verdicts = 0, 0, 0
    breaches: list[str] = []
    done = dict.fromkeys(_ACTIONS, 0)
    with private_domain() as domain, tempfile.TemporaryDirectory() as directory:
        # The middleware of this process reads it when it starts.
        os.environ.update(environment(domain))
        folder = Path(directory)
        _constraints().save(folder / 'rules.yaml')
        context.init(domain_id=domain)
        pair = None
        try:
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                if pair is None:
                    pair = _Pair(context, folder, domain, count)
                pair.recover()
                count += 1
                actions = rng.choice(_ACTIONS, size=rng.integers(1, _MOST_ACTIONS + 1)).tolist()
                for action in actions:
                    pair.act(action)
                    done[action] += 1
                    pair.run(rng.uniform(0.0, 2.0 * _FAULT_SECONDS / len(actions)))
                found = pair.oracle.breaches()
                breaches += [f'{", ".join(actions)}: {reason}' for reason in found]
                commands += len(pair.oracle.commands)
                verdicts += len(pair.oracle.verdicts)
                pair.oracle.commands.clear()
                del pair.oracle.verdicts[:-1000]
                # A killed process is listed as a publisher for some 20 s more, so that the gate
                # keeps shut; the next interleaving need not wait for it.
                if pair.monitor_was_killed:
                    pair.close()
                    pair = None
        finally:
            if pair is not None:
                pair.close()
            context.try_shutdown()
    return {
        'metrics': {
            'interleavings': float(count),
            'commands_not_zero': float(commands),
            'breaches': float(len(breaches)),
        },
        'peers': {},
        'settings': {
            'seconds': seconds,
            'seed': seed,
            'grace_s': _GRACE,
            'verdicts': verdicts,
            'actions': done,
            'breaches': breaches[:20],
        },
    }


def _constraints() -> Constraints:
    space = FeatureSpace((Feature('distance', 'm'),))
    rules = (Rule('R0', (Literal(0, '<', 0.5),)),)
    feature_map = FeatureMap.from_document(_FEATURE_MAP, 'the soak')
    return Constraints(RuleSet(space, rules, np.array([[0.5, 4.0]])), feature_map.to_document())
