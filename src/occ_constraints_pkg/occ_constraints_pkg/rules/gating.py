# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How much of a commanded speed may pass, given the verdicts so far."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.verdict import Verdict

# Seconds by which the clock of a publisher may be ahead of ours.
CLOCK_TOLERANCE = 0.1
# How long the reason of a stop takes precedence over the silence after it: a monitor without input
# reports UNKNOWN once a second.
_REASON_SECONDS = 1.5


class Debounce:
    """A switch that trips after some bad samples and releases after some good ones.

    It trips when ``trigger_count`` of the last ``trigger_window`` samples were bad, and releases
    when ``release_count`` samples in a row were good. With 1, 1 and 1 it follows the samples.

    Attributes:
        tripped: whether the switch is on.
        good_in_a_row: samples since the last bad one, or since it was tripped by hand.

    Args:
        trigger_count: bad samples that trip it.
        trigger_window: samples among which they are counted.
        release_count: good samples in a row that release it.

    Raises:
        ConfigurationError: a number is below 1, or the count is larger than the window.
    """

    def __init__(self, trigger_count: int, trigger_window: int, release_count: int) -> None:
        if not 1 <= trigger_count <= trigger_window or release_count < 1:
            raise ConfigurationError(
                f'trigger_count {trigger_count} of trigger_window {trigger_window}, release_count '
                f'{release_count}: allowed are counts from 1 on, and a window of at least '
                'trigger_count'
            )
        self.tripped = False
        self._trigger_count, self._release_count = trigger_count, release_count
        self._window: deque[bool] = deque(maxlen=trigger_window)
        self.good_in_a_row = 0

    @property
    def bad_count(self) -> int:
        """How many samples of the window are bad."""
        return sum(self._window)

    def add(self, is_bad: bool) -> None:
        """Take one more sample."""
        self._window.append(is_bad)
        self.good_in_a_row = 0 if is_bad else self.good_in_a_row + 1
        if self.bad_count >= self._trigger_count:
            self.tripped = True
        elif self.good_in_a_row >= self._release_count:
            self.tripped = False

    def trip(self) -> None:
        """Switch on at once; the count of good samples restarts."""
        self.tripped = True
        self.good_in_a_row = 0


class SteadyVerdict:
    """A debounced verdict for people.

    UNKNOWN applies at once, and is left like a violation: after ``release_count`` safe verdicts in
    a row, or for VIOLATED. It starts as UNKNOWN. See :class:`Debounce` for the arguments; with 1, 1
    and 1 the state is the verdict.

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
        min_speed_scale: part of the speed that is left at margin 0, from 0 to 1.
        trigger_count: verdicts other than SAFE, of the last ``trigger_window``, that stop.
        trigger_window: see there. With 2 of 20, a violation at least once in 19 verdicts stops at
            the second one.
        release_count: safe verdicts in a row that release again.
        timeout: seconds without a verdict that stop, and the largest age of a verdict.

    Raises:
        ConfigurationError: a number is out of its range.
    """

    slow_margin: float = 0.1
    min_speed_scale: float = 0.3
    trigger_count: int = 2
    trigger_window: int = 20
    release_count: int = 5
    timeout: float = 0.5

    def __post_init__(self) -> None:
        if not (
            self.slow_margin >= 0.0 and 0.0 <= self.min_speed_scale <= 1.0 and self.timeout > 0.0
        ):
            raise ConfigurationError(
                f'slow_margin {self.slow_margin}, min_speed_scale {self.min_speed_scale}, timeout '
                f'{self.timeout}: allowed are a margin from 0 on, a part from 0 to 1, and a time '
                'above 0 s'
            )
        Debounce(self.trigger_count, self.trigger_window, self.release_count)


@dataclass(frozen=True)
class GateOutput:
    """What the gate does to commands.

    Attributes:
        scale: factor on the commanded speed, 0 (stop) to 1 (as commanded).
        reason: why it is below 1; empty if it is not.
    """

    scale: float
    reason: str = ''

    @property
    def state(self) -> str:
        """``STOP``, ``SLOW`` or ``PASS``."""
        if self.scale == 0.0:
            return 'STOP'
        return 'SLOW' if self.scale < 1.0 else 'PASS'

    def __str__(self) -> str:
        if self.state == 'SLOW':
            # Rounding must not show it as a stop or as full speed.
            percent = min(99, max(1, round(100.0 * self.scale)))
            return f'SLOW, {percent}%: {self.reason}'
        return f'{self.state}: {self.reason}' if self.reason else self.state


@dataclass(frozen=True)
class Timing:
    """When a verdict was made, according to its message and the middleware, in ns.

    Attributes:
        stamp: of the message's header: that of the input.
        sent: wall time at which its publisher sent it.
        judged: wall time at which the monitor judged; None if the message does not have it.
        wall: the receiver's wall time.
        clock: the receiver's clock, compared with the stamp if ``judged`` is missing.
    """

    stamp: int
    sent: int
    judged: int | None
    wall: int
    clock: int

    @property
    def age(self) -> float:
        """Seconds since the earliest of its times; negative if ahead of the clock."""
        ages = [self.wall - self.sent]
        # The stamp alone is not conclusive: a monitor may judge a recording, or a simulation that
        # runs ahead. Without the time of judging, the stamp must be current.
        ages.append(self.clock - self.stamp if self.judged is None else self.wall - self.judged)
        return max(ages) * 1e-9

    @property
    def lead(self) -> float:
        """Seconds by which the latest of these times is ahead of the clock."""
        leads = [self.sent - self.wall]
        leads.append(self.stamp - self.clock if self.judged is None else self.judged - self.wall)
        return max(leads) * 1e-9


