# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When messages arrive, by the clock that their ages are measured with."""

from __future__ import annotations

from occ_constraints_pkg.ros.process import OccNode


class ArrivalClock:
    """Wall time, or with ``use_sim_time`` the time on ``/clock``, which may stand still.

    Values that carry no stamp would not age while it does, so whoever judges must ask
    :meth:`problem`.

    Args:
        node: its clock is read.
        patience: seconds that ``/clock`` may stand still while messages arrive.
    """

    def __init__(self, node: OccNode, patience: float) -> None:
        self._node, self._patience = node, patience
        self._now_ns = 0
        # Steady seconds when this time was first read, and when a message came last.
        self._since = self._asked = -patience

    def now_ns(self) -> int:
        """Return the time, for a message that has just come; 0 before the first ``/clock``."""
        time_ns, steady = self._node.ros_ns(), self._node.steady_seconds()
        # Where no message came for a while, a player may have paused, and all is well.
        if time_ns != self._now_ns or steady - self._asked > self._patience:
            self._now_ns, self._since = time_ns, steady
        self._asked = steady
        return time_ns

    def problem(self) -> str:
        """Say why the time that was read last cannot be relied on; empty when it can."""
        if not self._now_ns:
            return 'use_sim_time is set, and nothing has come on /clock'
        if self._asked - self._since > self._patience:
            return f'/clock has stood still for {self._patience:g} s'
        return ''
