# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From live messages to rows of features, and how long there have been none."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import InputError
from occ_constraints_pkg.features.extractor import FeatureExtractor, FeatureRows
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.fields import header_stamp_ns
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.nodes.monitor.markers import Sector
from occ_constraints_pkg.nodes.monitor.sensor_doubts import SensorDoubts
from occ_constraints_pkg.ros.clocks import ArrivalClock
from occ_constraints_pkg.ros.mapped_topics import MappedTopics
from occ_constraints_pkg.ros.node import OccNode


@dataclass(frozen=True)
class TimeLimits:
    """How late and how early inputs may be, in seconds.

    Attributes:
        timeout: how long nothing new may come, and ``/clock`` may stand still.
        max_lead: how far the header stamp of a message may be ahead of the clock; 0 for any, and
            not of tables, whose stamps identify steps.
        max_lag: how late a message may come (see
            :class:`~occ_constraints_pkg.features.lateness.Lateness`); likewise.
        frozen_after: how long a value may stay the same until it is told as frozen; 0 for ever.
    """

    timeout: float
    max_lead: float
    max_lag: float
    frozen_after: int = 0


class Inputs:
    """Subscribes to the topics of a feature map and computes its rows.

    Args:
        node: subscribes.
        feature_map: what to compute.
        limits: how late and how early messages may be.
        callback: called with the arguments of :meth:`rows` for each message.

    Raises:
        OccError: a topic cannot be subscribed to.
    """

    def __init__(
        self,
        node: OccNode,
        feature_map: FeatureMap,
        limits: TimeLimits,
        callback: Callable[[str, Any, int], None],
    ) -> None:
        self._node, self._callback = node, callback
        self._limits = limits
        self._max_lead_ns = round(limits.max_lead * 1e9)
        self._arrival = ArrivalClock(node, limits.timeout)
        self._refreshed = node.steady_seconds()
        self._extractor = FeatureExtractor(feature_map, limits.max_lag)
        self._topics = MappedTopics(node, feature_map, callback)
        # Of each topic the newest message, for its frame and its ranges.
        self._newest: dict[str, Any] = {}
        self._doubts = SensorDoubts(feature_map, limits.frozen_after)

    @property
    def feature_map(self) -> FeatureMap:
        """What is computed."""
        return self._extractor.feature_map

    def use(self, feature_map: FeatureMap) -> None:
        """Compute this from now on; with an equal map nothing changes, so no input is missed.

        Raises:
            OccError: a topic cannot be subscribed to; the map before stays.
        """
        if feature_map == self.feature_map:
            return
        extractor = FeatureExtractor(feature_map, self._limits.max_lag)
        topics = MappedTopics(self._node, feature_map, self._callback)
        self._topics.close()
        self._topics, self._extractor = topics, extractor
        self._doubts = SensorDoubts(feature_map, self._limits.frozen_after)
        self.refresh()

    def close(self) -> None:
        """Drop all subscriptions."""
        self._topics.close()

    def rows(self, topic: str, message: Any, published_ns: int) -> FeatureRows | None:
        """Take a message that has just come, and return the rows of features that it completes.

        Args:
            topic: as the feature map writes it.
            message: of the topic's type, or the :class:`TableMessage` of a table.
            published_ns: when it was published by the publisher's clock, 0 if that is not known.

        Returns:
            None where the message only becomes the latest value of its topic.

        Raises:
            OccError: it cannot be used; its features are unknown.
        """
        now = self._arrival.now_ns()
        # With simulated time, publishers stamp their messages with it, but publish at wall time.
        is_comparable = published_ns and not self._node.get_clock().ros_time_is_active
        sent = (published_ns, time.monotonic_ns()) if is_comparable else None
        self._newest[topic] = message
        self._check_stamp(topic, message, now)
        rows = self._extractor.push(topic, message, now, sent)
        if rows is None:
            return None
        if not len(rows.values):
            raise InputError(f'topic {topic!r} brought a table without rows')
        fault = self._topics.fault or self._extractor.fault
        if fault and not rows.note and np.isnan(rows.values).any():
            rows = replace(rows, note=fault)
        return rows

    def stamp_ns(self, message: Any) -> int:
        """Return the stamp of a message for which :meth:`rows` has just raised."""
        return header_stamp_ns(message) or self._arrival.latest_ns

    def refresh(self) -> None:
        """Note that something new has come; whoever gets rows knows which are new."""
        self._refreshed = self._node.steady_seconds()

    def check_timeout(self) -> str:
        """Return why nothing new has come for the timeout, on the steady clock; empty if it has."""
        if self._node.steady_seconds() - self._refreshed <= self._limits.timeout:
            return ''
        return self._topics.problem() or f'no new input for {self._limits.timeout:g} s'

    def check_clock(self) -> str:
        """Return why the arrival time of the last message cannot be relied on; empty if it can."""
        return self._arrival.problem()

    def sectors(self) -> Iterator[Sector]:
        """Yield the features that are sectors of a scan, in the frames of their newest messages."""
        return located_sectors(self.feature_map, self._newest)

    def doubts(self) -> list[str]:
        """Return what about the newest messages is likely not so; to be called once a second."""
        return list(self._doubts.look(*self._extractor.newest(), self._newest))

    def _check_stamp(self, topic: str, message: Any, now_ns: int) -> None:
        if not self._max_lead_ns or topic in self.feature_map.table_topics:
            return
        lead_ns = (header_stamp_ns(message) or 0) - now_ns
        # Without a time nothing is judged anyway.
        if now_ns and lead_ns > self._max_lead_ns:
            raise InputError(
                f'the stamp of a message on {topic!r} is {lead_ns * 1e-9:.3g} s ahead of the '
                f'clock; allowed is {self._limits.max_lead:g} s, by the parameter max_lead'
            )


def located_sectors(feature_map: FeatureMap, newest: Mapping[str, Any]) -> Iterator[Sector]:
    """Yield the features of a map that are sectors of a scan whose frame is known.

    Args:
        feature_map: knows which features are sectors.
        newest: topic, as the map writes it, to the newest message on it.
    """
    for number, feature in enumerate(feature_map.features):
        message = newest.get(feature.topic) if feature.degrees is not None else None
        if isinstance(message, TableMessage):
            frame = message.frame_id
        else:
            frame = message.header.frame_id if hasattr(message, 'header') else ''
        if frame:
            yield Sector(number, feature, frame)
