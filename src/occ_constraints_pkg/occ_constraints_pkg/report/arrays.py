# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Arrays of numbers as text that the program of a page reads back bit for bit."""

from __future__ import annotations

import base64

import numpy as np


def packed(values: np.ndarray, kind: type[np.generic]) -> str:
    """Return (n,) values as little-endian numbers in base64.

    Args:
        values: the numbers.
        kind: ``np.float64``, ``np.float32``, ``np.int32`` or ``np.uint8``.
    """
    little = np.dtype(kind).newbyteorder('<')
    return base64.b64encode(np.ascontiguousarray(values, dtype=little).tobytes()).decode('ascii')
