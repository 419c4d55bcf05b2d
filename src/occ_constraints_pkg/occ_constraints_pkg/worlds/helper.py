# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg.worlds.helper``: a process that steps a share of the robots."""

from __future__ import annotations

import pkgutil
import sys
import time

from occ_constraints_pkg.worlds.crew import DONE, WORK
from occ_constraints_pkg.worlds.line import Line
from occ_constraints_pkg.worlds.shared_arrays import SharedArrays


def main(world: str, num_envs: int, descriptor: int, *line: int) -> None:
    """Step robots as :class:`~occ_constraints_pkg.worlds.crew.Crew` asks, until it is gone.

    Args:
        world: module and class, as ``module:class``.
        num_envs: number of robots of the whole world.
        descriptor: file of its arrays.
        line: descriptors of the line through which the crew asks.
    """
    arrays = SharedArrays(descriptor)
    stepped = pkgutil.resolve_name(world)(num_envs, processes=1, arrays=arrays)
    arrays.close()
    crew = Line(line)
    while work := crew.receive(WORK.size):
        number, low, high = WORK.unpack(work)
        stepped.advance(slice(low, high))
        try:
            crew.send(DONE.pack(number, time.monotonic()))
        except BrokenPipeError:
            return


if __name__ == '__main__':
    main(sys.argv[1], *(int(number) for number in sys.argv[2:]))
