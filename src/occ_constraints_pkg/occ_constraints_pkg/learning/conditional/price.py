# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What an empty corner is worth: expected time, less what the samples in it take of it."""

from __future__ import annotations

import numpy as np

PRICE = 0.05
"""Most that is seen in a corner, as a share of what is expected; it is also the project's share of
bad samples."""

# Seen at most this share of the expected, bad samples included.
_DEPLETED = 0.34


def worth(
    expected: np.ndarray | float,
    seen: np.ndarray | float,
    volume: np.ndarray | float,
    bad: np.ndarray | float,
) -> np.ndarray:
    """Return the share of the time that a corner is worth; -1 where it is not nearly empty.

    Allowed in it are a share of what is expected, and bad samples that are spread evenly: ``bad``
    is the density deep inside, where the tail of good samples does not reach.

    Args:
        expected: share of the time.
        seen: share of the rows.
        volume: share of the units' ranges.
        bad: share of the rows per volume.
    """
    allowed = PRICE * expected + np.minimum(2 * bad, PRICE) * volume
    gain = expected * (1 - seen / np.maximum(allowed, 1e-12))
    return np.where(seen <= _DEPLETED * expected, gain, -1.0)


def allowed_bad(volume: float, bad: float) -> float:
    """Return the share of the rows that bad samples may take of a corner."""
    return min(2 * bad, PRICE) * volume
