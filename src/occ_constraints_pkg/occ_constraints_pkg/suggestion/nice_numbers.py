# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers that people like to read: one or two digits."""

from __future__ import annotations

import math

_NICE = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
# Multiples of these are easily read.
_STEPS = (1.0, 2.0, 2.5, 3.0, 4.0, 5.0)


def nice_below(value: float) -> float:
    """Return the largest nice number that is not above ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    # Single-precision ranges lie a little below the number that is meant.
    found = [nice * power for nice in _NICE if nice * power <= value * (1.0 + 1e-6)]
    return float(f'{max(found, default=power):.6g}')


def nice_above(value: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is not below ``value``."""
    if not 0.0 < value < math.inf:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    found = [nice * power for nice in (1.0, 2.0, 5.0, 10.0) if nice * power >= value * (1.0 - 1e-6)]
    return float(f'{min(found):.6g}')


def nice_between(low: float, high: float) -> list[float]:
    """Return ``low`` and all nice steps above it up to ``high``, in order."""
    power = 10.0 ** math.floor(math.log10(low))
    found = [float(f'{nice * size:.6g}') for size in (power, 10.0 * power) for nice in _STEPS]
    return [low, *(size for size in found if low < size <= high * (1.0 + 1e-6))]
