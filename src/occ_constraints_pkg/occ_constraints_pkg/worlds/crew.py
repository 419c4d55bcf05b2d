# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A few threads that share out one piece of work and finish it together."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from queue import SimpleQueue

_Work = Callable[[int], None]


class Crew:
    """The calling thread and some helpers, for work that releases Python's lock.

    The caller does a share itself, so that with one thread nothing is woken at all. Work goes
    through plain queues: an executor's futures take as long as stepping several robots.

    Attributes:
        size: number of threads, the calling one included.
    """

    def __init__(self, size: int) -> None:
        """Start the helpers; they end with :meth:`close`, or when nobody knows the crew any more.

        Args:
            size: number of threads, the calling one included; at least 1.
        """
        self.size = size
        self._ended: SimpleQueue[BaseException | None] = SimpleQueue()
        self._work: list[SimpleQueue[_Work | None]] = [SimpleQueue() for _ in range(size - 1)]
        self._threads = [
            threading.Thread(target=_help, args=(number, work, self._ended), daemon=True)
            for number, work in enumerate(self._work, start=1)
        ]
        for thread in self._threads:
            thread.start()
        self._stop = weakref.finalize(self, _stop, self._work)

    def share(self, work: _Work) -> None:
        """Call ``work`` with 0 to ``size`` - 1, each on a thread of its own, and wait for all.

        What one of them raises is raised here, once all have ended.
        """
        for queue in self._work:
            queue.put(work)
        try:
            work(0)
        finally:
            errors = [self._ended.get() for _ in self._work]
        for error in errors:
            if error is not None:
                raise error

    def close(self) -> None:
        """Stop the helpers."""
        self._stop()
        for thread in self._threads:
            thread.join()


# Functions and no methods: a thread that knew the crew would keep it alive.
def _help(
    number: int, work: SimpleQueue[_Work | None], ended: SimpleQueue[BaseException | None]
) -> None:
    while (share := work.get()) is not None:
        error = None
        try:
            share(number)
        except BaseException as caught:  # noqa: BLE001 - raised again by the caller
            error = caught
        # What it belongs to may be given up while this thread waits for more.
        del share
        ended.put(error)
        del error


def _stop(work: list[SimpleQueue[_Work | None]]) -> None:
    for queue in work:
        queue.put(None)
