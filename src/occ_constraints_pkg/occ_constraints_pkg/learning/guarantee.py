# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a calibration guarantees about false alarms, as a record and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from occ_constraints_pkg.wording import count_of

CONFIDENCE = 0.9
"""Of the bound for this very rule set; the guarantee itself is a mean over draws."""

# Vanished rules that are named.
_MOST_NAMED = 4


@dataclass(frozen=True)
class Calibration:
    """What is guaranteed, and what it rests on.

    Attributes:
        false_alarm: the stated probability.
        episodes: how many episodes were calibrated on.
        rank: which of their scores, in ascending order and from 1 on, is the tolerance.
        margin: the tolerance: how far bounds were moved outward, in units of the margin, that is,
            in parts of each feature's demonstrated range.
        bound: the guaranteed probability, at most the stated one.
        likely_bound: 90 % confidence bound on this rule set's own rate of alarms.
        alarms_before: in how many of the episodes there was an alarm before the move.
        alarms_after: the same after it.
        vanished: rules dropped by the move, each as ``ID: words``: their bounds passed a physical
            limit, or the gap that they flagged closed.
    """

    false_alarm: float
    episodes: int
    rank: int
    margin: float
    bound: float
    likely_bound: float
    alarms_before: int
    alarms_after: int
    vanished: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return plain values for the constraints file."""
        return {**asdict(self), 'vanished': list(self.vanished)}


def guarantee_words(calibration: Mapping[str, Any]) -> str:
    """Return the guarantee that a constraints file records (see :meth:`Calibration.document`)."""
    moved = (
        f'bounds were moved outward by {calibration["margin"]:.3g} of the demonstrated ranges'
        if calibration['margin']
        else 'no bound had to be moved'
    )
    return (
        'False alarms: a fresh safe episode raises one with probability at most '
        f'{calibration["false_alarm"]:g} (bound {calibration["bound"]:.3g} from '
        f'{calibration["episodes"]} safe episodes; for these very rules at most '
        f'{calibration["likely_bound"]:.3g} with {CONFIDENCE:.0%} confidence); {moved}, '
        f'{calibration["alarms_before"]} of the episodes raised one before and '
        f'{calibration["alarms_after"]} after'
    )


def loss_words(calibration: Mapping[str, Any] | None) -> str:
    """Return which rules a calibration dropped, in one sentence; empty if none."""
    vanished = list(calibration['vanished']) if calibration else []
    if not vanished:
        return ''
    more = f' and {len(vanished) - _MOST_NAMED} more' if len(vanished) > _MOST_NAMED else ''
    return (
        f'{count_of(len(vanished), "rule")} dropped when the bounds were moved, for the episodes '
        f'calibrated on go beyond them: {"; ".join(vanished[:_MOST_NAMED])}{more}; to keep them, '
        'calibrate on episodes known to be safe, or allow a larger probability'
    )
