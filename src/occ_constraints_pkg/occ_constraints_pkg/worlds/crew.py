# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A few threads that share out one piece of work and finish it together."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


class Crew:
    """The calling thread and some helpers, for work that releases Python's lock.

    The caller does a share itself: waking one thread less saves as much as stepping several robots
    takes, and with one thread nothing is woken at all.

    Attributes:
        size: number of threads, the calling one included.
    """

    def __init__(self, size: int) -> None:
        """Start no thread yet; helpers start with the first work.

        Args:
            size: number of threads, the calling one included; at least 1.
        """
        self.size = size
        self._helpers = ThreadPoolExecutor(size - 1, 'world') if size > 1 else None

    def share(self, work: Callable[[int], None]) -> None:
        """Call ``work`` with 0 to ``size`` - 1, each on a thread of its own, and wait for all.

        What one of them raises is raised here, once all have ended.
        """
        if self._helpers is None:
            work(0)
            return
        others = [self._helpers.submit(work, number) for number in range(1, self.size)]
        try:
            work(0)
        finally:
            errors = [other.exception() for other in others]
        for error in errors:
            if error is not None:
                raise error

    def close(self) -> None:
        """Stop the helpers."""
        if self._helpers is not None:
            self._helpers.shutdown()
