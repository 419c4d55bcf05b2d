# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How much of a commanded speed may pass, given the verdicts so far."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.verdict import Verdict


class Debounce:
    """A switch that trips after some bad samples and releases after some good ones.

    It trips when ``trigger_count`` of the last ``trigger_window`` samples were bad, and releases
    when ``release_count`` samples in a row were good. With 1, 1 and 1 it follows the samples.

    Attributes:
        tripped: whether the switch is on.

    Args:
        trigger_count: bad samples that trip it.
        trigger_window: samples among which they are counted.
        release_count: good samples in a row that release it.

    Raises:
        OccError: a number is below 1, or the count is larger than the window.
    """

    def __init__(self, trigger_count: int, trigger_window: int, release_count: int) -> None:
        if not 1 <= trigger_count <= trigger_window or release_count < 1:
            raise OccError(
                f'trigger_count {trigger_count} of trigger_window {trigger_window}, release_count '
                f'{release_count}: allowed are counts from 1 on, and a window of at least '
                'trigger_count'
            )
        self.tripped = False
        self._trigger_count, self._release_count = trigger_count, release_count
        self._window: deque[bool] = deque(maxlen=trigger_window)
        self._good_in_a_row = 0

    def add(self, is_bad: bool) -> None:
        """Take one more sample."""
        self._window.append(is_bad)
        self._good_in_a_row = 0 if is_bad else self._good_in_a_row + 1
        if sum(self._window) >= self._trigger_count:
            self.tripped = True
        elif self._good_in_a_row >= self._release_count:
            self.tripped = False

    def trip(self) -> None:
        """Switch on at once; the good samples are counted anew."""
        self.tripped = True
        self._good_in_a_row = 0


class SteadyVerdict:
    """A verdict that does not flicker, for people: VIOLATED after debouncing, SAFE likewise.

    UNKNOWN is taken over at once, and left only as a violation is: after ``release_count`` safe
    verdicts in a row, or for VIOLATED. It begins with UNKNOWN. See :class:`Debounce` for the
    arguments; with 1, 1 and 1 the state is the verdict.

    Attributes:
        state: the steady verdict.
    """

    def __init__(self, trigger_count: int, trigger_window: int, release_count: int) -> None:
        self._debounce = Debounce(trigger_count, trigger_window, release_count)
        self._debounce.trip()
        self.state = Verdict.UNKNOWN

    def add(self, verdict: Verdict) -> Verdict:
        """Take one more verdict and return the state."""
        self._debounce.add(verdict is not Verdict.SAFE)
        if verdict is Verdict.UNKNOWN:
            self._debounce.trip()
        if not self._debounce.tripped:
            self.state = Verdict.SAFE
        elif verdict is not Verdict.SAFE:
            self.state = verdict
        return self.state


@dataclass(frozen=True)
class GateSettings:
    """When a gate slows down and stops.

    Attributes:
        slow_margin: margin, in parts of the demonstrated range, under which speed is scaled down;
            0: never.
        slowest: part of the speed that is left at margin 0, from 0 to 1.
        trigger_count: violated verdicts of the last ``trigger_window`` that stop.
        trigger_window: see there.
        release_count: safe verdicts in a row that let go again.
        timeout: seconds without a verdict that stop.

    Raises:
        OccError: a number is out of its range.
    """

    slow_margin: float = 0.1
    slowest: float = 0.3
    trigger_count: int = 2
    trigger_window: int = 3
    release_count: int = 5
    timeout: float = 0.5

    def __post_init__(self) -> None:
        if not (self.slow_margin >= 0.0 and 0.0 <= self.slowest <= 1.0 and self.timeout > 0.0):
            raise OccError(
                f'slow_margin {self.slow_margin}, slowest {self.slowest}, timeout {self.timeout}: '
                'allowed are a margin from 0 on, a part from 0 to 1, and a time above 0 s'
            )
        Debounce(self.trigger_count, self.trigger_window, self.release_count)


@dataclass(frozen=True)
class Passage:
    """What a gate lets through.

    Attributes:
        scale: factor on the commanded speed, 0 (stop) to 1 (as commanded).
        reason: why it is below 1; empty if it is not.
    """

    scale: float
    reason: str = ''


class SpeedGate:
    """Decides from verdicts how much of a commanded speed may pass.

    It is shut until the first verdicts are safe. A violation stops after debouncing; until then
    speed is at its slowest. UNKNOWN stops at once, and so does silence. After any stop,
    ``release_count`` safe verdicts in a row are needed.
    """

    def __init__(self, settings: GateSettings) -> None:
        self.settings = settings
        self._debounce = Debounce(
            settings.trigger_count, settings.trigger_window, settings.release_count
        )
        self._debounce.trip()
        self._margin = math.nan
        self._heard = -math.inf
        self._why_stopped = 'no verdict yet'

    def judge(self, verdict: Verdict, margin: float, words: str, now: float) -> None:
        """Take one verdict.

        Args:
            verdict: of the monitor.
            margin: the monitor's; only read if SAFE. One that is no number counts as UNKNOWN.
            words: the verdict in words, for the reason.
            now: steady time in seconds.
        """
        if self._is_silent(now):
            self._debounce.trip()
            if not math.isinf(self._heard):
                self._why_stopped = self._silence()
        self._heard, self._margin = now, margin
        if verdict is Verdict.UNKNOWN or (verdict is Verdict.SAFE and math.isnan(margin)):
            self._debounce.add(True)
            self._debounce.trip()
        else:
            self._debounce.add(verdict is Verdict.VIOLATED)
        if verdict is not Verdict.SAFE:
            self._why_stopped = words
            # Not yet tripped: as slow as at the boundary.
            self._margin = 0.0

    def passage(self, now: float) -> Passage:
        """Return what may pass at steady time ``now`` in seconds."""
        if math.isinf(self._heard):
            return Passage(0.0, self._why_stopped)
        if self._is_silent(now):
            return Passage(0.0, self._silence())
        if self._debounce.tripped:
            return Passage(0.0, self._why_stopped)
        slow, slowest = self.settings.slow_margin, self.settings.slowest
        if self._margin >= slow:
            return Passage(1.0)
        inside = max(0.0, self._margin) / slow if slow > 0.0 else 0.0
        return Passage(slowest + (1.0 - slowest) * inside, f'margin {self._margin:.3g}')

    def _is_silent(self, now: float) -> bool:
        return now - self._heard > self.settings.timeout

    def _silence(self) -> str:
        return f'no verdict for {self.settings.timeout:g} s'
