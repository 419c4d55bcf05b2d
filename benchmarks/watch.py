# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The live view on a terminal while five monitors judge fifty times a second each.

Its peer is a bare rclpy node that subscribes to the same verdicts and deserializes each.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.qos import STEPS
from occ_constraints_pkg.ros.tables import table_bytes
from occ_constraints_pkg.rules.constraints_file import Constraints
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from benchmarks.monitor import feature_map_of, processor_seconds
from benchmarks.synthetic import learned_rules, samples_of_a_car
from benchmarks.terminal import TerminalProcess

_ROBOTS, _RATE = 5, 50.0
_START_SECONDS, _WARM_SECONDS = 60.0, 5.0
_TURNS = 3
_MESSAGES = 500


def run(seconds: float = 30.0) -> dict[str, Any]:
    """Measure the processor time of the view and of its peer by turns.

    Args:
        seconds: measured time of each.
    """
    rng = np.random.default_rng(0)
    rule_set = learned_rules(rng)
    rows = samples_of_a_car(rng, _MESSAGES)
    names = rule_set.space.names
    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ.update(environment(domain))
        rules = folder / 'constraints.yaml'
        Constraints(rule_set, feature_map_of(rule_set.space)).save(rules)
        context = Context()
        context.init(domain_id=domain)
        stack.callback(context.try_shutdown)
        node = Node('robots', context=context)
        stack.callback(node.destroy_node)
        spaces = [f'/robot{number}' for number in range(1, _ROBOTS + 1)]
        publishers = [
            node.create_publisher(PointCloud2, f'{space}/observation', STEPS) for space in spaces
        ]
        for space in spaces:
            monitor = NodeProcess(
                'monitor', {'constraints_file': rules}, folder / space[1:], domain, namespace=space
            )
            stack.callback(monitor.stop)
        sent = 0

        def send_for(duration: float, done: Callable[[], bool] = lambda: False) -> None:
            nonlocal sent
            begin, first = time.monotonic(), sent
            while (now := time.monotonic()) - begin < duration and not done():
                for number, publisher in enumerate(publishers):
                    row = rows[(sent + 97 * number) % len(rows)][None]
                    publisher.publish(table_bytes(Table(names, row), time.time_ns(), 'car'))
                sent += 1
                time.sleep(max(0.0, begin + (sent - first) / _RATE - now))

        view = stack.enter_context(
            TerminalProcess(
                [sys.executable, '-m', 'occ_constraints_pkg', 'watch'], environment(domain)
            )
        )
        peer = NodeProcess('listener', {}, folder, domain, module='benchmarks.listener')
        stack.callback(peer.stop)

        def is_shown() -> bool:
            view.read(0.0)
            return b'SAFE' in view.output or b'VIOLATED' in view.output

        send_for(_START_SECONDS, is_shown)
        if not is_shown():
            raise OccError(f'the view has shown no verdict within {_START_SECONDS:g} s')
        send_for(_WARM_SECONDS)
        shares: dict[int, list[float]] = {view.process.pid: [], peer.pid: []}
        drawn = len(view.output)
        for _ in range(_TURNS):
            before = {pid: processor_seconds(pid) for pid in shares}
            begin = time.monotonic()
            send_for(seconds / _TURNS, lambda: view.read(0.0))
            took = time.monotonic() - begin
            for pid, values in shares.items():
                values.append(100.0 * (processor_seconds(pid) - before[pid]) / took)
        view.press('q')
        code = view.wait()
        if code != 0:
            raise OccError(f'the view ended with code {code}')
    ours, bare = (float(np.median(values)) for values in shares.values())
    return {
        'metrics': {
            'processor_5_robots_50hz_percent': ours,
            'drawn_kb_per_s': (len(view.output) - drawn) / seconds / 1e3,
        },
        'peers': {'bare_listener_5_robots_50hz_percent': bare},
        'settings': {
            'robots': _ROBOTS,
            'rate_hz': _RATE,
            'rules': len(rule_set.rules),
            'features': len(names),
            'terminal': '120x40',
            'seconds': seconds,
        },
    }
