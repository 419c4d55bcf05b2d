# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The node monitor beside a bare rclpy relay of the same messages."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.qos import VERDICTS
from occ_constraints_pkg.rules import FeatureSpace
from occ_constraints_pkg.rules.constraints_file import Constraints
from rclpy.context import Context
from sensor_msgs.msg import PointCloud2

from benchmarks.synthetic import learned_rules, samples_of_a_car
from benchmarks.traffic import Answers, Traffic, serialized

_MESSAGES = 500
_MANY_ROWS, _MANY_MESSAGES = 4096, 8
# Fewer than the queues hold (100), so that nothing is lost for want of room.
_OUTSTANDING, _MANY_OUTSTANDING = 50, 4
# With 60 s, as many messages as 50 Hz bring in an hour.
_MEMORY_MESSAGES_PER_SECOND = 3000
_TURNS = 3
_WARM = 2000
_CHUNK = 2000
_SETTLE_SECONDS = 5.0
_CLOCK_OF_PROCESS = 2  # CPUCLOCK_SCHED in Linux


class _Target:
    """One of the two nodes, the traffic to it, and what was measured of it."""

    def __init__(self, process: NodeProcess, context: Context, namespace: str) -> None:
        self.process = process
        self.traffic = Traffic(context, namespace)
        self.phases: dict[str, list[Answers]] = {}
        self.numbers: dict[str, float] = {}
        self._judged = 0
        self.traffic.node.create_subscription(
            PointCloud2, 'rule_stats', self._on_rule_stats, VERDICTS
        )

    def _on_rule_stats(self, message: PointCloud2) -> None:
        # The rule that is tried first is evaluated on every row.
        self._judged = int(Table.from_message(message).column('evaluated').max())

    def steadily(self, phase: str, messages: list[bytes], rate: float, seconds: float) -> None:
        """Send at a rate and keep what comes back."""
        answers = self.traffic.steadily(messages, rate, seconds)
        self.phases.setdefault(phase, []).append(answers)

    def fast(self, phase: str, messages: list[bytes], seconds: float, outstanding: int) -> None:
        """Send as fast as is answered, for at least that long, and keep what comes back."""
        left = seconds
        while left > 0.0:
            count = _CHUNK if outstanding > _MANY_OUTSTANDING else 10 * outstanding
            answers = self.traffic.fast(messages, count, outstanding)
            self.phases.setdefault(phase, []).append(answers)
            left -= answers.seconds

    def judged(self) -> int:
        """Return how many rows the node says it has judged, once it has said so of all."""
        for _ in range(int(_SETTLE_SECONDS / 0.5)):
            if self._judged >= self.traffic.total_sent:
                break
            self.traffic.spin(0.5)
        return self._judged

    def quantile_ms(self, phase: str, share: float) -> float:
        """Return a quantile of a phase's latencies."""
        latencies = np.concatenate([item.latencies for item in self.phases[phase]])
        return float(1e3 * np.quantile(latencies, share))

    def rate(self, phase: str) -> float:
        """Return the answers per second of a phase's fastest turn: the one least disturbed."""
        return max(item.rate for item in self.phases[phase])

    def count(self, phase: str, what: str) -> int:
        """Return the sum of ``sent``, ``lost`` or ``twice`` of a phase."""
        return sum(getattr(item, what) for item in self.phases[phase])


def run(seconds: float = 60.0) -> dict[str, Any]:
    """Measure the monitor and the relay by turns, each a process of its own.

    Args:
        seconds: time at 1 kHz; the other phases are shares of it. With 60, as many messages as
            50 Hz bring in an hour show whether memory grows.
    """
    rng = np.random.default_rng(0)
    rule_set = learned_rules(rng)
    rows = samples_of_a_car(rng, _MESSAGES).astype(np.float32)
    names = rule_set.space.names
    one = serialized([Table(names, row[None]) for row in rows])
    many = serialized(
        [
            Table(names, samples_of_a_car(rng, _MANY_ROWS).astype(np.float32))
            for _ in range(_MANY_MESSAGES)
        ]
    )
    constraints = Constraints(rule_set, feature_map_of(rule_set.space))
    with _targets(constraints) as (monitor, relay):
        for target in (monitor, relay):
            target.traffic.fast(one, _WARM, _OUTSTANDING)
        for _ in range(_TURNS):
            for target, share in ((relay, 4.0), (monitor, 1.0)):
                target.steadily('100 Hz', one, 100.0, seconds / 6.0 / _TURNS)
                target.steadily('1 kHz', one, 1000.0, seconds / share / _TURNS)
                target.fast('fast', one, seconds / 20.0 / _TURNS, _OUTSTANDING)
        monitor.numbers['judged'] = monitor.judged()
        monitor.numbers['sent'] = monitor.traffic.total_sent
        shares = [
            [_processor_share(target, one, seconds / 6.0 / _TURNS) for target in (relay, monitor)]
            for _ in range(_TURNS)
        ]
        # The median turn, for what else the machine does slows one or the other down.
        for target, share in zip((relay, monitor), np.median(shares, axis=0), strict=True):
            target.numbers['processor'] = float(share)
        monitor.numbers['memory'] = _memory_growth(monitor, one, seconds)
        for target in (relay, monitor):
            target.fast('many', many, seconds / 12.0, _MANY_OUTSTANDING)
        # Verdicts in words are made only while somebody listens, as a gate does.
        monitor.traffic.node.create_subscription(
            DiagnosticArray, 'violation', lambda message: None, VERDICTS, raw=True
        )
        monitor.traffic.spin(1.0)
        for target in (relay, monitor):
            target.steadily('1 kHz, in words', one, 1000.0, seconds / 12.0)
            target.fast('fast, in words', one, seconds / 20.0, _OUTSTANDING)
    return {
        **_numbers(monitor, relay),
        'settings': {
            'features': len(names),
            'rules': len(rule_set.rules),
            'messages_100hz': monitor.count('100 Hz', 'sent'),
            'messages_1khz': monitor.count('1 kHz', 'sent'),
            'memory_messages': int(_MEMORY_MESSAGES_PER_SECOND * seconds),
            'rows_per_message': [1, _MANY_ROWS],
            'seconds': seconds,
        },
    }


