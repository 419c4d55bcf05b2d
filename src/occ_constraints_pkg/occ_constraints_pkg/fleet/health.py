# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How the verdicts on one robot come: how often, how late, from how many, to how many."""

from __future__ import annotations

import math
from collections import deque

RATE_SECONDS = 5.0
"""Time over which verdicts are counted."""
_SPAN_SECONDS = 0.5
# With a longer one, stamps are of simulated time or of a recording and say nothing of a delay.
_LONGEST_DELAY_SECONDS = 600.0


class Health:
    """Counts verdicts and keeps what is known of the way that they take.

    Attributes:
        delay: seconds from the stamp of the newest input to its verdict; NaN where unknown.
        queue: verdicts that waited at the last look, and how many can wait.
        subscribers: nodes that subscribe to the verdicts, whoever shows them not counted.
        doubts: what the monitor doubts of its sensors; empty for nothing.
    """

    def __init__(self) -> None:
        self.delay = math.nan
        self.queue = (0, 0)
        self.subscribers = 0
        self.doubts = ''
        # Number of the span, and how many came in it.
        self._counts: deque[list[int]] = deque(maxlen=int(RATE_SECONDS / _SPAN_SECONDS) + 1)
        self._begin: float | None = None

    def hear(self, when: float, judged_at_ns: int | None, stamp_ns: int) -> None:
        """Count a verdict.

        Args:
            when: it came, on a steady clock.
            judged_at_ns: wall time of judging; None where unknown.
            stamp_ns: of the input.
        """
        if self._begin is None:
            self._begin = when
        delay = math.nan if judged_at_ns is None else (judged_at_ns - stamp_ns) / 1e9
        self.delay = delay if stamp_ns and abs(delay) <= _LONGEST_DELAY_SECONDS else math.nan
        span = int(when / _SPAN_SECONDS)
        if self._counts and self._counts[-1][0] >= span:
            self._counts[-1][1] += 1
        else:
            self._counts.append([span, 1])

    def rate(self, now: float) -> float:
        """Return how many verdicts a second came within the last :data:`RATE_SECONDS`."""
        if self._begin is None:
            return 0.0
        # Whole spans only: the present one is not over.
        last = int(now / _SPAN_SECONDS)
        first = max(last - int(RATE_SECONDS / _SPAN_SECONDS), int(self._begin / _SPAN_SECONDS))
        counted = sum(count for span, count in self._counts if first <= span < last)
        return counted / (_SPAN_SECONDS * (last - first)) if last > first else 0.0
