# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg.worlds.worker``: a process that steps a share of the robots."""

from __future__ import annotations

import signal
import sys

if __name__ == '__main__':
    # First of all: a signal to the whole process group is meant for the main process. It may have
    # to finish something, and this process ends with it.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)

import pkgutil
import time

from occ_constraints_pkg.stopping import parent_is_gone
from occ_constraints_pkg.worlds.wake_up_channel import WakeUpChannel
from occ_constraints_pkg.worlds.worker_pool import DONE, WORK, SharedArrays


def main(world: str, num_envs: int, capacity: int, descriptor: int, *channel: int) -> None:
    """Step robots on the pool's request until the pool is gone.

    Args:
        world: module and class, as ``module:class``.
        num_envs: number of robots of the whole world.
        capacity: size of the file of the shared arrays, in bytes.
        descriptor: of that file.
        channel: descriptors of the wake-up channel to the pool.
    """
    arrays = SharedArrays(capacity, descriptor)
    stepped = pkgutil.resolve_name(world)(num_envs, processes=1, arrays=arrays)
    pool = WakeUpChannel(channel)
    while work := pool.receive(WORK.size, parent_is_gone):
        stepped.advance(slice(*WORK.unpack(work)))
        try:
            pool.send(DONE.pack(time.monotonic()))
        except ConnectionError:
            return


if __name__ == '__main__':
    main(sys.argv[1], *(int(number) for number in sys.argv[2:]))
