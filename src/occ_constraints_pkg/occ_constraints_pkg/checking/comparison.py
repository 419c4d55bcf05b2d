# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What got worse from one set of recordings to another, or from one rule file to another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ_constraints_pkg.checking.timeline import Interval, Timeline
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

TOLERANCE_SECONDS = 0.5
"""Lengths that differ by no more count as the same, and moments no further apart as one."""

DEEPER = 0.05
"""A margin that is smaller by more, in parts of the demonstrated range, counts as deeper."""

LEAST_COVERED = 0.9
"""A recording that covers less of the time of its counterpart is too short to compare."""


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two that are compared: its recordings, judged by its rules.

    Attributes:
        name: what the user calls it.
        timeline: of all its recordings.
        rule_set: the rules that judged.
        names: of the recordings, in the order of the timeline's sources.
    """

    name: str
    timeline: Timeline
    rule_set: RuleSet
    names: tuple[str, ...]


@dataclass(frozen=True)
class Times:
    """For how long each verdict holds in a recording, in the timeline's unit.

    Attributes:
        safe: SAFE.
        violated: VIOLATED.
        unknown: UNKNOWN, and without new input.
    """

    safe: float
    violated: float
    unknown: float

    @property
    def total(self) -> float:
        """All of them together."""
        return self.safe + self.violated + self.unknown


@dataclass(frozen=True, eq=False)
class Change:
    """Violations of one rule around one moment, before and after.

    Attributes:
        kind: ``new`` and ``gone``; ``longer``, ``shorter``, else ``deeper``, ``shallower`` and
            ``same``.
        before: the intervals before; empty for ``new``.
        after: the intervals after; empty for ``gone``.
        is_same_rule: whether both are of one rule, or of rules that stand for each other; else
            another rule is violated at the same moment.
        seconds: by how much longer the rule is true.
        depth: by how much the smallest margin fell, in parts of the demonstrated range; ``None``
            where there is nothing to compare it with.
        unjudged: for how much of the violation before nothing is known after: UNKNOWN, no new
            input, or past the end.
        is_worse: whether it is new, longer or deeper, or can no longer be judged.
    """

    kind: str
    before: tuple[Interval, ...]
    after: tuple[Interval, ...]
    is_same_rule: bool
    seconds: float
    depth: float | None
    unjudged: float
    is_worse: bool


@dataclass(frozen=True, eq=False)
class RecordingComparison:
    """One recording before and after.

    Attributes:
        name: of the recording; where they differ, both.
        before: times of each verdict; ``None`` where there is no such recording.
        after: likewise.
        shift: what is added to times after for them to be on the clock of those before.
        changes: in the order of time.
        before_source: position among the sources of the timeline before; ``None`` for none.
        after_source: likewise after.
        unknown_more: whether more time is UNKNOWN after, by more than the tolerance.
        is_shorter: whether too little of the time before is covered after.
    """

    name: str
    before: Times | None
    after: Times | None
    before_source: int | None
    after_source: int | None
    shift: float = 0.0
    changes: tuple[Change, ...] = ()
    unknown_more: bool = False
    is_shorter: bool = False

    @property
    def findings(self) -> tuple[str, ...]:
        """What is wrong with the recording as a whole: ``missing``, ``unknown``, ``too_short``."""
        found = {
            'missing': self.before is None or self.after is None,
            'unknown': self.unknown_more,
            'too_short': self.is_shorter,
        }
        return tuple(name for name, is_so in found.items() if is_so)

    @property
    def is_worse(self) -> bool:
        """Whether anything of it is worse; a recording without a counterpart is."""
        return bool(self.findings) or any(change.is_worse for change in self.changes)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Violations before and after.

    Attributes:
        before: the first side.
        after: the second side.
        tolerance: in the timelines' unit.
        recordings: one for each pair, then those without a counterpart.
    """

    before: Side
    after: Side
    tolerance: float
    recordings: tuple[RecordingComparison, ...]

    @property
    def is_worse(self) -> bool:
        """Whether any recording got worse."""
        return any(item.is_worse for item in self.recordings)

    @cached_property
    def counts(self) -> dict[str, int]:
        """The number of changes of each kind."""
        kinds = ('new', 'gone', 'longer', 'shorter', 'deeper', 'shallower', 'same')
        found = [change.kind for item in self.recordings for change in item.changes]
        return {kind: found.count(kind) for kind in kinds}


