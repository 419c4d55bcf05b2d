# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rows of features from live topics, and a watchdog that says when there are none."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import InputError, OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor, FeatureRows
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.fields import header_stamp_ns
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.ros.arrival import ArrivalClock
from occ_constraints_pkg.ros.mapped_topics import MappedTopics
from occ_constraints_pkg.ros.process import OccNode


class LiveFeatures:
    """Subscribes to the topics of a feature map and computes its rows.

    Args:
        node: subscribes.
        feature_map: what to compute.
        limits: three numbers of seconds, ``timeout``, ``max_lead``, ``max_lag``: how long nothing
            new may come until :attr:`silence` has something to say, and ``/clock`` may stand
            still; how far the header stamp of a message may be ahead of the clock; and how late
            it may come (see :class:`~occ_constraints_pkg.features.lateness.Lateness`). The latter
            two are 0 for any, and not of tables, whose stamps tell steps apart.
        on_rows: called with each input's rows.
        on_fault: called with the reason and the stamp in ns of an input that gives none.

    Raises:
        OccError: a topic cannot be subscribed to.
    """

    def __init__(
        self,
        node: OccNode,
        feature_map: FeatureMap,
        limits: tuple[float, float, float],
        on_rows: Callable[[FeatureRows], None],
        on_fault: Callable[[str, int], None],
    ) -> None:
        self._node = node
        self._timeout, max_lead, self._max_lag = limits
        self._max_lead_ns = round(max_lead * 1e9)
        self._on_rows, self._on_fault = on_rows, on_fault
        self._arrival = ArrivalClock(node, self._timeout)
        self._heard = node.steady_seconds()
        self._extractor = FeatureExtractor(feature_map, self._max_lag)
        self._topics = MappedTopics(node, feature_map, self._on_message)
        self._newest: dict[str, Any] = {}

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
        extractor = FeatureExtractor(feature_map, self._max_lag)
        topics = MappedTopics(self._node, feature_map, self._on_message)
        self._topics.close()
        self._topics, self._extractor = topics, extractor
        self.renew()

    def frame(self, topic: str) -> str:
        """Return the ``frame_id`` of a topic's newest message, the topic as the map writes it."""
        newest = self._newest.get(topic)
        if isinstance(newest, TableMessage):
            return newest.frame_id
        header = getattr(newest, 'header', None)
        return '' if header is None else header.frame_id

    def close(self) -> None:
        """Drop all subscriptions."""
        self._topics.close()

    def renew(self) -> None:
        """Take note that something new has come; whoever gets rows knows which are."""
        self._heard = self._node.steady_seconds()

    @property
    def silence(self) -> str:
        """Why nothing new has come for the timeout, on the steady clock; empty if it has."""
        if self._node.steady_seconds() - self._heard <= self._timeout:
            return ''
        return self._topics.problem() or f'no new input for {self._timeout:g} s'

    @property
    def clock_problem(self) -> str:
        """Why the time of the last message's arrival cannot be relied on; empty if it can."""
        return self._arrival.problem()

    def _on_message(self, topic: str, message: Any, published_ns: int) -> None:
        now = self._arrival.now_ns()
        # With simulated time, publishers tell wall time and stamps do not.
        is_told = published_ns and not self._node.get_clock().ros_time_is_active
        sent = (published_ns, time.monotonic_ns()) if is_told else None
        self._newest[topic] = message
        try:
            self._check_stamp(topic, message, now)
            rows = self._extractor.push(topic, message, now, sent)
            if rows is not None and not len(rows.values):
                raise InputError(f'topic {topic!r} brought a table without rows')
        except OccError as error:
            self.renew()
            self._node.get_logger().error(f'input refused: {error}', throttle_duration_sec=1.0)
            self._on_fault(str(error), header_stamp_ns(message) or now)
            return
        if rows is not None:
            if self._topics.fault and not rows.note and np.isnan(rows.values).any():
                rows = replace(rows, note=self._topics.fault)
            self._on_rows(rows)

    def _check_stamp(self, topic: str, message: Any, now_ns: int) -> None:
        if not self._max_lead_ns or topic in self.feature_map.table_topics:
            return
        lead_ns = (header_stamp_ns(message) or 0) - now_ns
        # Without a time nothing is judged anyway.
        if now_ns and lead_ns > self._max_lead_ns:
            raise InputError(
                f'the stamp of a message on {topic!r} is {lead_ns * 1e-9:.3g} s ahead of the '
                f'clock; allowed is {self._max_lead_ns * 1e-9:g} s, by the parameter max_lead'
            )
