# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What an empty corner is worth: expected time, less what the samples in it take of it."""

from __future__ import annotations

import numpy as np

PRICE = 0.02
"""Most that is seen in a corner, as a share of what is expected."""

MOST_BAD = 0.05
"""Largest share of bad samples, spread evenly over the ranges of a corner's units."""

# Seen at most this share of the expected, bad samples included.
_DEPLETED = 0.34
# Rows for each visit of bad samples at most.
_LONGEST = 1.3


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
    allowed = PRICE * expected + np.minimum(2 * bad, MOST_BAD) * volume
    gain = expected * (1 - seen / np.maximum(allowed, 1e-12))
    return np.where(seen <= _DEPLETED * expected, gain, -1.0)


def allowed_bad(volume: float, bad: float) -> float:
    """Return the share of the rows that bad samples may take of a corner."""
    return min(2 * bad, MOST_BAD) * volume


def is_isolated(rows: int, visits: int) -> bool:
    """Tell whether rows are isolated in time, as bad samples are; good ones stay for a while.

    Args:
        rows: in some region.
        visits: runs of consecutive rows that they are.
    """
    return rows <= _LONGEST * visits