class SpeedGate:
    """Decides from the verdicts of one monitor how much of a commanded speed may pass.

    It is closed until the first verdicts are safe. A safe verdict counts if it is younger than
    ``timeout``, and its stamp and time of sending are later than those of the previous verdict.
    Verdicts that are older, out of order or ahead of the clock stop. A verdict with the stamp of
    the newest one is a repeat: if safe, it is ignored and does not keep the gate open.

    A violation stops after debouncing; until then speed is at its minimum. UNKNOWN and silence stop
    at once. After any stop, ``release_count`` safe verdicts in a row are needed.

    Attributes:
        settings: when it slows down and stops.
        verdict: the newest verdict; UNKNOWN before the first.
    """

    def __init__(self, settings: GateSettings) -> None:
        self.settings = settings
        self.verdict = Verdict.UNKNOWN
        self._debounce = Debounce(
            settings.trigger_count, settings.trigger_window, settings.release_count
        )
        self._debounce.trip()
        self._margin = math.nan
        # Why it is below full speed while the newest verdict is a violation.
        self._text = ''
        # Steady time at which the newest accepted verdict was made.
        self._made = -math.inf
        self._stamp = self._sent = -math.inf
        self._why_stopped, self._tripped = 'no verdict yet', -math.inf

    def judge(self, verdict: Verdict, margin: float, text: str, timing: Timing, now: float) -> None:
        """Take one verdict.

        Args:
            verdict: of the monitor.
            margin: of the monitor, only used if SAFE. If not finite, as without an enabled rule,
                the verdict counts as UNKNOWN.
            text: the verdict in words, for the reason.
            timing: when it was made.
            now: steady time in seconds.
        """
        if self._is_silent(now):
            if self.has_begun:
                self._debounce.trip()
                self._why_stopped = self._silence()
            # After silence, stamps may restart, as with a simulation or a restarted monitor.
            self._stamp = self._sent = -math.inf
        problem = self._problem(timing)
        if not problem:
            is_repeat = timing.stamp == self._stamp or timing.sent == self._sent
            self._stamp = max(self._stamp, timing.stamp)
            self._sent = max(self._sent, timing.sent)
            if is_repeat and verdict is Verdict.SAFE:
                return
            self._made = now - max(0.0, timing.age)
        if verdict is Verdict.SAFE and not math.isfinite(margin):
            verdict, text = Verdict.UNKNOWN, f'UNKNOWN: SAFE with the margin {margin:g}'
        self.verdict, self._margin, self._text = verdict, margin, text
        self._debounce.add(verdict is not Verdict.SAFE)
        if verdict is not Verdict.SAFE:
            self._why_stopped = text
        if problem:
            self.trip(problem if verdict is Verdict.SAFE else f'{text}; {problem}', now)
        elif verdict is Verdict.UNKNOWN:
            self.trip(text, now)

    def trip(self, reason: str, now: float) -> None:
        """Stop at once, for this reason; a full release is needed."""
        self._debounce.trip()
        self._why_stopped, self._tripped = reason, now

    def output(self, now: float) -> GateOutput:
        """Return what to do with commands at steady time ``now`` in seconds."""
        is_silent = self._is_silent(now) and self.has_begun
        if is_silent and now - self._tripped > _REASON_SECONDS:
            return GateOutput(0.0, self._silence())
        if is_silent or self._debounce.tripped:
            return GateOutput(0.0, self._why_stopped)
        settings = self.settings
        if self.verdict is Verdict.VIOLATED:
            verdict, _, rule = self._text.partition(': ')
            count = f'({self._debounce.bad_count} of {settings.trigger_count})'
            reason = f'{verdict} {count}: {rule}' if rule else f'{verdict} {count}'
            return GateOutput(settings.min_speed_scale, reason)
        if self._margin >= settings.slow_margin:
            return GateOutput(1.0)
        inside = max(0.0, self._margin) / settings.slow_margin if settings.slow_margin else 0.0
        scale = settings.min_speed_scale + (1.0 - settings.min_speed_scale) * inside
        return GateOutput(scale, f'margin {self._margin:.3g} is below {settings.slow_margin:g}')

    @property
    def safe_in_a_row(self) -> int:
        """How many verdicts have been safe since the last that was not, or since a stop."""
        return self._debounce.good_in_a_row

    @property
    def has_begun(self) -> bool:
        """Whether any verdict has been accepted yet."""
        return not math.isinf(self._made)

    def age(self, now: float) -> float:
        """Return the seconds since the newest accepted verdict was made; inf before the first."""
        return now - self._made

    def _problem(self, timing: Timing) -> str:
        """Return why a verdict says nothing about now; empty if it does."""
        limit = self.settings.timeout
        if timing.age > limit:
            return f'a verdict came that was made more than {limit:g} s ago'
        if timing.lead > CLOCK_TOLERANCE:
            return (
                f'a verdict came from more than {CLOCK_TOLERANCE:g} s ahead of the clock here; '
                'are the clocks of both computers set?'
            )
        if timing.stamp < self._stamp:
            return 'a verdict came whose stamp is before that of an earlier one'
        if timing.sent < self._sent:
            return 'a verdict came that was sent before an earlier one'
        return ''

    def _is_silent(self, now: float) -> bool:
        return self.age(now) > self.settings.timeout

    def _silence(self) -> str:
        reason = f'no verdict for {self.settings.timeout:g} s'
        return reason if self.verdict is Verdict.SAFE else f'{reason}, the last was {self._text}'
