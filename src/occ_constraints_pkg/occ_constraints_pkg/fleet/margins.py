# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The smallest margin of each short span of the last minutes, in little memory."""

from __future__ import annotations

import math
from array import array

BUCKET_SECONDS = 0.5
"""Of each such span the smallest margin is kept."""
BUCKETS = 600
"""How many spans are kept: five minutes."""


class MarginHistory:
    """A ring of the smallest margins, one for each span of :data:`BUCKET_SECONDS`."""

    def __init__(self) -> None:
        # NaN where nothing came.
        self._values = array('d', [math.nan]) * BUCKETS
        self._newest: int | None = None

    def keep(self, margin: float, when: float) -> None:
        """Take a margin; NaN for an UNKNOWN, which is smaller than any.

        Args:
            margin: of a verdict.
            when: it came; what is older than the newest counts for the newest span.
        """
        span = int(when / BUCKET_SECONDS)
        newest = span if self._newest is None else max(span, self._newest)
        for passed in range(max(newest - BUCKETS, self._newest or 0) + 1, newest + 1):
            self._values[passed % BUCKETS] = math.nan
        value, place = -math.inf if math.isnan(margin) else margin, newest % BUCKETS
        before = self._values[place] if newest == self._newest else math.nan
        self._values[place] = value if math.isnan(before) else min(value, before)
        self._newest = newest

    def newest(self, count: int, now: float) -> list[float | None]:
        """Return the smallest margin of each of the last spans, the present one last.

        Args:
            count: how many spans, at most :data:`BUCKETS`.
            now: the time.

        Returns:
            ``-inf`` for a span with UNKNOWN in it, None for one without a verdict.
        """
        last = int(now / BUCKET_SECONDS)
        return [self._of(span) for span in range(last - count + 1, last + 1)]

    def _of(self, span: int) -> float | None:
        if self._newest is None or not self._newest - BUCKETS < span <= self._newest:
            return None
        value = self._values[span % BUCKETS]
        return None if math.isnan(value) else value
