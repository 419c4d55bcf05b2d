# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The recording of the seconds around events, as a part of the node ``event_recorder``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.events.event import KINDS, Event
from occ_constraints_pkg.nodes.bag_topics import topic_filter
from occ_constraints_pkg.nodes.event_recorder.capture import Capture
from occ_constraints_pkg.nodes.event_recorder.windows import EventWindows, Extent
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rosbag.event_bags import EventBags, ids_of
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter, Outcome
from occ_constraints_pkg.rosbag.topic_filter import TopicFilter
from occ_constraints_pkg.wording import count_of

# Whatever else is chosen: the verdicts, what they are about, and the rules in force.
_ALWAYS = ('violation', 'events', 'rules', 'constraints')
# They are many on a robot that drives close to its bounds, as it may.
_NOT_RECORDED = 'near_miss'
_TICK_SECONDS = 0.1
_PINS_SECONDS = 1.0

NameBag = Callable[[Iterable[str], str | None], None]
"""Is told the ids of events and the path of their recording, None when that is removed."""


@dataclass(frozen=True)
class Settings:
    """What is kept, and where it goes.

    Attributes:
        is_on: whether anything is recorded.
        topics: which are kept, by full name.
        without: kinds of events that are not recorded.
        extent: how much of them.
        directory: where recordings go; empty: beside the event store.
        quota: the most bytes that all of them may take on the disk; 0: no limit.
        compression: ``zstd``, ``lz4`` or ``none``.
    """

    is_on: bool
    topics: TopicFilter
    without: frozenset[str]
    extent: Extent
    directory: str
    quota: int
    compression: str

    @classmethod
    def declare(cls, node: OccNode) -> Settings:
        """Declare the node's parameters, and return their values.

        Raises:
            OccError: one has a wrong value.
        """
        usual = Extent()
        settings = cls(
            is_on=node.parameter('record', True, 'record the seconds around events to bags'),
            topics=topic_filter(node, 'record'),
            without=frozenset(
                node.parameter('exclude_kinds', [_NOT_RECORDED], 'kinds of events not to record')
            ),
            extent=Extent(
                node.parameter('before', usual.before, 'seconds recorded before an event', low=0.0),
                node.parameter('after', usual.after, 'seconds recorded after its end', low=0.0),
                node.parameter(
                    'longest',
                    usual.longest,
                    'seconds for which an event that goes on keeps its bag open, at the most',
                    low=0.0,
                ),
                node.parameter(
                    'max_bytes', usual.max_bytes, 'memory for the last seconds', low=1 << 20
                ),
            ),
            directory=node.parameter(
                'directory', '', 'where bags go; empty: bags/ in that of the event store'
            ),
            quota=node.parameter(
                'quota', 8 << 30, 'bytes of all bags; beyond, the oldest go; 0: no limit', low=0
            ),
            # Half the time of zstd, which the robot has other uses for.
            compression=node.parameter('compression', 'lz4', 'zstd, lz4 or none'),
        )
        settings.check(node.get_name())
        topics = settings.topics
        if topics.names or topics.regex:
            topics = replace(topics, names=[*topics.names, *_ALWAYS])
        return replace(settings, topics=topics.with_names(node.full_name))

    def check(self, name: str) -> None:
        """Refuse values that contradict each other or mean nothing.

        Args:
            name: of the node.

        Raises:
            OccError: there are some.
        """
        unknown = sorted(self.without - set(KINDS))
        if unknown:
            raise ConfigurationError(
                f"parameter 'exclude_kinds' of node {name!r}: got {unknown[0]!r}; allowed are "
                f'{", ".join(KINDS)}'
            )
        if self.extent.longest < self.extent.after:
            raise ConfigurationError(
                f"parameter 'longest' of node {name!r}: got {self.extent.longest:g}; allowed is "
                f"{self.extent.after:g} (parameter 'after') or more"
            )


class IncidentRecorder:
    """Keeps the last seconds of topics in memory, and records those around events.

    Args:
        node: an executor must spin it.
        settings: see there.
        directory: where bags go if the settings do not say.
        name_bag: is called by the executor.
        pinned_bags: returns the paths of bags that must stay.

    Raises:
        OccError: the directory cannot be used.
    """

    def __init__(
        self,
        node: OccNode,
        settings: Settings,
        directory: Path,
        name_bag: NameBag,
        pinned_bags: Callable[[], set[str]],
    ) -> None:
        self._log, self._settings = node.get_logger(), settings
        self._name_bag, self._pinned_bags = name_bag, pinned_bags
        self._bags = EventBags(
            os.path.expanduser(settings.directory) or directory,
            settings.quota,
            settings.compression,
        )
        self._writer = EventBagWriter(self._bags)
        self._windows = EventWindows(
            settings.extent, self._bags, self._writer, self._log.warning, time.monotonic()
        )
        self._capture = Capture(node, settings.topics.allows, self._windows.add)
        # Of the bags that are not finished: the ids of their events, and those to be told yet.
        self._events: dict[Path, list[str]] = {}
        self._untold: list[tuple[str, Path]] = []
        node.steady_timer(_TICK_SECONDS, self._tick)
        node.steady_timer(_PINS_SECONDS, self._look_at_pins)

    def begin(self) -> None:
        """Begin to keep messages."""
        for path in self._bags.interrupted:
            # Their events name the place where they would be if they were whole.
            self._name_bag(ids_of(path), str(path))
        if self._bags.interrupted:
            self._log.warning(
                f'{count_of(len(self._bags.interrupted), "bag")} of events ended when a recorder '
                f'was killed; what there is of them is in {self._bags.interrupted[0].parent}'
            )
        self._look_at_pins()
        self._capture.start()
        self._log.info(
            f'keeping the last {self._settings.extent.before:g} s of {self._settings.topics}, for '
            f'bags of events in {self._bags.directory}'
        )

    def on_event(self, event: Event, phase: str) -> None:
        """Record the seconds around an event, or go on recording."""
        if event.kind in self._settings.without:
            return
        path = self._windows.on_event(event.to_document(phase), time.monotonic(), time.time_ns())
        if path is not None and phase == 'began':
            self._events.setdefault(path, []).append(event.id)
            self._untold.append((event.id, path))

    def bag_of(self, event: str) -> Path | None:
        """Return the bag that an event is in, by its id, while that is not finished."""
        return next((path for path, ids in self._events.items() if event in ids), None)

    def close(self) -> None:
        """End a bag that is under way, and see it to the disk."""
        self._capture.close()
        self._windows.end(time.monotonic(), 'the recorder was ended')
        self._writer.close()
        self._tick()

    def _look_at_pins(self) -> None:
        self._bags.pinned = self._pinned_bags()

    def _tick(self) -> None:
        """Tell which bags events are in, and what became of bags."""
        untold, self._untold = self._untold, []
        for path in dict.fromkeys(path for _, path in untold):
            self._name_bag([event for event, its in untold if its == path], str(path))
        while self._writer.outcomes:
            self._tell(self._writer.outcomes.popleft())

    def _tell(self, outcome: Outcome) -> None:
        ids = self._events.pop(outcome.path, [])
        if outcome.is_kept:
            reason = outcome.document['reason']
            self._log.info(
                f'recorded {count_of(len(ids), "event")} to {outcome.path}'
                + (f', which ends early: {reason}' if reason else '')
            )
        else:
            self._log.error(f'there is no bag {outcome.path}: {outcome.problem}')
            self._name_bag(ids, None)
        for bag in outcome.removed:
            self._log.info(f'{bag.path} was removed to make room')
            self._name_bag(bag.events, None)