def compare_sides(
    before: Side,
    after: Side,
    rules: Sequence[tuple[int, int]],
    *,
    same_recordings: bool = False,
    by_order: bool = False,
    tolerance: float | None = None,
    allow_shorter: bool = False,
    clock: str = 'auto',
) -> Comparison:
    """Compare the violations of two sides, recording by recording.

    Recordings are paired by name, or by order; the only ones of both sides in any case.

    Args:
        before: the first side.
        after: the second side.
        rules: positions of the rules, before and after, that stand for each other.
        same_recordings: whether both sides are the same recordings, under two rule files.
        by_order: pair by order and not by name.
        tolerance: lengths that differ by no more count as the same, and violations no further
            apart as of one moment; ``None`` for :data:`TOLERANCE_SECONDS`, and 0 for rows.
        allow_shorter: whether a recording may end earlier than its counterpart.
        clock: what moments are matched by: header ``stamps``; the time since each recording's
            ``start``; or ``auto``, stamps where those of the two recordings overlap, as after a
            replay or in simulated time.

    Raises:
        DataError: there is no pair, a name stands for two recordings, or one side is in seconds
            and the other in rows.
    """
    if before.timeline.unit != after.timeline.unit:
        raise DataError(
            f'{before.name} and {after.name} are recordings and tables; allowed are two sides of '
            'the same kind'
        )
    if tolerance is None:
        tolerance = TOLERANCE_SECONDS if before.timeline.unit == 's' else 0.0
    pairs = (
        [(place, place) for place in range(len(before.names))]
        if same_recordings
        else _pairs(before, after, by_order=by_order)
    )
    comparer = _Comparer(
        before,
        after,
        rules,
        tolerance=tolerance,
        allow_shorter=allow_shorter,
        clock='start' if same_recordings or before.timeline.unit != 's' else clock,
    )
    return Comparison(before, after, tolerance, tuple(comparer.compare(*pair) for pair in pairs))


def _pairs(before: Side, after: Side, *, by_order: bool) -> list[tuple[int | None, int | None]]:
    counts = len(before.names), len(after.names)
    if by_order or counts == (1, 1):
        return [
            (place if place < counts[0] else None, place if place < counts[1] else None)
            for place in range(max(counts))
        ]
    for side in (before, after):
        for name in side.names:
            if side.names.count(name) > 1:
                raise DataError(
                    f'{side.name} has two recordings of the name {name!r}; allowed are different '
                    'names, or pairs by order (--by-order)'
                )
    if not set(before.names) & set(after.names):
        raise DataError(
            f'no recording of {before.name} ({_some(before.names)}) has the name of one of '
            f'{after.name} ({_some(after.names)}); allowed are equal names, or pairs by order '
            '(--by-order)'
        )
    pairs: list[tuple[int | None, int | None]] = [
        (place, after.names.index(name) if name in after.names else None)
        for place, name in enumerate(before.names)
    ]
    return pairs + [
        (None, place) for place, name in enumerate(after.names) if name not in before.names
    ]


def _some(names: Sequence[str]) -> str:
    return ', '.join(names[:3]) + (', ...' if len(names) > 3 else '')


_Stretches = list[tuple[float, float]]


@dataclass(frozen=True)
class _Found:
    """Violations of one rule around one moment, by side."""

    intervals: tuple[tuple[Interval, ...], tuple[Interval, ...]]

    @property
    def start(self) -> float:
        return min(item.start for own in self.intervals for item in own)

    @property
    def end(self) -> float:
        return max(item.end for own in self.intervals for item in own)


