# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Topics of verdicts and of gates, each turned into events as its messages come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.derivation import Change, Sample, Settings, VerdictEvents
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.events.stops import StopEvents
from occ_constraints_pkg.nodes.event_recorder.messages import (
    MOST_ROBOTS,
    Judged,
    read_gate_sample,
    read_samples,
)
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import LATCHED, VERDICTS, overridable
from occ_constraints_pkg.rules import Verdict

# A monitor without input says so once a second, after its own timeout.
_LOST_NS = 1_500_000_000
# A message that waited longer than this came before the clock was set.
_MOST_WAIT_NS = 60_000_000_000
# Several monitors may publish their latched rules on one topic.
_RULES = QoSProfile(depth=10, reliability=LATCHED.reliability, durability=LATCHED.durability)


@dataclass(frozen=True)
class Moment:
    """A time on two clocks, in ns.

    Attributes:
        wall: the time of the system, which may be set.
        steady: of a clock that is never set.
    """

    wall: int
    steady: int

    @classmethod
    def now(cls, waited: int = 0) -> Moment:
        """Return the present time, or that of ``waited`` ns ago."""
        return cls(time.time_ns() - waited, time.monotonic_ns() - waited)


def _arrived(info: dict[str, Any]) -> Moment:
    """Return when a message came, however long it waited for its turn."""
    received = info['received_timestamp']
    waited = time.time_ns() - received if received else 0
    return Moment.now(waited if 0 <= waited <= _MOST_WAIT_NS else 0)


Taken = Callable[[list[Change]], None]


class VerdictSource:
    """A topic of verdicts, and the events of each robot on it.

    Args:
        node: subscribes.
        topic: as it is given; ``rules`` and ``features`` are looked for beside it too.
        settings: what counts as one event.
        take: gets the changes.
    """

    def __init__(self, node: OccNode, topic: str, settings: Settings, take: Taken) -> None:
        self._node, self._settings, self._take = node, settings, take
        self.topic = node.full_name(topic)
        self._judged = Judged()
        self._robots: dict[int, VerdictEvents] = {}
        self._heard = Moment.now()
        self._has_begun = False
        self._lost_ns = round(settings.timeout * 1e9) + _LOST_NS
        beside = topic.rpartition('/')[0]

        def on_message(message: DiagnosticArray, info: dict[str, Any]) -> None:
            self._on_verdict(message, _arrived(info))

        qos = overridable()
        node.create_subscription(
            DiagnosticArray, topic, on_message, VERDICTS, qos_overriding_options=qos
        )
        for folder in dict.fromkeys(('', f'{beside}/' if beside else '')):
            node.create_subscription(String, f'{folder}rules', self._on_rules, _RULES)
            node.create_subscription(PointCloud2, f'{folder}features', self._on_features, VERDICTS)

    @property
    def problem(self) -> str:
        """Why nothing is heard; empty while verdicts come."""
        if Moment.now().steady - self._heard.steady <= self._lost_ns:
            return ''
        since = 'for' if self._has_begun else 'since the start, for'
        return (
            f'no verdict {since} {self._lost_ns / 1e9:g} s on {self.topic}: is a monitor running?'
        )

    def tick(self, now: Moment) -> list[Change]:
        """See what is over, and whether verdicts still come."""
        changes = []
        problem = self.problem
        if problem:
            derived = self._robot(0)
            stamp = 0 if derived.newest is None else derived.newest.stamp
            began = self._heard if not derived.is_unjudged else now
            changes += derived.add(
                Sample(
                    Verdict.UNKNOWN,
                    float('nan'),
                    stamp,
                    began.wall,
                    began.steady,
                    reason=problem,
                    is_answer=False,
                )
            )
        for derived in self._robots.values():
            changes += derived.tick(now.steady)
        return changes

    def close(self, now: Moment, reason: str) -> list[Change]:
        """End what goes on."""
        return [
            change
            for derived in self._robots.values()
            for change in derived.close(now.steady, reason)
        ]

    def _robot(self, number: int) -> VerdictEvents:
        if number not in self._robots:
            space = self._node.get_namespace()
            name = f'{space}#{number}' if number else space
            self._robots[number] = VerdictEvents(name, self._settings)
        return self._robots[number]

    def _on_verdict(self, message: DiagnosticArray, now: Moment) -> None:
        self._heard, self._has_begun = now, True
        samples = read_samples(message, self._judged, now.wall, now.steady)
        changes = []
        for number, sample in samples.items():
            changes += self._robot(number).add(sample)
        if len(samples) < MOST_ROBOTS:
            changes += self._add_safe(samples)
        self._take(changes)

    def _add_safe(self, samples: dict[int, Sample]) -> list[Change]:
        """Take as SAFE the robots of a table that a message does not describe."""
        one = next(iter(samples.values()), None)
        if one is None or not one.is_answer:
            return []
        changes = []
        for number, derived in self._robots.items():
            newest = derived.newest
            if number not in samples and newest is not None and newest.verdict is not Verdict.SAFE:
                changes += derived.add(
                    Sample(
                        Verdict.SAFE,
                        float('inf'),
                        one.stamp,
                        one.wall,
                        one.steady,
                        rule_set=one.rule_set,
                        episode=newest.episode,
                    )
                )
        return changes

    def _on_rules(self, message: String) -> None:
        try:
            self._judged.hear_rules(message)
        except OccError as error:
            self._node.get_logger().warning(
                f'events will lack bounds: {error}', throttle_duration_sec=60.0
            )

    def _on_features(self, message: PointCloud2) -> None:
        try:
            self._judged.hear_features(message)
        except OccError as error:
            self._node.get_logger().warning(
                f'near misses will lack their rule: {error}', throttle_duration_sec=60.0
            )


class GateSource:
    """The state of one gate, and its stops.

    Args:
        node: subscribes.
        gate: name of the gate's node, relative to the namespace.
        take: gets the changes.
        recent: returns events that may be causes.
    """

    def __init__(
        self, node: OccNode, gate: str, take: Taken, recent: Callable[[], Sequence[Event]]
    ) -> None:
        self.topic = node.full_name(f'{gate}/state')
        self._take, self._recent = take, recent
        self._stops = StopEvents(node.get_namespace())

        def on_message(message: DiagnosticArray, info: dict[str, Any]) -> None:
            now = _arrived(info)
            sample = read_gate_sample(message, now.wall, now.steady)
            if sample is not None:
                self._take(self._stops.add(sample, self._recent()))

        node.create_subscription(
            DiagnosticArray,
            f'{gate}/state',
            on_message,
            LATCHED,
            qos_overriding_options=overridable(),
        )

    def tick(self, now: Moment) -> list[Change]:
        """See whether the gate is still there."""
        return self._stops.tick(now.wall, now.steady, self._recent())

    def close(self, now: Moment, reason: str) -> list[Change]:
        """End what goes on."""
        return self._stops.close(now.steady, reason)
