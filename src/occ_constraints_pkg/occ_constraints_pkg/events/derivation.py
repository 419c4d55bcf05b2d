# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From the verdicts on one robot, in their order, to events: live and offline alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.events.event import Event, Stamps, new_id
from occ_constraints_pkg.events.reasons import Reasons
from occ_constraints_pkg.rules.verdict import Verdict

# By how much a next input may come late, after which a violation without one is told as over.
_PATIENCE_NS = 1_000_000_000

Change = tuple[Event, str]
"""An event as it is now, and the phase to tell: ``began``, ``update`` or ``ended``."""


@dataclass(frozen=True)
class Settings:
    """What counts as one event.

    Attributes:
        bridge: seconds; two violations of one rule that are no further apart count as one.
        timeout: seconds that a verdict is valid without new input.
        near_margin: a SAFE verdict with a smaller margin is a near miss; 0: none is.

    Raises:
        ConfigurationError: a number is negative or not finite.
    """

    bridge: float = 0.5
    timeout: float = 1.0
    near_margin: float = 0.0

    def __post_init__(self) -> None:
        if not all(0.0 <= value < math.inf for value in vars(self).values()):
            raise ConfigurationError(
                f'bridge {self.bridge}, timeout {self.timeout}, near_margin {self.near_margin}: '
                'allowed are finite numbers from 0 on'
            )


@dataclass(frozen=True, eq=False)
class RuleSample:
    """One rule in one sample: violated, or the closest one.

    Attributes:
        rule: its id.
        text: in words; of a family, with the member that decides.
        margin: of this rule.
        values: of the features that it names.
        bounds: its literals, see :class:`Event`.
    """

    rule: str
    text: str
    margin: float
    values: Mapping[str, float] = field(default_factory=dict)
    bounds: tuple[Mapping[str, Any], ...] = ()


def _no_rule() -> RuleSample | None:
    return None


@dataclass(frozen=True, eq=False)
class Sample:
    """A verdict on one robot.

    Attributes:
        verdict: of the rules.
        margin: NaN where UNKNOWN.
        stamp: of the input, in ns.
        wall: wall time in ns at which it was judged.
        steady: the same on a clock that is never set, in ns.
        rules: all that are violated.
        reason: why it is UNKNOWN.
        rule_set: fingerprint of the rules; None where there are none.
        episode: of the robot; another number begins a new one.
        is_answer: whether an input was judged; else it tells that none can be.
        nearest: returns the rule that is closest to being violated, if that is known.
    """

    verdict: Verdict
    margin: float
    stamp: int
    wall: int
    steady: int
    rules: tuple[RuleSample, ...] = ()
    reason: str = ''
    rule_set: str | None = None
    episode: float = 0
    is_answer: bool = True
    nearest: Callable[[], RuleSample | None] = _no_rule