class _Comparer:
    """Compares recordings, of which it is told the positions."""

    def __init__(
        self,
        before: Side,
        after: Side,
        rules: Sequence[tuple[int, int]],
        *,
        tolerance: float,
        allow_shorter: bool,
        clock: str,
    ) -> None:
        self._sides = before, after
        self._after_of = dict(rules)
        self._before_of = {second: first for first, second in rules}
        self._tolerance, self._allow_shorter = tolerance, allow_shorter
        self._clock = clock
        self._rows = tuple(map(_rows_by_source, self._sides))
        self._violations: tuple[dict[tuple[int, int | None], list[Interval]], ...] = ({}, {})
        for side, found in zip(self._sides, self._violations, strict=True):
            for item in side.timeline.violations:
                found.setdefault((item.source, item.episode), []).append(item)
        self._same_scale = np.array_equal(
            before.rule_set.demonstrated, after.rule_set.demonstrated
        ) and (before.rule_set.space.names == after.rule_set.space.names)

    def compare(self, first: int | None, second: int | None) -> RecordingComparison:
        """Compare a recording with its counterpart, or tell that there is none."""
        before = None if first is None else self._times(0, first)
        after = None if second is None else self._times(1, second)
        if first is None or second is None:
            side, place = (1, second) if first is None else (0, first)
            assert place is not None
            return RecordingComparison(self._sides[side].names[place], before, after, first, second)
        assert before is not None
        assert after is not None
        names = self._sides[0].names[first], self._sides[1].names[second]
        shift = self._shift(first, second)
        changes: list[Change] = []
        for rows in self._episodes(first, second):
            changes += self._changes(first, second, rows, shift)
        changes.sort(key=self._moment(shift))
        lacking = before.total - after.total
        return RecordingComparison(
            names[0] if names[0] == names[1] else f'{names[0]} and {names[1]}',
            before,
            after,
            first,
            second,
            shift,
            tuple(changes),
            after.unknown - before.unknown > self._tolerance,
            not self._allow_shorter
            and lacking > self._tolerance
            and after.total < LEAST_COVERED * before.total,
        )

    def _times(self, side: int, source: int) -> Times:
        timeline, rows = self._sides[side].timeline, self._rows[side][source]
        verdicts, valid = timeline.judgement.verdict[rows], timeline.valid_for[rows]
        safe, violated, unknown = (float(valid[verdicts == item].sum()) for item in Verdict)
        return Times(safe, violated, unknown + float(timeline.silence[rows].sum()))

    def _shift(self, first: int, second: int) -> float:
        """Return what makes a time of the second recording one of the first."""
        if self._clock == 'start':
            return 0.0
        spans, offsets = [], []
        for side, source in enumerate((first, second)):
            data, rows = self._sides[side].timeline.data, self._rows[side][source]
            assert data.times_ns is not None
            stamps = data.stamps_ns[rows]
            spans.append((int(stamps.min()), int(stamps.max())))
            offsets.append(float(np.median(stamps - data.times_ns[rows])))
        common = min(span[1] for span in spans) - max(span[0] for span in spans)
        shortest = min(span[1] - span[0] for span in spans)
        is_common = 2 * common > shortest > 0
        return (offsets[1] - offsets[0]) * 1e-9 if is_common or self._clock == 'stamps' else 0.0

    def _episodes(self, first: int, second: int) -> Iterator[tuple[int | None, int | None]]:
        """Yield the numbers of the episodes of both recordings that are compared."""
        numbers = [
            np.unique(side.timeline.data.episodes[self._rows[place][source]]).tolist()
            for place, (side, source) in enumerate(zip(self._sides, (first, second), strict=True))
        ]
        for place in range(max(map(len, numbers))):
            one, other = (own[place] if place < len(own) else None for own in numbers)
            yield one, other

    def _changes(
        self,
        first: int,
        second: int,
        episodes: tuple[int | None, int | None],
        shift: float,
    ) -> Iterator[Change]:
        """Yield what changed in one episode."""
        by_rule: dict[tuple[int, int], tuple[list[Interval], list[Interval]]] = {}
        for side, source in enumerate((first, second)):
            for item in self._violations[side].get((source, episodes[side]), ()):
                rule = item.rule
                key = (
                    (rule, self._after_of.get(rule, -1))
                    if side == 0
                    else (self._before_of.get(rule, -1), rule)
                )
                by_rule.setdefault(key, ([], []))[side].append(item)
        if not by_rule:
            return
        left: tuple[list[_Found], list[_Found]] = ([], [])
        # Of a violation with a break that was bridged, some may not have been known before either.
        unjudged = (
            self._unjudged(0, first, episodes[0], 0.0),
            self._unjudged(1, second, episodes[1], shift),
        )
        for own in by_rule.values():
            for found in _around_moments(own, shift, self._tolerance):
                if all(found.intervals):
                    yield self._change(found, shift, unjudged, is_same_rule=True)
                else:
                    left[0 if found.intervals[0] else 1].append(found)
        for found in self._under_other_rules(left, shift):
            yield self._change(found, shift, unjudged, is_same_rule=False)
        for found in (*left[0], *left[1]):
            yield self._change(found, shift, unjudged, is_same_rule=True)

    def _under_other_rules(
        self, left: tuple[list[_Found], list[_Found]], shift: float
    ) -> Iterator[_Found]:
        """Take out of what is left the pairs that mean one moment under two rules; yield these.

        They share at least half of the longer one; those that share most are paired first.
        """
        candidates = []
        for one in left[0]:
            for other in left[1]:
                start, end = other.start + shift, other.end + shift
                common = min(one.end, end) - max(one.start, start)
                longer = max(one.end - one.start, end - start)
                if common >= 0.5 * longer:
                    ids = sorted(
                        self._sides[side].rule_set.rules[found.intervals[side][0].rule].id
                        for side, found in enumerate((one, other))
                    )
                    key = -common, min(one.start, start), max(one.start, start), ids
                    candidates.append((key, one, other))
        taken: set[int] = set()
        for _, one, other in sorted(candidates, key=lambda item: item[0]):
            if not {id(one), id(other)} & taken:
                taken |= {id(one), id(other)}
                yield _Found((one.intervals[0], other.intervals[1]))
        for own in left:
            own[:] = [found for found in own if id(found) not in taken]

    def _unjudged(self, side: int, source: int, episode: int | None, shift: float) -> _Stretches:
        """Return the stretches, on the clock before, of which a side knows nothing."""
        if episode is None:
            return [] if self._allow_shorter else [(-np.inf, np.inf)]
        timeline = self._sides[side].timeline
        rows = self._rows[side][source]
        rows = rows[timeline.data.episodes[rows] == episode]
        starts, ends = timeline.starts[rows], timeline.starts[rows] + timeline.valid_for[rows]
        is_unknown = timeline.judgement.verdict[rows] == Verdict.UNKNOWN
        silent = timeline.silence[rows] > 0
        found = list(zip(starts[is_unknown], ends[is_unknown], strict=True))
        found += zip(ends[silent], (ends + timeline.silence[rows])[silent], strict=True)
        if not self._allow_shorter:
            found += [(-np.inf, starts.min()), ((ends + timeline.silence[rows]).max(), np.inf)]
        return [(float(start) + shift, float(end) + shift) for start, end in found]

    def _change(
        self,
        found: _Found,
        shift: float,
        unjudged: tuple[_Stretches, _Stretches],
        *,
        is_same_rule: bool,
    ) -> Change:
        before, after = found.intervals
        seconds = sum(item.active for item in after) - sum(item.active for item in before)
        depth = None
        if before and after and is_same_rule and self._same_scale:
            depth = min(item.margin for item in before) - min(item.margin for item in after)
        hidden = max(0.0, _common(before, unjudged[1]) - _common(before, unjudged[0]))
        is_longer, is_deeper = seconds > self._tolerance, depth is not None and depth > DEEPER
        if not before or not after:
            kind = 'gone' if before else 'new'
        elif abs(seconds) > self._tolerance:
            kind = 'longer' if is_longer else 'shorter'
        elif depth is not None and abs(depth) > DEEPER:
            kind = 'deeper' if is_deeper else 'shallower'
        else:
            kind = 'same'
        # What is gone may have been shorter than the tolerance.
        length = sum(item.end - item.start for item in before)
        is_hidden = hidden > (
            min(self._tolerance, length / 2) if kind == 'gone' else self._tolerance
        )
        is_worse = kind == 'new' or (kind != 'gone' and is_longer) or is_deeper or is_hidden
        return Change(kind, before, after, is_same_rule, seconds, depth, hidden, is_worse)

    @staticmethod
    def _moment(shift: float):
        def key(change: Change) -> tuple[float, int, int]:
            starts = [item.start for item in change.before]
            starts += [item.start + shift for item in change.after]
            first = (*change.before, *change.after)[0]
            return min(starts), first.rule, first.episode

        return key


