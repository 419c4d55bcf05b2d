# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Worker processes that divide the robots of a world among them and step them in parallel."""

from __future__ import annotations

import mmap
import os
import signal
import struct
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from itertools import accumulate

import numpy as np
from numpy.typing import DTypeLike

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.stopping import PARENT_VARIABLE, stop_request
from occ_constraints_pkg.worlds.wake_up_channel import WakeUpChannel, above_standard

# Whole cache lines, so that no array shares one with another.
_ALIGNMENT = 64


class SharedArrays:
    """Allocates arrays in an anonymous in-memory file.

    A process that gets the file and asks for the same shapes in the same order gets the same
    memory: what one process writes the other reads.

    Attributes:
        capacity: size of the file in bytes.
        descriptor: of the file.
    """

    def __init__(self, capacity: int, descriptor: int | None = None) -> None:
        """Start with no arrays.

        Args:
            capacity: size of the file in bytes; what is not allocated takes no memory.
            descriptor: an open file of another process's arrays; ``None`` makes a new one.
        """
        if descriptor is None:
            descriptor = above_standard(os.memfd_create('occ_arrays'))
            os.ftruncate(descriptor, capacity)
        self.capacity, self.descriptor = capacity, descriptor
        # The arrays keep the mapping alive, also when the file is closed.
        self._memory = mmap.mmap(descriptor, capacity)
        self._end = 0

    def zeros(self, shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> np.ndarray:
        """Return the next array, full of zeros when it is new.

        Args:
            shape: of the array.
            dtype: of its elements.
        """
        start = self._end
        array = np.ndarray(shape, dtype, self._memory, start)
        self._end += -(-array.nbytes // _ALIGNMENT) * _ALIGNMENT
        return array

    def close(self) -> None:
        """Close the file; arrays stay as they are."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


WORK = struct.Struct('<qq')
"""Request to a worker: its first and last robot (exclusive)."""
DONE = struct.Struct('<d')
"""Its answer: when it was done, by the monotonic clock of the machine, in s."""
# Share of a difference in time that the next division corrects; most of it is noise.
_GAIN = 0.05
# Size of the shared arrays in bytes; what is not used takes no memory.
_BYTES, _BYTES_PER_ROBOT = 1 << 16, 1 << 13


class WorkerError(OccError):
    """Worker processes of a world cannot be started, or have ended."""


class WorkerPool:
    """The calling process and some workers, each of which steps a row of robots.

    Workers are processes, because most of a step is Python and NumPy, which one process does in
    one thread at a time. They build the same world on the same :class:`SharedArrays`, so that
    all they need to be told is which robots to step. They start from scratch, not as copies of
    the calling process, which may run threads and hold devices; and they end when it does, for
    whatever reason.

    Attributes:
        size: number of processes, the calling one included.
        arrays: those that all of them know; ``None`` where there are no workers.
    """

    def __init__(self, world: type, num_envs: int, size: int) -> None:
        """Start the workers; they end with :meth:`close`, or when the pool is garbage collected.

        Args:
            world: class of the world, importable by the workers; takes ``num_envs``, ``processes``
                and ``arrays``, and has ``advance(rows)``.
            num_envs: number of robots N.
            size: number of processes, the calling one included; at least 1.

        Raises:
            WorkerError: they cannot be started.
        """
        if size > 1 and not is_importable(world):
            raise WorkerError(
                f'{world.__qualname__} of {world.__module__} was asked for {size} processes; '
                'a world of a script, or within a function, is stepped by 1: '
                'others could not import it'
            )
        self.size = size
        self._num_envs = num_envs
        self._owner = os.getpid()
        self._command = [
            *(sys.executable, '-P', '-m', 'occ_constraints_pkg.worlds.worker'),
            *(f'{world.__module__}:{world.__qualname__}', str(num_envs)),
        ]
        capacity = _BYTES + _BYTES_PER_ROBOT * num_envs
        try:
            self.arrays = SharedArrays(capacity) if size > 1 else None
        except OSError as error:
            raise self._start_error(error) from error
        self._workers: list[_Worker] = []
        self._stop = weakref.finalize(self, _stop, self._workers, self.arrays)
        self._start_workers()

    def check(self) -> None:
        """Refuse a process that may not change the robots.

        Raises:
            WorkerError: it is a fork of the process that made the pool, or the pool is closed.
        """
        if self.size == 1:
            return
        if os.getpid() != self._owner:
            raise WorkerError(
                'a world of several processes is used in a copy of the process that made it; '
                'make it there, or with processes=1'
            )
        if not self._stop.alive:
            raise WorkerError('a world is used after it was closed')

    def share(self, costs: np.ndarray, work: Callable[[slice], None]) -> None:
        """Run ``work`` on every robot, in parallel, and wait for the end.

        Each process gets a contiguous range. The ranges are chosen from the costs and from how long
        the processes took recently, so that all finish at about the same time.

        After an exception, an interruption by the user included, the state of the robots is
        undefined, no worker is running any more, and the next call starts new ones.

        Args:
            costs: (N,) how long each robot takes, in any unit, updated by ``work``.
            work: steps the range of the calling process.

        Raises:
            WorkerError: a worker is gone or cannot be started.
        """
        if self.size == 1:
            work(slice(0, len(costs)))
            return
        self.check()
        if not self._workers:
            self._start_workers()
        bounds = self._bounds
        begun = time.monotonic()
        try:
            for worker, low, high in zip(self._workers, bounds, bounds[1:], strict=False):
                worker.begin(low, high)
            work(slice(0, bounds[0]))
            # While the workers are still busy, so that it costs no time.
            self._plan(costs)
            ended = [time.monotonic(), *(worker.wait() for worker in self._workers)]
        except BaseException:
            _end(self._workers)
            raise
        self._times = [end - begun for end in ended]

    def close(self) -> None:
        """End the workers; the pool cannot be used afterwards."""
        self._stop()

    def _start_workers(self) -> None:
        """Start the workers; divide evenly until it is known how long they take."""
        self._bounds = [self._num_envs * number // self.size for number in range(1, self.size + 1)]
        # Share of the work of each process, and how long it took.
        self._parts = [1.0 / self.size] * self.size
        self._times = [1.0] * self.size
        try:
            for _ in range(self.size - 1):
                assert self.arrays is not None
                self._workers.append(_Worker(self._command, self.arrays))
        except OSError as error:
            self._stop()
            raise self._start_error(error) from error

    def _start_error(self, error: OSError) -> WorkerError:
        return WorkerError(
            f'a world was asked for {self.size} processes, which cannot be started: '
            f'{error.strerror}; fewer may be allowed'
        )

    def _plan(self, costs: np.ndarray) -> None:
        """Choose the ranges of the next call."""
        mean = sum(self._times) / self.size
        parts = [
            part * (1 - _GAIN * min(taken / mean - 1, 1))
            for part, taken in zip(self._parts, self._times, strict=True)
        ]
        whole = sum(parts)
        self._parts = [part / whole for part in parts]
        ends = list(accumulate(self._parts))[:-1]
        # By its middle, a robot on a bound goes to the side that most of its cost lies on.
        middles = costs.cumsum()
        total = middles[-1]
        middles -= 0.5 * costs
        self._bounds = [*middles.searchsorted([total * end for end in ends]).tolist(), len(costs)]


class _Worker:
    def __init__(self, command: list[str], arrays: SharedArrays) -> None:
        environment = os.environ | {
            # Including what was added to the path since the start.
            'PYTHONPATH': os.pathsep.join(
                os.path.abspath(entry) for entry in sys.path if isinstance(entry, str)
            ),
            # Worlds multiply no large matrices, but BLAS would start its threads.
            'OPENBLAS_NUM_THREADS': '1',
            PARENT_VARIABLE: str(os.getpid()),
        }
        self._channel, theirs = WakeUpChannel.pair()
        handed_over = (arrays.descriptor, *theirs.descriptors)
        try:
            self._process = subprocess.Popen(
                [*command, str(arrays.capacity), *(str(number) for number in handed_over)],
                stdin=subprocess.DEVNULL,
                pass_fds=handed_over,
                env=environment,
                # Ctrl-C goes to the calling process, which ends its workers itself.
                process_group=0,
            )
        except OSError:
            self._channel.close()
            raise
        finally:
            theirs.close()

    def begin(self, low: int, high: int) -> None:
        try:
            self._channel.send(WORK.pack(low, high))
        except ConnectionError:
            self._raise()

    def wait(self) -> float:
        answer = self._channel.receive(DONE.size, self._resume_suspended)
        if not answer:
            self._raise()
        return DONE.unpack(answer)[0]

    def _resume_suspended(self) -> bool:
        # A program that was asked to stop completes its step; a suspended worker must run for that.
        if stop_request.made:
            self._process.send_signal(signal.SIGCONT)
        return False

    def kill(self) -> None:
        self._channel.close()
        # It has nothing to save, and may be suspended or still starting.
        self._process.kill()

    def join(self) -> None:
        self._process.wait()

    def _raise(self) -> None:
        code = self._process.wait()
        raise WorkerError(
            f'a process that steps robots of this world has ended with code {code}; '
            'see its output above'
        )


def is_importable(world: type) -> bool:
    """Return whether other processes can import the class of a world."""
    return world.__module__ != '__main__' and '<locals>' not in world.__qualname__


# Functions, not methods: a finalizer that refers to the pool would keep it alive.
def _end(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.join()
    workers.clear()


def _stop(workers: list[_Worker], arrays: SharedArrays | None) -> None:
    _end(workers)
    if arrays is not None:
        arrays.close()