class VerdictEvents:
    """Turns the verdicts on one robot into events of violations, UNKNOWN and near misses.

    What belongs together is decided as ``occ check`` does. An event of a rule begins with a sample
    on which it is true and ends with the next on which it is not, in any case after the timeout
    and with the episode; two that are at most ``bridge`` apart are one. Distances are those of
    stamps, which are the same when a recording is played, however fast; where stamps stand still
    or go back, those of arrival. So an event is over only once ``bridge`` has passed.

    Args:
        robot: see :class:`Event`.
        settings: what counts as one event.
    """

    def __init__(self, robot: str, settings: Settings) -> None:
        self._robot, self._settings = robot, settings
        self._bridge, self._timeout = round(settings.bridge * 1e9), round(settings.timeout * 1e9)
        # What goes on or may yet go on, by what it is about: a rule's id, or a kind.
        self._open: dict[tuple[str, str], _Open] = {}
        self._last: Sample | None = None
        # Number of the last sample, its distance from the first, and how long it took to come.
        self._row = self._position = self._step = 0
        self._head = _Head(0, 0)

    @property
    def newest(self) -> Sample | None:
        """The newest verdict on an input; None before the first."""
        return self._last

    @property
    def is_unjudged(self) -> bool:
        """Whether the newest verdict is that no input can be judged."""
        event = self._open.get(('unjudged', ''))
        return event is not None and event.is_unbroken

    def add(self, sample: Sample) -> list[Change]:
        """Take one verdict; return what is to be told of it."""
        if not sample.is_answer:
            return self._add_unjudged(sample)
        last = self._last
        if last is not None and _is_repeat(sample, last):
            return []
        changes: list[Change] = []
        if last is not None and last.rule_set != sample.rule_set:
            changes += self._end_all(sample.steady, 'the rules were changed')
        if last is not None and last.episode != sample.episode:
            changes += self._end_all(sample.steady, '')
        if last is None:
            self._head = _Head(sample.stamp, 0)
        else:
            self._advance(last, sample)
            if last.episode != sample.episode:
                self._head = _Head(sample.stamp, self._position)
        self._row += 1
        self._last = sample
        present = dict(self._present(sample))
        for key, event in list(self._open.items()):
            is_joined = event.is_unbroken or self._position - event.end <= self._bridge
            if key[0] == 'unjudged':
                changes += self._end_unjudged(sample.steady)
            elif not is_joined:
                changes += self._end(key)
            elif key not in present:
                event.is_unbroken = False
        for key, rule in present.items():
            if key in self._open:
                changes += self._open[key].add(sample, rule)
            else:
                self._open[key] = _Open(self._robot, key[0], sample, rule)
                changes += self._open[key].told('began')
            self._open[key].row, self._open[key].is_unbroken = self._row, True
        return changes

    def tick(self, steady: int) -> list[Change]:
        """End what no further input can continue; to be called now and then while none comes."""
        changes = self._end_unjudged(steady)
        limit = self._timeout + self._bridge + _PATIENCE_NS
        if self._last is not None and steady - self._last.steady > limit:
            for key, event in list(self._open.items()):
                if key[0] != 'unjudged':
                    if event.row == self._row:
                        event.ended = self._last.steady + self._timeout
                    changes += self._end(key)
        return changes

    def close(self, steady: int, reason: str) -> list[Change]:
        """End all that goes on, for this reason."""
        return self._end_all(steady, reason, unjudged=True)

    def _present(self, sample: Sample) -> Iterable[tuple[tuple[str, str], RuleSample | None]]:
        """Yield what the sample belongs to."""
        if sample.verdict is Verdict.UNKNOWN:
            yield ('unknown', ''), None
        for rule in sample.rules:
            yield ('violation', rule.rule), rule
        is_near = sample.margin < self._settings.near_margin
        if self._settings.near_margin and sample.verdict is not Verdict.UNKNOWN and is_near:
            yield ('near_miss', ''), None

    def _advance(self, last: Sample, sample: Sample) -> None:
        """Go on to another sample, and see how long the one before was valid."""
        elapsed = max(0, sample.steady - last.steady)
        position = self._head.position(sample, self._position, elapsed)
        step = position - self._position
        valid = min(step, self._timeout)
        for key, event in self._open.items():
            if event.row == self._row and key[0] != 'unjudged':
                event.end = self._position + valid
                event.ended = last.steady + min(elapsed, self._timeout)
                event.is_unbroken = event.is_unbroken and valid == step
        self._position = position
        if sample.stamp != self._head.stamp:
            self._head = _Head(sample.stamp, position)
        self._step = min(elapsed, self._timeout)

    def _add_unjudged(self, sample: Sample) -> list[Change]:
        key = ('unjudged', '')
        changes = self._end_unjudged(sample.steady)
        event = self._open.get(key)
        if event is None:
            event = self._open[key] = _Open(self._robot, 'unknown', sample, None)
            changes += event.told('began')
        else:
            changes += event.add(sample, None)
        event.row, event.is_unbroken = self._row, True
        return changes

    def _end_unjudged(self, steady: int) -> list[Change]:
        """Let the time without any verdict end with a sample, and tell so after the bridge."""
        key = ('unjudged', '')
        event = self._open.get(key)
        if event is None:
            return []
        if event.is_unbroken and self._last is not None and self._row > event.row:
            event.ended, event.is_unbroken = self._last.steady, False
        is_over = not event.is_unbroken and steady - event.ended > self._bridge
        return self._end(key) if is_over else []

    def _end_all(self, steady: int, reason: str, *, unjudged: bool = False) -> list[Change]:
        changes: list[Change] = []
        for key, event in list(self._open.items()):
            if key[0] == 'unjudged':
                if not unjudged:
                    continue
                event.ended = steady if event.is_unbroken else event.ended
            elif event.row == self._row and self._last is not None:
                event.ended = self._last.steady + min(steady - self._last.steady, self._step)
            if reason and event.is_unbroken:
                event.reasons.add(reason)
            changes += self._end(key)
        return changes

    def _end(self, key: tuple[str, str]) -> list[Change]:
        event = self._open.pop(key)
        if event.kind != 'near_miss':
            return event.told('ended')
        # Only now is it known that it has not become a violation.
        return [] if event.is_spoiled else [(event.value(None), 'began'), *event.told('ended')]


