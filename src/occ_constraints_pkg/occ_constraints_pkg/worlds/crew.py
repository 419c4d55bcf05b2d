# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Processes that share out the robots of one world and step them together."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from itertools import accumulate

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.line import Line

WORK = struct.Struct('<qqq')
"""What a helper is told: the number of the work, and its first and last robot (exclusive)."""
DONE = struct.Struct('<qd')
"""What it answers: the number of the work, and when it was done, by the machine's monotonic clock
in s."""
# How much of a difference in time the next share makes up for; it is mostly chance.
_GAIN = 0.05


class Crew:
    """The calling process and some helpers, each of which steps a row of robots.

    Helpers are processes, because most of a step is Python and NumPy, which one process does in
    one thread at a time. They build the same world on the same :class:`SharedArrays`, so that
    all they need to be told is which robots to step. They start from scratch, not as copies of
    the calling process, which may run threads and hold devices; and they end when it does, for
    whatever reason, because their line to it is then cut.

    Attributes:
        size: number of processes, the calling one included.
    """

    def __init__(self, world: type, num_envs: int, descriptor: int, size: int) -> None:
        """Start the helpers; they end with :meth:`close`, or when nobody knows the crew any more.

        Args:
            world: class of the world, found in its module under its name.
            num_envs: number of robots N.
            descriptor: file of the arrays of the caller's world.
            size: number of processes, the calling one included; at least 1.
        """
        self.size = size
        self._work = 0
        self._bounds = [num_envs * number // size for number in range(1, size + 1)]
        # What part of all work each process gets, and how long they took for it.
        self._parts = [1.0 / size] * size
        self._times = [1.0] * size
        self._helpers = [_Helper(world, num_envs, descriptor) for _ in range(size - 1)]
        self._stop = weakref.finalize(self, _stop, self._helpers)

    def share(self, costs: np.ndarray, work: Callable[[slice], None]) -> None:
        """Have every robot worked on, and wait for the end.

        Robots in a row go to one process. Where the rows end is chosen for all to be done at about
        the same time, from the costs and from how long the processes took of late.

        Args:
            costs: (N,) how long each robot takes, in any unit, in memory that ``work`` updates.
            work: what the calling process does with its share.

        Raises:
            OccError: a helper is gone. The robots are then in no sound state.
        """
        if not self._helpers:
            work(slice(0, len(costs)))
            return
        self._work += 1
        bounds = self._bounds
        begun = time.monotonic()
        for helper, low, high in zip(self._helpers, bounds, bounds[1:], strict=False):
            helper.begin(self._work, low, high)
        try:
            work(slice(0, bounds[0]))
            # While the helpers are still at it, so that it takes no time.
            self._plan(costs)
            ended = time.monotonic()
        finally:
            theirs = [helper.wait(self._work) for helper in self._helpers]
        self._times = [end - begun for end in (ended, *theirs)]

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

    def close(self) -> None:
        """End the helpers."""
        self._stop()


class _Helper:
    def __init__(self, world: type, num_envs: int, descriptor: int) -> None:
        self._line, theirs = Line.pair()
        numbers = (num_envs, descriptor, *theirs.descriptors)
        environment = os.environ | {
            # What was added to the path since the start counts as well.
            'PYTHONPATH': os.pathsep.join(entry or os.getcwd() for entry in sys.path),
            # There are no matrices in a world, but a pool of threads for them would be started.
            'OPENBLAS_NUM_THREADS': '1',
        }
        self._process = subprocess.Popen(
            [
                sys.executable,
                '-P',
                '-m',
                'occ_constraints_pkg.worlds.helper',
                f'{world.__module__}:{world.__qualname__}',
                *(str(number) for number in numbers),
            ],
            stdin=subprocess.DEVNULL,
            pass_fds=numbers[1:],
            env=environment,
            # Ctrl-C is meant for the calling process, which ends its helpers itself.
            process_group=0,
        )
        theirs.close()

    def begin(self, number: int, low: int, high: int) -> None:
        try:
            self._line.send(WORK.pack(number, low, high))
        except BrokenPipeError:
            self._raise()

    def wait(self, number: int) -> float:
        # An answer to earlier work is there where waiting for it was interrupted.
        while True:
            answer = self._line.receive(DONE.size)
            if not answer:
                self._raise()
            answered, ended = DONE.unpack(answer)
            if answered == number:
                return ended

    def stop(self) -> None:
        self._line.close()
        self._process.wait()

    def _raise(self) -> None:
        code = self._process.wait()
        raise OccError(
            f'a process that steps robots of this world has ended with code {code}; '
            'what it may have said stands above'
        )


# A function and no method: a finalizer that knew the crew would keep it alive.
def _stop(helpers: list[_Helper]) -> None:
    for helper in helpers:
        helper.stop()