def _numbers(monitor: _Target, relay: _Target) -> dict[str, dict[str, float]]:
    metrics: dict[str, float] = {}
    peers: dict[str, float] = {}
    for phase, name in (('100 Hz', '100hz'), ('1 kHz', '1khz'), ('1 kHz, in words', 'words_1khz')):
        for share, quantile in ((0.5, 'p50'), (0.99, 'p99')):
            ours, bare = (item.quantile_ms(phase, share) for item in (monitor, relay))
            metrics[f'added_{quantile}_{name}_ms'] = ours - bare
            metrics[f'latency_{quantile}_{name}_ms'] = ours
            peers[f'relay_latency_{quantile}_{name}_ms'] = bare
    for phase, name in (('fast', ''), ('fast, in words', 'words_'), ('many', 'many_rows_')):
        metrics[f'{name}messages_per_s'] = monitor.rate(phase)
        metrics[f'{name}messages_per_relay_message_ratio'] = monitor.rate(phase) / relay.rate(phase)
        peers[f'relay_{name}messages_per_s'] = relay.rate(phase)
    metrics |= {
        'lost_1khz_messages': monitor.count('1 kHz', 'lost'),
        'answered_twice_1khz_messages': monitor.count('1 kHz', 'twice'),
        'judged_less_sent_messages': monitor.numbers['judged'] - monitor.numbers['sent'],
        'processor_50hz_percent': monitor.numbers['processor'],
        'processor_50hz_per_relay_ratio': monitor.numbers['processor'] / relay.numbers['processor'],
        'memory_growth_mb': monitor.numbers['memory'],
    }
    peers |= {
        'relay_lost_1khz_messages': relay.count('1 kHz', 'lost'),
        'relay_processor_50hz_percent': relay.numbers['processor'],
    }
    return {'metrics': metrics, 'peers': peers}


@contextmanager
def _targets(constraints: Constraints) -> Iterator[tuple[_Target, _Target]]:
    """Start both nodes and wait for them; end them when the block is left."""
    context, running, targets = Context(), [], []
    with private_domain() as domain, tempfile.TemporaryDirectory() as directory:
        # The middleware of this process reads it when it starts.
        os.environ.update(environment(domain))
        rules = Path(directory) / 'constraints.yaml'
        constraints.save(rules)
        context.init(domain_id=domain)
        try:
            for name, parameters, module in (
                ('monitor', {'constraints_file': rules}, None),
                ('relay', {}, 'benchmarks.relay'),
            ):
                process = NodeProcess(
                    name,
                    parameters,
                    Path(directory),
                    domain,
                    namespace=f'/beside_{name}',
                    module=module,
                )
                running.append(process)
                targets.append(_Target(process, context, f'/beside_{name}'))
            for target in targets:
                target.traffic.wait_for_node()
                target.process.raise_error()
            yield targets[0], targets[1]
        finally:
            for target in targets:
                target.traffic.close()
            for process in running:
                process.stop()
            context.try_shutdown()
        for process in running:
            process.raise_error()


def feature_map_of(space: FeatureSpace) -> dict[str, Any]:
    """Return the document of a map that takes each feature from a column of its name."""
    return {
        'schema_version': 1,
        'pace': 'observation',
        'max_age': 0.5,
        'features': [
            {
                'name': feature.name,
                'topic': 'observation',
                'column': feature.name,
                'unit': feature.unit,
                'bounds': [
                    float(end) if np.isfinite(end) else None for end in (feature.low, feature.high)
                ],
            }
            for feature in space.features
        ],
    }


def _processor_share(target: _Target, messages: list[bytes], seconds: float) -> float:
    """Return the percentage of one core that a node takes at 50 Hz."""
    before = processor_seconds(target.process.pid)
    target.steadily('50 Hz', messages, 50.0, seconds)
    used = processor_seconds(target.process.pid) - before
    return 100.0 * used / target.phases['50 Hz'][-1].seconds


def _memory_growth(target: _Target, messages: list[bytes], seconds: float) -> float:
    """Return by how many megabytes a node grows from a tenth of the messages to all of them."""
    count = int(_MEMORY_MESSAGES_PER_SECOND * seconds)
    target.traffic.fast(messages, max(1, count // 10), _OUTSTANDING)
    before = resident_bytes(target.process.pid)
    left = count - count // 10
    while left > 0:
        # In parts, for the sender must not remember all of them.
        target.traffic.fast(messages, min(left, 10 * _CHUNK), _OUTSTANDING)
        left -= 10 * _CHUNK
    return (resident_bytes(target.process.pid) - before) / 1e6


def processor_seconds(pid: int) -> float:
    """Return the processor time of a process so far (Linux)."""
    # The kernel's number for that clock; /proc tells whole hundredths of a second only.
    return time.clock_gettime((~pid << 3) | _CLOCK_OF_PROCESS)


def resident_bytes(pid: int) -> int:
    """Return how much memory a process holds (Linux)."""
    pages = Path(f'/proc/{pid}/statm').read_text(encoding='utf-8').split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')