def _common(intervals: Sequence[Interval], stretches: _Stretches) -> float:
    """Return for how long intervals lie in stretches."""
    return sum(
        max(0.0, min(item.end, end) - max(item.start, start))
        for item in intervals
        for start, end in stretches
    )


def _rows_by_source(side: Side) -> list[np.ndarray]:
    data = side.timeline.data
    if data.recordings is None:
        return [np.arange(len(data))]
    order = np.argsort(data.recordings, kind='stable')
    counts = np.bincount(data.recordings, minlength=len(side.names))
    return np.split(order, np.cumsum(counts)[:-1])


def _around_moments(
    own: tuple[Sequence[Interval], Sequence[Interval]], shift: float, tolerance: float
) -> Iterator[_Found]:
    """Yield intervals of one rule that belong together, because no longer break parts them."""
    entries = sorted(
        ((item.start + shift * side, item.end + shift * side, side, item)
         for side in (0, 1) for item in own[side]),
        key=lambda entry: entry[:3],
    )  # fmt: skip
    together: tuple[list[Interval], list[Interval]] = ([], [])
    until = -np.inf
    for start, end, side, item in entries:
        if start - until > tolerance and any(together):
            yield _Found((tuple(together[0]), tuple(together[1])))
            together = ([], [])
        together[side].append(item)
        until = max(until, end)
    if any(together):
        yield _Found((tuple(together[0]), tuple(together[1])))
