# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg.worlds.worker``: a process that steps a share of the robots."""

from __future__ import annotations

import signal
import sys

if __name__ == '__main__':
    # Before anything that takes time: whoever stops all processes of a program means the one that
    # this one helps. It may have much to finish, and this one ends with it.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)

import pkgutil
import time

from occ_constraints_pkg.stopping import parent_is_gone
from occ_constraints_pkg.worlds.shared_arrays import SharedArrays
from occ_constraints_pkg.worlds.wake_up_channel import Line
from occ_constraints_pkg.worlds.worker_pool import DONE, WORK


def main(world: str, num_envs: int, capacity: int, descriptor: int, *line: int) -> None:
    """Step robots as :class:`~occ_constraints_pkg.worlds.worker_pool.Crew` asks, until it is gone.

    Args:
        world: module and class, as ``module:class``.
        num_envs: number of robots of the whole world.
        capacity: size of its arrays' file in bytes.
        descriptor: of that file.
        line: descriptors of the line through which the crew asks.
    """
    arrays = SharedArrays(capacity, descriptor)
    stepped = pkgutil.resolve_name(world)(num_envs, processes=1, arrays=arrays)
    crew = Line(line)
    while work := crew.receive(WORK.size, parent_is_gone):
        stepped.advance(slice(*WORK.unpack(work)))
        try:
            crew.send(DONE.pack(time.monotonic()))
        except ConnectionError:
            return


if __name__ == '__main__':
    main(sys.argv[1], *(int(number) for number in sys.argv[2:]))
