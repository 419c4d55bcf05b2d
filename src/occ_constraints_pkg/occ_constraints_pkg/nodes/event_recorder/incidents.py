# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The recording of the seconds around events, as a part of a node."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.nodes.bag_topics import topic_filter
from occ_constraints_pkg.nodes.event_recorder.capture import Capture
from occ_constraints_pkg.nodes.event_recorder.windows import EventWindows, Extent
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rosbag.event_bags import EventBags
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter, Outcome
from occ_constraints_pkg.rosbag.topic_filter import TopicFilter
from occ_constraints_pkg.wording import count_of

# Whatever else is chosen: the verdicts, what they are about, and the rules in force.
_ALWAYS = ('violation', 'events', 'rules', 'constraints')
_OUTCOME_SECONDS = 0.1


@dataclass(frozen=True)
class Settings:
    """What is kept, and where it goes.

    Attributes:
        topics: which are kept, by full name.
        extent: how much of them.
        directory: where recordings go; empty: none are made.
        quota: the most bytes that all of them may take on the disk; 0: no limit.
        compression: ``zstd``, ``lz4`` or ``none``.
    """

    topics: TopicFilter
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
        topics = topic_filter(node, 'keep')
        usual = Extent()
        extent = Extent(
            node.parameter('before', usual.before, 'seconds recorded before an event', low=0.0),
            node.parameter('after', usual.after, 'seconds recorded after its end', low=0.0),
            node.parameter(
                'longest',
                usual.longest,
                'seconds for which an event that goes on keeps a recording open, at the most',
                low=0.0,
            ),
            node.parameter(
                'max_bytes', usual.max_bytes, 'memory for the last seconds, bytes', low=1 << 20
            ),
        )
        settings = cls(
            topics,
            extent,
            node.parameter('directory', '', 'where recordings go; empty: none are made'),
            node.parameter('quota', 0, 'bytes of all recordings together; 0: no limit', low=0),
            # Half the time of zstd, which the robot has other uses for.
            node.parameter('compression', 'lz4', 'zstd, lz4 or none'),
        )
        if extent.longest < extent.after:
            raise ConfigurationError(
                f"parameter 'longest' of node {node.get_name()!r}: got {extent.longest:g}; allowed "
                f"is {extent.after:g} (parameter 'after') or more"
            )
        if topics.names or topics.regex:
            topics = replace(topics, names=[*topics.names, *_ALWAYS])
        return replace(settings, topics=topics.with_names(node.full_name))


class IncidentRecorder:
    """Keeps the last seconds of topics in memory, and records those around events.

    Args:
        node: an executor must spin it.
        settings: with a directory.
        on_bag: is called by the executor with what became of each recording.

    Raises:
        OccError: the directory cannot be used.
    """

    def __init__(
        self,
        node: OccNode,
        settings: Settings,
        on_bag: Callable[[Outcome], None] = lambda outcome: None,
    ) -> None:
        self._log, self._on_bag = node.get_logger(), on_bag
        bags = EventBags(settings.directory, settings.quota, settings.compression)
        self._writer = EventBagWriter(bags)
        self._windows = EventWindows(
            settings.extent, bags, self._writer, self._log.warning, time.monotonic()
        )
        self._capture = Capture(node, settings.topics.allows, self._windows.add)
        node.steady_timer(_OUTCOME_SECONDS, self._tell_outcomes)
        if bags.interrupted:
            self._log.warning(
                f'{count_of(len(bags.interrupted), "recording")} of events ended when a recorder '
                f'was killed; what there is of them is in {bags.interrupted[0].parent}'
            )
        self._log.info(
            f'keeping the last {settings.extent.before:g} s of {settings.topics}, for recordings '
            f'of events in {bags.directory}'
        )

    def begin(self) -> None:
        """Begin to keep messages."""
        self._capture.start()

    def on_event(self, event: Mapping[str, Any]) -> Path | None:
        """Record the seconds around an event: see :meth:`EventWindows.on_event`."""
        return self._windows.on_event(event, time.monotonic(), time.time_ns())

    def close(self) -> None:
        """End a recording that is under way, and see it to the disk."""
        self._capture.close()
        self._windows.end(time.monotonic(), 'the recorder was ended')
        self._writer.close()
        self._tell_outcomes()

    def _tell_outcomes(self) -> None:
        while self._writer.outcomes:
            outcome = self._writer.outcomes.popleft()
            for path in outcome.removed:
                self._log.info(f'{path} was removed to make room')
            if not outcome.is_kept:
                self._log.error(f'there is no recording {outcome.path}: {outcome.problem}')
            else:
                reason = outcome.document.get('reason')
                count = len(outcome.document['events']) + outcome.document['other_events']
                self._log.info(
                    f'recorded {count_of(count, "event")} to {outcome.path}'
                    + (f'; it ends early: {reason}' if reason else '')
                )
            self._on_bag(outcome)
