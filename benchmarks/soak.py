# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""As many messages as a day brings, through a monitor and a gate, and what they grow by.

A day at 10 Hz is 864 000 messages; sent as fast as they are answered, a few at a time, they take
about a quarter of an hour. What depends on the number of messages, as a leak does, shows as in a
day; what depends on time alone does not.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.qos import COMMANDS
from occ_constraints_pkg.rules.constraints_file import Constraints
from rclpy.context import Context

from benchmarks.monitor import feature_map_of, resident_bytes
from benchmarks.synthetic import learned_rules, samples_of_a_car
from benchmarks.traffic import Answers, Traffic, serialized

# About as many messages as a monitor answers in a second on two cores.
_RATE = 1000.0
# Messages under way: fewer than queues hold, so each that is not answered is a loss.
_OUTSTANDING = 4
# Messages per second that a robot has whose day this is.
_DAY_RATE = 10.0
_MESSAGES = 500
_NAMESPACE = '/soak'
_SLICES = 24
# Caches fill and the allocator settles in the first of these; growth is counted from its end.
_SETTLING_SLICES = 2


def run(seconds: float = 864.0) -> dict[str, Any]:
    """Send messages, and look at both nodes after each twenty-fourth of them.

    Args:
        seconds: for each, a thousand messages; with 864, as many as 10 Hz bring in a day.
    """
    rng = np.random.default_rng(0)
    rule_set = learned_rules(rng)
    rows = samples_of_a_car(rng, _MESSAGES).astype(np.float32)
    messages = serialized([Table(rule_set.space.names, row[None]) for row in rows])
    constraints = Constraints(rule_set, feature_map_of(rule_set.space))
    context, running = Context(), []
    with private_domain() as domain, tempfile.TemporaryDirectory() as directory:
        # The middleware of this process reads it when it starts.
        os.environ.update(environment(domain))
        rules, counts = Path(directory) / 'constraints.yaml', Path(directory) / 'counts.json'
        constraints.save(rules)
        context.init(domain_id=domain)
        try:
            for name, parameters in (
                ('monitor', {'constraints_file': rules, 'counts_file': counts}),
                ('gate', {}),
            ):
                running.append(
                    NodeProcess(name, parameters, Path(directory), domain, namespace=_NAMESPACE)
                )
            traffic = Traffic(context, _NAMESPACE)
            commands = traffic.node.create_publisher(Twist, 'cmd_vel_in', COMMANDS)
            traffic.node.create_timer(0.05, lambda: commands.publish(Twist()))
            traffic.wait_for_node()
            hours = _soak(traffic, messages, seconds, running)
            traffic.close()
        finally:
            for process in running:
                process.stop()
            context.try_shutdown()
        for process in running:
            process.raise_error()
    return _result(hours, seconds)


def _soak(
    traffic: Traffic, messages: list[bytes], seconds: float, running: list[NodeProcess]
) -> list[dict[str, float]]:
    """Return what was measured in each part."""
    parts = []
    for _ in range(_SLICES):
        count = max(1, round(_RATE * seconds / _SLICES))
        answers = traffic.fast(messages, count, _OUTSTANDING)
        for process in running:
            process.raise_error()
        parts.append(
            _latencies(answers) | {k: v for one in running for k, v in _state(one).items()}
        )
    return parts


def _latencies(answers: Answers) -> dict[str, float]:
    p50, p99 = 1e3 * np.quantile(answers.latencies, (0.5, 0.99))
    return {
        'sent_messages': answers.sent,
        'lost_messages': answers.lost,
        'latency_p50_ms': round(float(p50), 3),
        'latency_p99_ms': round(float(p99), 3),
    }


def _state(process: NodeProcess) -> dict[str, float]:
    """Return what a process holds (Linux): memory, open files, threads."""
    proc = Path(f'/proc/{process.pid}')
    return {
        f'{process.name}_memory_mb': round(resident_bytes(process.pid) / 1e6, 2),
        f'{process.name}_descriptors': len(list((proc / 'fd').iterdir())),
        f'{process.name}_threads': len(list((proc / 'task').iterdir())),
    }


def _result(parts: list[dict[str, float]], seconds: float) -> dict[str, Any]:
    settled, last = parts[_SETTLING_SLICES - 1], parts[-1]

    def total(name: str) -> float:
        return sum(part[name] for part in parts)

    def of_parts(name: str, what: Callable[[list[float]], Any]) -> float:
        return float(what([part[name] for part in parts]))

    metrics = {
        'messages': total('sent_messages'),
        'hours_at_10hz': total('sent_messages') / _DAY_RATE / 3600.0,
        'lost_messages': total('lost_messages'),
        'latency_p50_ms': of_parts('latency_p50_ms', np.median),
        'latency_p99_median_ms': of_parts('latency_p99_ms', np.median),
        'latency_p99_worst_ms': of_parts('latency_p99_ms', max),
    }
    for node in ('monitor', 'gate'):
        metrics[f'{node}_memory_mb'] = last[f'{node}_memory_mb']
        for what in ('memory_mb', 'descriptors', 'threads'):
            name = f'{node}_{what}'
            metrics[f'{node}_growth_{what}'] = round(last[name] - settled[name], 2)
    return {
        'metrics': metrics,
        'peers': {},
        'settings': {'seconds': seconds, 'outstanding': _OUTSTANDING, 'parts': parts},
    }
