# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What an empty corner is worth: expected time, less what the samples in it take of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

PRICE = 0.02
"""Most good samples in a corner, as a share of what is expected."""

MOST_BAD = 0.05
"""Largest share of bad samples, spread evenly over the ranges of a corner's units."""

# Seen at most this share of the expected, bad samples included.
_DEPLETED = 0.34
# Rows for each visit of bad samples at most.
_LONGEST = 1.3


class Seen(NamedTuple):
    """What is seen in a corner, or in many.

    Attributes:
        share: of the rows.
        new: share of the rows that are in no earlier rule.
    """

    share: np.ndarray | float
    new: np.ndarray | float


def worth(
    expected: np.ndarray | float,
    seen: Seen,
    volume: np.ndarray | float,
    bad: np.ndarray | float,
) -> np.ndarray:
    """Return the share of the time that a corner is worth; -1 where it is not nearly empty.

    Bad samples are spread evenly and cost nothing: their density is taken from deep inside, where
    the tail of good samples does not reach. What is seen besides costs its multiple.

    Args:
        expected: share of the time.
        seen: in the corner.
        volume: share of the units' ranges.
        bad: share of the rows per volume, see :func:`bad_share`.
    """
    good = np.minimum(np.maximum(seen.share - allowed_bad(volume, bad), 0.0), seen.new)
    return np.where(seen.new <= _DEPLETED * expected, expected - good / PRICE, -1.0)


def allowed_bad(volume: np.ndarray | float, bad: np.ndarray | float) -> np.ndarray:
    """Return the share of the rows that bad samples may take of a corner."""
    return np.minimum(bad, MOST_BAD) * volume


def bad_share(count: np.ndarray | float, rows: int, volume: np.ndarray | float) -> np.ndarray:
    """Return the density of bad samples, as high as chance lets it be: share per volume.

    Args:
        count: rows deep inside a corner.
        rows: all of them.
        volume: share of the units' ranges deep inside.
    """
    return (count + np.sqrt(count)) / rows / np.maximum(volume, 1e-12)


def is_isolated(rows: int, visits: int) -> bool:
    """Tell whether rows are isolated in time, as bad samples are; good ones stay for a while.

    Args:
        rows: in some region.
        visits: runs of consecutive rows that they are.
    """
    return rows <= _LONGEST * visits
