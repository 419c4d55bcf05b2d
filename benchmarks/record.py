# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a recorder of many topics loses when it is killed, and how it ends on Ctrl-C."""

from __future__ import annotations

import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.demo.processes import NodeProcess, private_domain
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.recording import Recording

from benchmarks.many_topics import number_of, read_log

_TOPICS, _RATE = 200, 5.0
_KILLS, _INTERRUPTS = 20, 5
_START_SECONDS = 60.0
_LOOK_SECONDS = 0.1
# A publisher learns of a subscription a moment before messages reach it.
_MATCH_NS = 100_000_000
# What was published just before the signal may still be under way.
_UNDER_WAY_NS = 20_000_000


@dataclass(frozen=True)
class Ending:
    """How a recording ended, by what its publisher wrote down.

    Attributes:
        expected: messages that had arrived when the signal was sent.
        lost: those of them that are not in the bag.
        lost_seconds: from the first of these to the signal.
        end_seconds: from the signal to the end of the process.
        late_seconds: the most that a log time is behind the time of publishing.
        topics: number of topics in the bag.
    """

    expected: int
    lost: int
    lost_seconds: float
    end_seconds: float
    late_seconds: float
    topics: int


def run(seconds: float = 8.0) -> dict[str, Any]:
    """Record 200 topics at 5 Hz again and again; kill most recorders, interrupt some.

    The publisher is another process, and what it wrote down is compared with the bag.

    Args:
        seconds: the most that a recording takes from its first message on.
    """
    rng = np.random.default_rng(0)
    endings: dict[signal.Signals, list[Ending]] = {signal.SIGKILL: [], signal.SIGINT: []}
    with private_domain() as domain:
        for number in [signal.SIGKILL] * _KILLS + [signal.SIGINT] * _INTERRUPTS:
            after = float(rng.uniform(0.1, 1.0)) * seconds
            with tempfile.TemporaryDirectory() as folder:
                endings[number].append(record(Path(folder), domain, number, after))
    killed, interrupted = endings[signal.SIGKILL], endings[signal.SIGINT]
    return {
        'metrics': {
            'killed_loss_max_s': max(item.lost_seconds for item in killed),
            'killed_loss_median_s': float(np.median([item.lost_seconds for item in killed])),
            'interrupted_lost_messages': sum(item.lost for item in interrupted),
            'interrupted_end_max_s': max(item.end_seconds for item in interrupted),
            'log_time_late_max_s': max(item.late_seconds for item in killed + interrupted),
        },
        'peers': {},
        'settings': {
            'topics': _TOPICS,
            'rate_hz': _RATE,
            'kills': _KILLS,
            'interrupts': _INTERRUPTS,
            'messages': sum(item.expected for item in killed + interrupted),
            'seconds': seconds,
        },
    }


def record(
    folder: Path,
    domain: int,
    number: signal.Signals,
    after: float,
    *,
    topics: int = _TOPICS,
    rate: float = _RATE,
) -> Ending:
    """Record many topics and send the recorder a signal.

    Args:
        folder: where bag and logs go.
        domain: ROS domain id.
        number: the signal.
        after: seconds from the recorder's first message to the signal.
        topics: number of topics.
        rate: messages per second on each.

    Raises:
        OccError: the recorder did not start, or its bag cannot be read.
    """
    log, bag = folder / 'published', folder / 'bag'
    running = [
        NodeProcess(
            'many_topics',
            {'topics': topics, 'rate': rate, 'log': log},
            folder,
            domain,
            module='benchmarks.many_topics',
        )
    ]
    try:
        recorder = NodeProcess('recorder', {'output': bag}, folder, domain)
        running.append(recorder)
        _wait_until_heard(recorder, log, topics)
        time.sleep(after)
        stopped_ns = time.time_ns()
        recorder.send_signal(number)
        recorder.join()
        end_seconds = (time.time_ns() - stopped_ns) / 1e9
    finally:
        for process in running:
            process.send_signal(signal.SIGKILL)
            process.join()
    return _compare(log, bag, stopped_ns, end_seconds)


def _wait_until_heard(recorder: NodeProcess, log: Path, topics: int) -> None:
    end = time.monotonic() + _START_SECONDS
    while not (log.exists() and any(entry[3] for entry in read_log(log)[-topics:])):
        recorder.raise_error()
        if time.monotonic() > end:
            raise OccError(f'no message reached the recorder within {_START_SECONDS:g} s')
        time.sleep(_LOOK_SECONDS)


def _compare(log: Path, bag: Path, stopped_ns: int, end_seconds: float) -> Ending:
    entries = read_log(log)
    published = {number: time_ns for number, time_ns, _, _ in entries}
    heard: dict[int, int] = {}
    for _, time_ns, topic, is_heard in entries:
        if is_heard:
            heard.setdefault(topic, time_ns)
    expected = {
        number: time_ns
        for number, time_ns, topic, _ in entries
        if topic in heard and heard[topic] + _MATCH_NS < time_ns < stopped_ns - _UNDER_WAY_NS
    }
    recording = Recording(bag)
    chosen = [topic for topic in recording.topics if topic.startswith('/topic_')]
    logged = {
        number_of(message.data): message.log_time_ns for message in recording.messages(chosen)
    }
    lost = [time_ns for number, time_ns in expected.items() if number not in logged]
    return Ending(
        len(expected),
        len(lost),
        (stopped_ns - min(lost)) / 1e9 if lost else 0.0,
        end_seconds,
        max((logged[key] - published[key]) / 1e9 for key in logged if key in published),
        len(chosen),
    )
