# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Arrays that several processes have in common."""

from __future__ import annotations

import mmap
import os

import numpy as np
from numpy.typing import DTypeLike


class SharedArrays:
    """Hands out arrays that lie in a file without a name, in memory.

    A process that is given the file, and asks for arrays of the same shapes in the same order, gets
    the same arrays: what one process writes the other one reads.

    Attributes:
        descriptor: of the file.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        """Start with no arrays.

        Args:
            descriptor: the file of another process's arrays, open in this process; ``None`` makes
                a new one.
        """
        self._is_owner = descriptor is None
        self.descriptor = os.memfd_create('occ_arrays') if descriptor is None else descriptor
        self._size = 0

    def zeros(self, shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> np.ndarray:
        """Return the next array, full of zeros when its owner asks for it.

        Args:
            shape: of the array.
            dtype: of its elements.
        """
        wanted = np.empty(shape, dtype)
        if wanted.size == 0:
            return wanted
        start = self._size
        # Maps begin at whole pages.
        self._size += -(-wanted.nbytes // mmap.ALLOCATIONGRANULARITY) * mmap.ALLOCATIONGRANULARITY
        if self._is_owner:
            os.ftruncate(self.descriptor, self._size)
        # The array keeps the map, and the map the memory, also when the file is closed.
        memory = mmap.mmap(self.descriptor, wanted.nbytes, offset=start)
        return np.frombuffer(memory, wanted.dtype).reshape(wanted.shape)

    def close(self) -> None:
        """Close the file; arrays handed out stay as they are, and there will be no more."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1