@dataclass(frozen=True)
class _Head:
    """The first sample of a stamp: the stamp, and how far time had gone on then."""

    stamp: int
    at: int

    def position(self, sample: Sample, before: int, elapsed: int) -> int:
        """Return how far time has gone on at the next sample, see ``progress`` in ``checking``."""
        step = sample.stamp - self.stamp
        return max(before, self.at + step) if step > 0 else before + elapsed


class _Open:
    """An event that goes on, or is over for less than the bridge.

    Attributes:
        kind: of the event.
        row: number of the last sample that belongs to it.
        end: position of its end.
        ended: steady time of its end.
        is_unbroken: whether it holds for the newest sample.
        is_spoiled: whether a violation belongs to it, so that it is no near miss.
        reasons: why.
    """

    def __init__(self, robot: str, kind: str, sample: Sample, rule: RuleSample | None) -> None:
        self.kind, self.row, self.end = kind, 0, 0
        self.ended = sample.steady
        self.is_unbroken = True
        self.is_spoiled = sample.verdict is Verdict.VIOLATED
        self.reasons = Reasons(sample.reason)
        self._robot, self._id = robot, new_id(sample.wall)
        self._first = self._last = self._worst = sample
        self._rule, self._is_asked = rule, False
        self._margin = sample.margin if rule is None else rule.margin

    def add(self, sample: Sample, rule: RuleSample | None) -> list[Change]:
        """Take another sample that belongs to it; return whether it is the worst so far."""
        self._ask()
        self._last = sample
        self.is_spoiled |= sample.verdict is Verdict.VIOLATED
        is_news = self.reasons.add(sample.reason)
        margin = sample.margin if rule is None else rule.margin
        if margin < self._margin:
            self._worst, self._margin, self._rule, self._is_asked = sample, margin, rule, False
            is_news = True
        return self.told('update') if is_news else []

    def told(self, phase: str) -> list[Change]:
        """Return the change to tell; near misses are told when they are over."""
        if self.kind == 'near_miss' and phase != 'ended':
            return []
        return [(self.value(self.ended if phase == 'ended' else None), phase)]

    def value(self, ended: int | None) -> Event:
        """Return the event as it is now; ``ended`` is a steady time."""
        self._ask()
        first, worst, rule = self._first, self._worst, self._rule
        # Not by later wall times: the clock may have been set meanwhile.
        offset = first.wall - first.steady
        return Event(
            id=self._id,
            kind=self.kind,
            robot=self._robot,
            text=self._text(),
            began=first.wall,
            worst=worst.steady + offset,
            ended=None if ended is None else ended + offset,
            rule=None if rule is None else rule.rule,
            values={} if rule is None else rule.values,
            bounds=() if rule is None else rule.bounds,
            margin=self._margin,
            rule_set=first.rule_set,
            reason=str(self.reasons),
            stamps=Stamps(first.stamp, worst.stamp, self._last.stamp),
        )

    def _text(self) -> str:
        if self.kind == 'unknown':
            return f'UNKNOWN: {self.reasons.first}'
        if self.kind == 'violation':
            return '' if self._rule is None else self._rule.text
        close = '' if self._rule is None else f': close to {self._rule.text}'
        return f'margin {self._margin:.3g}{close}'

    def _ask(self) -> None:
        """Ask for the rule that a near miss is about, while that is still known."""
        if self.kind == 'near_miss' and not self._is_asked and not self.is_spoiled:
            nearest = self._worst.nearest()
            self._rule, self._is_asked = nearest, nearest is not None


def _is_repeat(sample: Sample, last: Sample) -> bool:
    """Return whether a verdict is that before once more, as of an input that was sent again."""
    if sample.stamp != last.stamp or sample.verdict is not last.verdict:
        return False
    is_same_margin = sample.margin == last.margin or (
        math.isnan(sample.margin) and math.isnan(last.margin)
    )
    return is_same_margin and [item.rule for item in sample.rules] == [
        item.rule for item in last.rules
    ]
