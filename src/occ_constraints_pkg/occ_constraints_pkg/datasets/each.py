# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The same work on many recordings, each by itself, in several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from threading import Thread
from typing import Any, TypeVar

from occ_constraints_pkg.errors import DataError

_STOPS = (signal.SIGINT, signal.SIGTERM)
_Item = TypeVar('_Item')
_Result = TypeVar('_Result')


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


def in_processes(
    work: Callable[[_Item], _Result],
    items: Sequence[_Item],
    processes: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[_Result]:
    """Do the same to many items, in several processes, and return what comes of each.

    When it is interrupted, the processes are ended.

    Args:
        work: what to do; it, the items and the results travel between processes.
        items: what to do it to.
        processes: how many work at a time; with one, this process does it all.
        progress: called with (items done, items in all).

    Raises:
        DataError: a process ended, as when memory runs out.
    """
    results: list[Any] = [None] * len(items)
    with _mapped(work, items, min(processes, len(items))) as done:
        for count, (place, result) in enumerate(done, start=1):
            results[place] = result
            if progress is not None:
                progress(count, len(items))
    return results


@contextmanager
def _mapped(
    work: Callable[[_Item], _Result], items: Sequence[_Item], processes: int
) -> Iterator[Iterator[tuple[int, _Result]]]:
    if processes < 2:
        yield ((place, work(item)) for place, item in enumerate(items))
        return
    with ProcessPoolExecutor(processes, initializer=_obey_parent) as pool:
        try:
            # In the middle of a fork, the exception of a Ctrl-C may be lost, or be the child's.
            with _signals_later():
                places = {pool.submit(work, item): place for place, item in enumerate(items)}
            yield ((places[future], future.result()) for future in as_completed(places))
        except BrokenProcessPool as error:
            raise DataError(
                'a process ended before its work was done, as when memory runs out; allowed are '
                'fewer processes'
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


@contextmanager
def _signals_later() -> Iterator[None]:
    """Let requests to stop wait for the end of the block; processes that start in it inherit it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _obey_parent() -> None:
    """Leave Ctrl-C, which all processes of a terminal get, to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPS)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    # It may have been killed, and then nobody tells this process that there is no more to do.
    wait([parent.sentinel])
    os._exit(1)
