# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Arrays that several processes have in common."""

from __future__ import annotations

import mmap
import os

import numpy as np
from numpy.typing import DTypeLike

from occ_constraints_pkg.worlds.wake_up_channel import above_standard

# Whole cache lines, so that no array shares one with another.
_ALIGNMENT = 64


class SharedArrays:
    """Hands out arrays that lie in a file without a name, in memory.

    A process that is given the file, and asks for arrays of the same shapes in the same order, gets
    the same arrays: what one process writes the other one reads.

    Attributes:
        capacity: size of the file in bytes.
        descriptor: of the file.
    """

    def __init__(self, capacity: int, descriptor: int | None = None) -> None:
        """Start with no arrays.

        Args:
            capacity: room for all of them in bytes; what is not handed out takes no memory.
            descriptor: the file of another process's arrays, open in this process; ``None`` makes
                a new one.
        """
        if descriptor is None:
            descriptor = above_standard(os.memfd_create('occ_arrays'))
            os.ftruncate(descriptor, capacity)
        self.capacity, self.descriptor = capacity, descriptor
        # The arrays keep the map, and the map the memory, also when the file is closed.
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
        """Close the file; arrays handed out stay as they are."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1
