# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page's server while twenty monitors publish twenty verdicts a second each to it.

One process publishes for all monitors, each as a node of its own with what a monitor publishes. The
page is a client that reads the stream. The peer is a bare rclpy node that subscribes to the same
verdicts and deserializes each.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.diagnostics import violation_message
from occ_constraints_pkg.ros.qos import LATCHED, STEPS, VERDICTS
from occ_constraints_pkg.ros.tables import table_bytes
from occ_constraints_pkg.rules import RuleSet
from occ_constraints_pkg.rules.listing import rules_in_force_text
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from benchmarks.monitor import processor_seconds, resident_bytes
from benchmarks.synthetic import learned_rules, samples_of_a_car

_ROBOTS, _RATE = 20, 20.0
_START_SECONDS, _WARM_SECONDS = 60.0, 10.0
_TURNS = 3
# So many times a robot's verdict is changed, to see how soon the page is told.
_CHANGES = 20


class _Monitor:
    """Publishes what a monitor does, of rows that are judged on the spot."""

    def __init__(self, number: int, context: Context, rule_set: RuleSet, rows: np.ndarray) -> None:
        self.name = f'/robot{number}'
        self._rule_set, self._rows = rule_set, rows
        self._safe = rows[rule_set.judge(rows).cost == 0.0]
        self.node = Node('monitor', context=context, namespace=self.name, enable_rosout=False,
                         start_parameter_services=False)  # fmt: skip
        self._violation = self.node.create_publisher(DiagnosticArray, 'violation', VERDICTS)
        self._features = self.node.create_publisher(PointCloud2, 'features', STEPS)
        self._rules = self.node.create_publisher(String, 'rules', LATCHED)
        self._rules.publish(String(data=rules_in_force_text(rule_set)))

    def publish(self, row: np.ndarray) -> None:
        """Publish a verdict on one row, (k,)."""
        now, rows = time.time_ns(), row[None]
        judgement = self._rule_set.judge(rows)
        self._violation.publish(violation_message(self._rule_set, rows, judgement, now))
        table = Table(self._rule_set.space.names, rows)
        self._features.publish(table_bytes(table, now, self._rule_set.fingerprint))

    def step(self, number: int) -> None:
        """Publish a verdict that is SAFE."""
        self.publish(self._safe[number % len(self._safe)])


class _Reader(threading.Thread):
    """Reads the stream as a page does."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.bytes, self.standings = 0, dict[str, str]()
        self.changed = threading.Condition()
        connection = HTTPConnection('127.0.0.1', port, timeout=30.0)
        connection.request('GET', '/stream')
        self._answer = connection.getresponse()

    def run(self) -> None:
        kind = ''
        for line in self._answer:
            self.bytes += len(line)
            if line.startswith(b'event: '):
                kind = line[7:-1].decode()
            elif kind == 'now' and line.startswith(b'data: '):
                robots = json.loads(line[6:])['robots']
                with self.changed:
                    self.standings = {robot['name']: robot['standing'] for robot in robots}
                    self.changed.notify_all()


def run(seconds: float = 30.0) -> dict[str, Any]:
    """Measure processor time and memory of the page's server and of its peer by turns.

    Args:
        seconds: measured time of each.
    """
    rng = np.random.default_rng(0)
    rule_set = learned_rules(rng)
    rows = samples_of_a_car(rng, 2000)
    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ.update(environment(domain))
        context = Context()
        context.init(domain_id=domain)
        stack.callback(context.try_shutdown)
        monitors = [_Monitor(n, context, rule_set, rows) for n in range(1, _ROBOTS + 1)]
        page = NodeProcess('dashboard', {'port': 0}, folder, domain)
        stack.callback(page.stop)
        peer = NodeProcess(
            'listener', {'robots': _ROBOTS}, folder, domain, module='benchmarks.listener'
        )
        stack.callback(peer.stop)
        sent = 0

        def send_for(duration: float, done: Callable[[], bool] = lambda: False) -> None:
            nonlocal sent
            begin, first = time.monotonic(), sent
            while (now := time.monotonic()) - begin < duration and not done():
                for number, monitor in enumerate(monitors):
                    monitor.step(sent + 97 * number)
                sent += 1
                time.sleep(max(0.0, begin + (sent - first) / _RATE - now))

        send_for(_START_SECONDS, lambda: 'the page is at' in page.log.read_text())
        address = page.log.read_text().partition('http://127.0.0.1:')[2]
        if not address:
            raise OccError(f'the page was not served within {_START_SECONDS:g} s')
        reader = _Reader(int(address.partition('/')[0]))
        reader.start()
        send_for(_START_SECONDS, lambda: list(reader.standings.values()).count('SAFE') == _ROBOTS)
        if list(reader.standings.values()).count('SAFE') != _ROBOTS:
            raise OccError(f'not all robots were SAFE on the page: {reader.standings}')
        send_for(_WARM_SECONDS)
        shares: dict[int, list[float]] = {page.pid: [], peer.pid: []}
        begin_bytes, rounds, took_all = reader.bytes, sent, 0.0
        for _ in range(_TURNS):
            before = {pid: processor_seconds(pid) for pid in shares}
            begin = time.monotonic()
            send_for(seconds / _TURNS)
            took = time.monotonic() - begin
            took_all += took
            for pid, values in shares.items():
                values.append(100.0 * (processor_seconds(pid) - before[pid]) / took)
        kilobytes, rate = (reader.bytes - begin_bytes) / 1e3, (sent - rounds) / took_all
        delays = [_delay(monitors[0], rows, rule_set, reader, send_for) for _ in range(_CHANGES)]
        memory = [resident_bytes(pid) / 1e6 for pid in shares]
    ours, bare = (float(np.median(values)) for values in shares.values())
    return {
        'metrics': {
            'processor_20_robots_20hz_percent': ours,
            'memory_mb': memory[0],
            'stream_kb_per_s': kilobytes / took_all,
            'violation_to_page_median_ms': 1e3 * float(np.median(delays)),
            'violation_to_page_most_ms': 1e3 * max(delays),
        },
        'peers': {
            'bare_listener_20_robots_20hz_percent': bare,
            'bare_listener_memory_mb': memory[1],
        },
        'settings': {
            'robots': _ROBOTS,
            'rate_hz': _RATE,
            'rate_reached_hz': rate,
            'rules': len(rule_set.rules),
            'features': len(rule_set.space.names),
            'changes': _CHANGES,
            'seconds': seconds,
        },
    }


def _delay(
    monitor: _Monitor,
    rows: np.ndarray,
    rule_set: RuleSet,
    reader: _Reader,
    send_for: Callable[[float, Callable[[], bool]], None],
) -> float:
    """Return the seconds from a violation of one robot to its being on the page."""
    send_for(10.0, lambda: reader.standings[monitor.name] == 'SAFE')
    # Not in step with the ticks of the server.
    time.sleep(float(np.random.default_rng(time.time_ns()).uniform(0.0, 0.2)))
    violated = rows[rule_set.judge(rows).verdict == 1][0]
    begin = time.monotonic()
    monitor.publish(violated)
    with reader.changed:
        reader.changed.wait_for(lambda: reader.standings[monitor.name] == 'VIOLATED', 10.0)
    return time.monotonic() - begin
