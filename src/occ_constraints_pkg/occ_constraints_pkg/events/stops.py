# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Why the robot stopped: the states of a gate, joined with the events that caused them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from occ_constraints_pkg.events.derivation import Change
from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.reasons import Reasons
from occ_constraints_pkg.wording import count_of

# A gate tells its state once a second.
LOST_NS = 3_500_000_000
"""Time without a word of a gate after which it counts as gone."""

# How long before a stop its cause may have ended, for a gate counts among its last verdicts, and
# how long after it began we may hear of the cause.
_BEFORE_NS, _AFTER_NS = 10_000_000_000, 1_000_000_000
# A time that a gate tells is believed if it is no older when it changes.
_DELAY_NS = 2_000_000_000
_STOP = 'STOP'


@dataclass(frozen=True)
class GateSample:
    """What a gate tells of itself.

    Attributes:
        state: ``PASS``, ``SLOW`` or ``STOP``.
        reason: why it is not ``PASS``.
        since: wall time in ns at which it came to this state, by the gate's clock; 0: not told.
        wall: wall time in ns at which it was heard.
        steady: the same on a clock that is never set, in ns.
        rules: ids of the rules that its newest verdicts name as violated.
        safe_in_a_row: safe verdicts since the last other one; None: not told.
    """

    state: str
    reason: str
    since: int
    wall: int
    steady: int
    rules: tuple[str, ...] = ()
    safe_in_a_row: int | None = None


class StopEvents:
    """Turns the states of one gate into events of kind ``stop``.

    A gate that was heard and is silent for :data:`LOST_NS` lets nothing pass, and so is a stop too.

    Args:
        robot: see :class:`Event`.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._open: _Stop | None = None
        self._last: GateSample | None = None

    def add(self, sample: GateSample, recent: Sequence[Event]) -> list[Change]:
        """Take a state; return what is to be told of it.

        Args:
            sample: the state.
            recent: events that may be its cause, in the order of their beginnings.
        """
        is_first, self._last = self._last is None, sample
        stop = self._open
        if sample.state == _STOP:
            if stop is not None:
                return stop.go_on(sample, recent)
            self._open = _Stop(self._robot, sample, _began(sample, is_first))
            self._open.find_cause(recent)
            return [(self._open.value(), 'began')]
        if stop is None:
            return []
        self._open = None
        stop.find_cause(recent)
        age = sample.wall - sample.since
        released = sample.steady - (age if 0 <= age <= _DELAY_NS else 0)
        safe = sample.safe_in_a_row
        how = f', released after {count_of(safe, "safe verdict")}' if safe else ', released'
        return [(stop.value(max(released, stop.steady), how=how), 'ended')]

    def tick(self, wall: int, steady: int, recent: Sequence[Event]) -> list[Change]:
        """See whether the gate is still there; to be called now and then."""
        last = self._last
        if last is None or steady - last.steady <= LOST_NS:
            return []
        reason = 'the gate is silent: without one no command passes'
        if self._open is not None:
            return self._open.add_reason(reason)
        gone = GateSample(_STOP, reason, 0, wall - (steady - last.steady), last.steady)
        self._open = _Stop(self._robot, gone, gone)
        return [(self._open.value(), 'began')]

    def close(self, steady: int, reason: str) -> list[Change]:
        """End what goes on, for this reason."""
        stop, self._open = self._open, None
        if stop is None:
            return []
        stop.add_reason(reason)
        return [(stop.value(steady, how=''), 'ended')]


def _began(sample: GateSample, is_first: bool) -> GateSample:
    """Return the beginning of a stop, as the gate tells it if that can be believed."""
    age = sample.wall - sample.since
    if not sample.since or age < 0 or (age > _DELAY_NS and not is_first):
        age = 0
    return GateSample(
        sample.state, sample.reason, sample.since, sample.wall - age, sample.steady - age
    )


class _Stop:
    """A stop that goes on.

    Attributes:
        steady: when it began.
    """

    def __init__(self, robot: str, sample: GateSample, began: GateSample) -> None:
        self._robot, self._id = robot, new_id(began.wall)
        self._wall, self.steady = began.wall, began.steady
        self._rules: tuple[str, ...] = sample.rules
        self._reasons = Reasons(sample.reason)
        self._cause: Event | None = None

    def go_on(self, sample: GateSample, recent: Sequence[Event]) -> list[Change]:
        """Take another state while stopped."""
        is_news = self._reasons.add(sample.reason)
        if not self._rules and sample.steady - self.steady <= _AFTER_NS:
            self._rules = sample.rules
        return [(self.value(), 'update')] if self.find_cause(recent) or is_news else []

    def add_reason(self, reason: str) -> list[Change]:
        """Take a further reason, told once."""
        return [(self.value(), 'update')] if self._reasons.add(reason) else []

    def find_cause(self, recent: Iterable[Event]) -> bool:
        """Look for the event that made the gate stop; return whether it is another or worse one."""
        before, known = self._cause, None if self._cause is None else self._cause.id
        for event in recent:
            if event.id == known:
                self._cause = event
            elif known is None and self._may_be_cause(event):
                # The newest one stays.
                self._cause = event
        after = self._cause
        return after is not None and (before is None or after.margin != before.margin)

    def _may_be_cause(self, event: Event) -> bool:
        if event.began > self._wall + _AFTER_NS:
            return False
        if event.ended is not None and event.ended < self._wall - _BEFORE_NS:
            return False
        if event.kind == 'violation':
            return event.rule in self._rules
        is_over = event.ended is not None and event.ended < self._wall - _AFTER_NS
        return event.kind == 'unknown' and not self._rules and not is_over

    def value(self, ended: int | None = None, *, how: str = '') -> Event:
        """Return the event as it is now.

        Args:
            ended: steady time of the end.
            how: how it ended, for the end of the text.
        """
        cause = self._cause
        end = None if ended is None else self._wall + ended - self.steady
        return Event(
            id=self._id,
            kind='stop',
            robot=self._robot,
            text=self._text(end, how),
            began=self._wall,
            worst=self._wall,
            ended=end,
            rule=None if cause is None else cause.rule,
            values={} if cause is None else cause.values,
            bounds=() if cause is None else cause.bounds,
            margin=float('nan') if cause is None else cause.margin,
            rule_set=None if cause is None else cause.rule_set,
            reason=str(self._reasons),
            cause=None if cause is None else cause.id,
        )

    def _text(self, ended: int | None, how: str) -> str:
        clock = time.strftime('%H:%M:%S', time.localtime(self._wall // 1_000_000_000))
        cause = self._cause
        if cause is None:
            why = self._reasons.first or 'no reason was told'
        elif cause.rule is None:
            why = cause.text
        else:
            why = f'{cause.text} (rule {cause.rule}, margin {cause.margin:.3g})'
        if ended is None:
            return f'stopped {clock}: {why}'
        seconds = max(0, ended - self._wall) * 1e-9
        return f'stopped {clock} for {seconds:.1f} s: {why}{how}'
