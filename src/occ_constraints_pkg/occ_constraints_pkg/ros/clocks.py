# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When a message was published and when it arrived."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from occ_constraints_pkg.ros.node import OccNode


class ArrivalClock:
    """Wall time, or with ``use_sim_time`` the time on ``/clock``, which may stand still.

    Values that carry no stamp would not age while it does, so whoever judges must ask
    :meth:`problem`.

    Attributes:
        latest_ns: the time that was read last.

    Args:
        node: its clock is read.
        patience: seconds that ``/clock`` may stand still while messages arrive.
    """

    def __init__(self, node: OccNode, patience: float) -> None:
        self._node, self._patience = node, patience
        self.latest_ns = 0
        # Steady seconds when this time was first read, and when a message came last.
        self._since = self._asked = -patience

    def now_ns(self) -> int:
        """Return the time, for a message that has just come; 0 before the first ``/clock``."""
        time_ns, steady = self._node.ros_ns(), self._node.steady_seconds()
        # Where no message came for a while, a player may have paused, and all is well.
        if time_ns != self.latest_ns or steady - self._asked > self._patience:
            self.latest_ns, self._since = time_ns, steady
        self._asked = steady
        return time_ns

    def problem(self) -> str:
        """Return why the time that was read last cannot be relied on; empty when it can."""
        if not self.latest_ns:
            return 'use_sim_time is set, and nothing has come on /clock'
        if self._asked - self._since > self._patience:
            return f'/clock has stood still for {self._patience:g} s'
        return ''


def with_source_time(callback: Callable[[Any, int], None]) -> Callable[..., None]:
    """Return a callback for a subscription that also gets the time of publishing.

    rclpy passes what the middleware knows of a message to callbacks of two arguments.

    Args:
        callback: called with the message and when it was published, by the publisher's system
            clock in ns; 0 if the middleware does not report it.
    """

    def call(message: Any, info: Any) -> None:
        callback(message, info['source_timestamp'])

    return call
