# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a calibration promises about false alarms, as a record and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

CONFIDENCE = 0.9
"""How sure the statement about this very rule set is; the promise itself is a mean over draws."""

# Vanished rules that are named; families have as many as members.
_MOST_NAMED = 4


@dataclass(frozen=True)
class Calibration:
    """What was promised, and what it rests on.

    Attributes:
        false_alarm: the stated probability.
        episodes: how many episodes were calibrated on.
        rank: which of their scores, in ascending order and from 1 on, is the tolerance.
        margin: the tolerance: how far bounds were moved outward, in units of the margin, that is,
            in parts of each feature's demonstrated range.
        bound: the probability that is promised, at most the stated one.
        likely_bound: the rate of alarms of this rule set is at most that, unless the draw of the
            episodes was among the worst tenth.
        alarms_before: in how many of the episodes there was an alarm before the move.
        alarms_after: the same after it.
        vanished: rules that went with the move, each as ``ID: words``: their bounds passed a
            physical limit, or the gap that they flagged closed.
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


def promise_words(calibration: Mapping[str, Any]) -> str:
    """Return the promise that a constraints file records (see :meth:`Calibration.document`)."""
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


def loss_words(calibration: Mapping[str, Any]) -> str:
    """Return what a calibration took away, in one sentence; empty if no rule vanished."""
    vanished = list(calibration['vanished'])
    if not vanished:
        return ''
    more = f' and {len(vanished) - _MOST_NAMED} more' if len(vanished) > _MOST_NAMED else ''
    return (
        f'{len(vanished)} rules vanished when the bounds were moved, for the episodes that were '
        f'calibrated on go beyond them: {"; ".join(vanished[:_MOST_NAMED])}{more}; to keep them, '
        'calibrate on episodes known to be safe, or promise a larger probability'
    )
