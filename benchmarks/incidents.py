# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The event_recorder at 60 topics, 5 000 messages and 20 MB a second, and the monitor beside it."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from occ_constraints_pkg.demo.processes import NodeProcess, environment, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.qos import VERDICTS
from occ_constraints_pkg.rosbag.event_bags import event_bags
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.constraints_file import Constraints
from rclpy.context import Context
from std_srvs.srv import Trigger

from benchmarks.many_topics import bytes_of_topics, number_of, read_log
from benchmarks.monitor import feature_map_of, processor_seconds, resident_bytes
from benchmarks.synthetic import learned_rules, samples_of_a_car
from benchmarks.traffic import Answers, Traffic, serialized

_TOPICS, _RATE, _BYTES = 60, 83.34, 2054
_BEFORE, _AFTER = 10.0, 5.0
# More than the window needs and less than comes in the time that the ring looks back, so that
# the bound is what limits it.
_MAX_BYTES = 256 << 20
_FILL_SECONDS = 18.0
_ROBOT = '/robot'
_MONITOR_HZ = 100.0
_PATIENCE_SECONDS = 60.0
_LOOK_SECONDS = 0.005
# What was published just before the window's end may still be under way.
_UNDER_WAY_NS = 20_000_000


@dataclass(frozen=True)
class _Written:
    """What a trigger led to.

    Attributes:
        triggered_ns: when, by the clock of the system.
        seconds: from the end of the window to the bag's being there.
        path: of the bag.
        bag_bytes: on the disk.
    """

    triggered_ns: int
    seconds: float
    path: Path
    bag_bytes: int


