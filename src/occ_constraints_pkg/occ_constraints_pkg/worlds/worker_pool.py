# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Processes that share out the robots of one world and step them together."""

from __future__ import annotations

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

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.stopping import PARENT_VARIABLE, stop_request
from occ_constraints_pkg.worlds.shared_arrays import SharedArrays
from occ_constraints_pkg.worlds.wake_up_channel import Line

WORK = struct.Struct('<qq')
"""What a helper is told: its first and last robot (exclusive)."""
DONE = struct.Struct('<d')
"""What it answers: when it was done, by the machine's monotonic clock in s."""
# How much of a difference in time the next share makes up for; it is mostly chance.
_GAIN = 0.05
# Room for the arrays that a crew shares, in bytes; what is not used takes no memory.
_BYTES, _BYTES_PER_ROBOT = 1 << 16, 1 << 13


class HelperError(OccError):
    """Processes that step robots of a world cannot be started, or are gone."""


class Crew:
    """The calling process and some helpers, each of which steps a row of robots.

    Helpers are processes, because most of a step is Python and NumPy, which one process does in
    one thread at a time. They build the same world on the same :class:`SharedArrays`, so that
    all they need to be told is which robots to step. They start from scratch, not as copies of
    the calling process, which may run threads and hold devices; and they end when it does, for
    whatever reason.

    Attributes:
        size: number of processes, the calling one included.
        arrays: those that all of them know; ``None`` where there are no helpers.
    """

    def __init__(self, world: type, num_envs: int, size: int) -> None:
        """Start the helpers; they end with :meth:`close`, or when nobody knows the crew any more.

        Args:
            world: class of the world, which the helpers import from its module. Its objects can be
                made with ``num_envs``, ``processes`` and ``arrays``, and have ``advance(rows)``.
            num_envs: number of robots N.
            size: number of processes, the calling one included; at least 1.

        Raises:
            HelperError: they cannot be started.
        """
        if size > 1 and not can_help(world):
            raise HelperError(
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
            raise self._cannot_start(error) from error
        self._helpers: list[_Helper] = []
        self._stop = weakref.finalize(self, _stop, self._helpers, self.arrays)
        self._begin_anew()

    def check(self) -> None:
        """Do nothing if this process may change the robots.

        Raises:
            HelperError: it is a copy of the process that made the crew, or the crew is closed.
        """
        if self.size == 1:
            return
        if os.getpid() != self._owner:
            raise HelperError(
                'a world of several processes is used in a copy of the process that made it; '
                'make it there, or with processes=1'
            )
        if not self._stop.alive:
            raise HelperError('a world is used after it was closed')

    def share(self, costs: np.ndarray, work: Callable[[slice], None]) -> None:
        """Have every robot worked on, and wait for the end.

        Robots in a row go to one process. Where the rows end is chosen for all to be done at about
        the same time, from the costs and from how long the processes took of late.

        Whatever is raised, an interruption by the user included, the robots are in no sound state
        then, no helper is working on them any more, and the next call starts new ones.

        Args:
            costs: (N,) how long each robot takes, in any unit, in memory that ``work`` updates.
            work: what the calling process does with its share.

        Raises:
            HelperError: a helper is gone or cannot be started.
        """
        if self.size == 1:
            work(slice(0, len(costs)))
            return
        self.check()
        if not self._helpers:
            self._begin_anew()
        bounds = self._bounds
        begun = time.monotonic()
        try:
            for helper, low, high in zip(self._helpers, bounds, bounds[1:], strict=False):
                helper.begin(low, high)
            work(slice(0, bounds[0]))
            # While the helpers are still at it, so that it takes no time.
            self._plan(costs)
            ended = [time.monotonic(), *(helper.wait() for helper in self._helpers)]
        except BaseException:
            _end(self._helpers)
            raise
        self._times = [end - begun for end in ended]

    def close(self) -> None:
        """End the helpers; the crew cannot be used afterwards."""
        self._stop()

    def _begin_anew(self) -> None:
        """Start the helpers, and share out evenly until it is known how long they take."""
        self._bounds = [self._num_envs * number // self.size for number in range(1, self.size + 1)]
        # What part of all work each process gets, and how long they took for it.
        self._parts = [1.0 / self.size] * self.size
        self._times = [1.0] * self.size
        try:
            for _ in range(self.size - 1):
                self._helpers.append(_Helper(self._command, self.arrays))
        except OSError as error:
            self._stop()
            raise self._cannot_start(error) from error

    def _cannot_start(self, error: OSError) -> HelperError:
        return HelperError(
            f'a world was asked for {self.size} processes, which cannot be started: '
            f'{error.strerror}; fewer may be allowed'
        )

    def _plan(self, costs: np.ndarray) -> None:
        """Say where the rows of robots end the next time."""
        mean = sum(self._times) / self.size
        parts = [
            part * (1 - _GAIN * min(taken / mean - 1, 1))
            for part, taken in zip(self._parts, self._times, strict=True)
        ]
        whole = sum(parts)
        self._parts = [part / whole for part in parts]
        ends = list(accumulate(self._parts))[:-1]
        # Middles, so that a robot right on a bound goes to the side that more of it lies on.
        middles = costs.cumsum()
        total = middles[-1]
        middles -= 0.5 * costs
        self._bounds = [*middles.searchsorted([total * end for end in ends]).tolist(), len(costs)]


class _Helper:
    def __init__(self, command: list[str], arrays: SharedArrays) -> None:
        environment = os.environ | {
            # What was added to the path since the start counts as well.
            'PYTHONPATH': os.pathsep.join(
                os.path.abspath(entry) for entry in sys.path if isinstance(entry, str)
            ),
            # There are no matrices in a world, but a pool of threads for them would be started.
            'OPENBLAS_NUM_THREADS': '1',
            PARENT_VARIABLE: str(os.getpid()),
        }
        self._line, theirs = Line.pair()
        handed_over = (arrays.descriptor, *theirs.descriptors)
        try:
            self._process = subprocess.Popen(
                [*command, str(arrays.capacity), *(str(number) for number in handed_over)],
                stdin=subprocess.DEVNULL,
                pass_fds=handed_over,
                env=environment,
                # Ctrl-C is meant for the calling process, which ends its helpers itself.
                process_group=0,
            )
        except OSError:
            self._line.close()
            raise
        finally:
            theirs.close()

    def begin(self, low: int, high: int) -> None:
        try:
            self._line.send(WORK.pack(low, high))
        except ConnectionError:
            self._raise()

    def wait(self) -> float:
        answer = self._line.receive(DONE.size, self._let_end)
        if not answer:
            self._raise()
        return DONE.unpack(answer)[0]

    def _let_end(self) -> bool:
        # A program that was asked to end lets its step end first, which a stopped helper would not.
        if stop_request.made:
            self._process.send_signal(signal.SIGCONT)
        return False

    def kill(self) -> None:
        self._line.close()
        # It has nothing to lose, and may be stopped or still starting.
        self._process.kill()

    def join(self) -> None:
        self._process.wait()

    def _raise(self) -> None:
        code = self._process.wait()
        raise HelperError(
            f'a process that steps robots of this world has ended with code {code}; '
            'what it may have said stands above'
        )


def can_help(world: type) -> bool:
    """Return whether other processes can import a world's class."""
    return world.__module__ != '__main__' and '<locals>' not in world.__qualname__


# Functions and no methods: a finalizer that knew the crew would keep it alive.
def _end(helpers: list[_Helper]) -> None:
    for helper in helpers:
        helper.kill()
    for helper in helpers:
        helper.join()
    helpers.clear()


def _stop(helpers: list[_Helper], arrays: SharedArrays | None) -> None:
    _end(helpers)
    if arrays is not None:
        arrays.close()