def run(seconds: float = 20.0) -> dict[str, Any]:
    """Measure processor time, memory, lost messages, and the latency of a monitor.

    The publisher is another process, and what it wrote down is compared with the bag.

    Args:
        seconds: time at the bound of the memory, before and after the event; also that of the
            monitor with the event_recorder and without.
    """
    rng = np.random.default_rng(0)
    rule_set = learned_rules(rng)
    names = rule_set.space.names
    tables = serialized([Table(names, row[None]) for row in samples_of_a_car(rng, 500)])
    with ExitStack() as stack:
        domain = stack.enter_context(private_domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ.update(environment(domain))
        rules, log, bags = folder / 'constraints.yaml', folder / 'published', folder / 'bags'
        Constraints(rule_set, feature_map_of(rule_set.space)).save(rules)
        context = Context()
        context.init(domain_id=domain)
        stack.callback(context.try_shutdown)

        def start(name: str, parameters: dict[str, Any], **options: Any) -> NodeProcess:
            process = NodeProcess(name, parameters, folder / name, domain, **options)
            stack.callback(process.stop)
            return process

        start('monitor', {'constraints_file': rules}, namespace=_ROBOT)
        traffic = Traffic(context, _ROBOT)
        stack.callback(traffic.close)
        # Verdicts in words are made only while somebody listens, as the event_recorder does.
        traffic.node.create_subscription(
            DiagnosticArray, 'violation', lambda message: None, VERDICTS, raw=True
        )
        traffic.wait_for_node()
        recorder = start(
            'event_recorder',
            {
                'store': folder / 'events',
                'directory': bags,
                'exclude_kinds': ['violation', 'unknown', 'near_miss', 'stop'],
                'before': _BEFORE,
                'after': _AFTER,
                'max_bytes': _MAX_BYTES,
                'regex': '^/topic_',
            },
            namespace=_ROBOT,
        )
        trigger = traffic.node.create_client(Trigger, 'event_recorder/trigger')
        end = time.monotonic() + _PATIENCE_SECONDS
        while not trigger.service_is_ready():
            recorder.raise_error()
            if time.monotonic() > end:
                raise OccError('the event_recorder did not start')
            traffic.spin(0.1)
        traffic.spin(3.0)
        empty = resident_bytes(recorder.pid)
        load = {'topics': _TOPICS, 'rate': _RATE, 'bytes': _BYTES, 'log': log}
        start('many_topics', load, module='benchmarks.many_topics')
        traffic.spin(_FILL_SECONDS)
        quiet, beside = _while_quiet(recorder, traffic, tables, seconds)
        future = trigger.call_async(Trigger.Request())
        triggered_ns, before = time.time_ns(), processor_seconds(recorder.pid)
        watched: list[_Written] = []
        watcher = threading.Thread(
            target=lambda: watched.append(_watch(bags, triggered_ns)), daemon=True
        )
        watcher.start()
        event_seconds = _AFTER + 2.0
        while_written = traffic.steadily(tables, _MONITOR_HZ, event_seconds)
        writing = 100.0 * (processor_seconds(recorder.pid) - before) / event_seconds
        watcher.join(_PATIENCE_SECONDS)
        if not watched or not future.done() or not future.result().success:
            raise OccError(f'there is no bag: {recorder.last_words()}')
        full = resident_bytes(recorder.pid)
        recorder.stop()
        recorder.raise_error()
        traffic.spin(1.0)
        alone = traffic.steadily(tables, _MONITOR_HZ, seconds)
        expected, lost = _compare(log, watched[0])
    sizes = bytes_of_topics(_TOPICS, _BYTES)
    return {
        'metrics': {
            'processor_percent': quiet,
            'processor_while_written_percent': writing,
            'memory_per_bound_ratio': (full - empty) / _MAX_BYTES,
            'lost_messages': lost,
            'window_messages': expected,
            'on_disk_after_window_s': watched[0].seconds,
            'bag_mb': watched[0].bag_bytes / 1e6,
            **_latencies('', beside),
            **_latencies('while_written_', while_written),
        },
        'peers': _latencies('alone_', alone),
        'settings': {
            'topics': _TOPICS,
            'messages_per_s': _TOPICS * _RATE,
            'mb_per_s': sum(sizes) * _RATE / 1e6,
            'before_s': _BEFORE,
            'after_s': _AFTER,
            'max_bytes': _MAX_BYTES,
            'monitor_hz': _MONITOR_HZ,
            'seconds': seconds,
        },
    }


def _while_quiet(
    recorder: NodeProcess, traffic: Traffic, tables: list[bytes], seconds: float
) -> tuple[float, Answers]:
    """Return the percentage of a core without an event, and the monitor's answers meanwhile."""
    before, begin = processor_seconds(recorder.pid), time.monotonic()
    answers = traffic.steadily(tables, _MONITOR_HZ, seconds)
    used = processor_seconds(recorder.pid) - before
    return 100.0 * used / (time.monotonic() - begin), answers


def _watch(bags: Path, triggered_ns: int) -> _Written:
    end = time.monotonic() + _PATIENCE_SECONDS
    while time.monotonic() < end:
        for bag in event_bags(bags):
            seconds = (time.time_ns() - triggered_ns) / 1e9 - _AFTER
            return _Written(triggered_ns, seconds, bag.path, bag.size)
        time.sleep(_LOOK_SECONDS)
    raise OccError(f'no bag came within {_PATIENCE_SECONDS:g} s')


def _compare(log: Path, written: _Written) -> tuple[int, int]:
    """Return how many messages were published in the window, and how many of them are missing."""
    first = written.triggered_ns - round(_BEFORE * 1e9)
    last = written.triggered_ns + round(_AFTER * 1e9) - _UNDER_WAY_NS
    expected = {number for number, when, _, _ in read_log(log) if first <= when <= last}
    recording = Recording(written.path)
    chosen = [topic for topic in recording.topics if topic.startswith('/topic_')]
    found = {number_of(message.data) for message in recording.messages(chosen)}
    return len(expected), len(expected - found)


def _latencies(kind: str, answers: Answers) -> dict[str, float]:
    quantiles = {'p50': 0.5, 'p99': 0.99}
    return {
        f'monitor_{kind}latency_{name}_ms': float(1e3 * np.quantile(answers.latencies, share))
        for name, share in quantiles.items()
    }
