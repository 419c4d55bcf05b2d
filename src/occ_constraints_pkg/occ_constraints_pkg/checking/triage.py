# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which of many recordings to look at: each judged by rules learned from the others.

A recording that is bad widens the rules that are learned from it, and so do others that are bad in
the same way. So those that look suspicious are found first and learned from by nobody: once by
rules from small random groups, which mostly hold none of them, then by rules from all that is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from occ_constraints_pkg.checking.timeline import (
    Interval,
    Timeline,
    check_data,
    make_timeline,
)
from occ_constraints_pkg.checking.unchanged import unchanged_space
from occ_constraints_pkg.datasets.dataset import Dataset, joined
from occ_constraints_pkg.datasets.each import in_processes
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.learn import learn_safe_set
from occ_constraints_pkg.learning.samples import divide_samples
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Judgement, Verdict
from occ_constraints_pkg.wording import count_of

ABOVE = 1.5
"""The score from which on a recording stands out, see :class:`Ranked`."""

LEAST_RECORDINGS = 3
"""With fewer, there are no others to learn from."""

SUSPECTS = 0.1
"""Share of the recordings that nothing is learned from: those with the highest scores."""

# With fewer recordings, each is judged by all others, and groups of them would be too small.
_FEW = 20
# Random groups to find the first suspects by, of so many recordings at most.
_GROUPS, _GROUP = 24, 10
# How often suspects are looked for again.
_ROUNDS = 4
# Parts into which those learned from are divided, so that each is judged by rules from the others:
# while suspects are looked for, and at the end, with conditional rules.
_PARTS, _LAST_PARTS = 10, 6
# A typical recording keeps at least so much of the demonstrated range from a bound; where all come
# as close as they can, as to a speed limit, a hair beyond is not far.
_LEAST_DISTANCE = 0.02
# Nothing counts as farther than that.
_FARTHEST = 1e6
# A value that is the same for less time, in seconds or rows, may be so by chance.
_LEAST_UNCHANGED = {'s': 1.0, 'rows': 5.0}
# How much farther a peak is that is named in place of what a row shows.
_BETTER = 1.25
# Seconds, or rows, on both sides of the worst moment that are kept to be shown.
_AROUND = 10.0


@dataclass(frozen=True)
class Unit:
    """What is ranked: a recording, or an episode of a table.

    Attributes:
        name: for people.
        path: of the recording or table.
        data: its rows.
        stuck: (n, groups) for how long values have not changed, see :mod:`.unchanged`.
        peaks: (n, peaks and dips) what came between rows, see :mod:`.peaks`.
    """

    name: str
    path: str
    data: Dataset
    stuck: np.ndarray
    peaks: np.ndarray


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A feature around the worst moment, against its bound.

    Attributes:
        name: of the feature.
        unit: of it.
        bound: the rule's.
        times: (n,) in the timeline's unit.
        values: (n,).
    """

    name: str
    unit: str
    bound: float
    times: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Event:
    """A stretch in which a recording leaves a rule, or in which nothing can be judged.

    Attributes:
        start: in the timeline's unit.
        end: likewise.
        words: the rule, or ``UNKNOWN``.
        first_ns: when the message that gave the first row was recorded; ``None`` for tables.
        last_ns: likewise of the last row.
    """

    start: float
    end: float
    words: str
    first_ns: int | None
    last_ns: int | None


@dataclass(frozen=True, eq=False)
class Ranked:
    """A recording, and how far and how long it leaves the rules learned from the others.

    Attributes:
        name: of the recording.
        path: of it.
        score: ``far``, plus the excess of each moment times how long it lasts, plus the time that
            is UNKNOWN beyond what is typical.
        far: the largest excess: by how much a rule is violated, in parts of the distance that a
            typical recording keeps from the bound at its closest; 0 if none is.
        violated: for how long any rule is true.
        unknown: for how long nothing can be judged.
        duration: of the recording.
        rule: the one with the largest excess; ``None`` if none is violated.
        rule_words: this rule in words.
        moment: when; of the first UNKNOWN if no rule is violated, else ``None``.
        log_time_ns: likewise, as the message that gave the row was recorded; ``None`` for tables.
        values: of the rule's features then, by name.
        events: the farthest first, then those UNKNOWN.
        excerpt: a feature of that rule around the moment.
        is_suspect: whether nothing was learned from it.
        stands_out: whether the score is that high.
    """

    name: str
    path: str
    score: float
    far: float
    violated: float
    unknown: float
    duration: float
    rule: Rule | None
    rule_words: str
    moment: float | None
    log_time_ns: int | None
    values: dict[str, float]
    events: tuple[Event, ...]
    excerpt: Excerpt | None
    is_suspect: bool
    stands_out: bool


@dataclass(frozen=True, eq=False)
class Triage:
    """Recordings by how far and how long they leave the rules learned from the others.

    Attributes:
        ranked: the highest score first.
        unreadable: name and path of recordings that cannot be used, and why.
        rules: in words, as learned from all but the suspects.
        learned_from: from how many that was.
        unit: of times: ``s``, or ``row`` for tables.
        above: the score from which on a recording stands out.
    """

    ranked: tuple[Ranked, ...]
    unreadable: tuple[tuple[str, str, str], ...]
    rules: tuple[str, ...]
    learned_from: int
    unit: str
    above: float

    @property
    def found(self) -> tuple[Ranked, ...]:
        """Those that stand out."""
        return tuple(item for item in self.ranked if item.stands_out)


def triage(
    units: Sequence[Unit],
    space: FeatureSpace,
    conditional: ConditionalSettings,
    *,
    peaks: FeatureSpace | None = None,
    unreadable: Sequence[tuple[str, str, str]] = (),
    above: float = ABOVE,
    processes: int = 1,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> Triage:
    """Rank recordings by how far and how long they leave the rules learned from the others.

    Args:
        units: the recordings, all of one feature map, or episodes of tables.
        space: their features.
        conditional: which rules about several features to look for in the end.
        peaks: the features of the units' peaks; ``None`` where there are none.
        unreadable: name and path of others that cannot be used, and why.
        above: the score from which on a recording stands out.
        processes: how many work at a time.
        rng: chooses the groups that recordings are judged by.
        progress: called with (steps done, steps in all).

    Raises:
        DataError: there are too few recordings, or none has a usable sample.
    """
    if len(units) < LEAST_RECORDINGS:
        raise DataError(
            f'triage got {count_of(len(units), "recording")} that can be used; allowed are '
            f'{LEAST_RECORDINGS} or more, for each is judged by rules learned from the others'
        )
    table = _Rows(units, space, peaks)
    suspects, steps = np.zeros(len(units), dtype=bool), _ROUNDS + 2
    plain = ConditionalSettings('none')

    def told(step: int) -> None:
        if progress is not None:
            progress(step, steps)

    are_few = len(units) < _FEW
    if are_few:
        judged = _judge_each(table, suspects, plain, len(units), 1, rng)[1]
        scores = np.array([item.score for item in judged])
    else:
        scores = _first_scores(table, plain, rng)
    for step in range(_ROUNDS):
        told(step + 1)
        before, suspects = suspects, _highest(scores)
        if (before == suspects).all():
            break
        parts = len(units) if are_few else _PARTS
        judged = _judge_each(table, suspects, plain, parts, 1, rng)[1]
        scores = np.array([item.score for item in judged])
    told(_ROUNDS + 1)
    parts = len(units) if are_few else _LAST_PARTS
    # Without conditional rules, it takes longer to hand the rows to others than to learn from them.
    last = processes if conditional.looks else 1
    rule_set, scored = _judge_each(table, suspects, conditional, parts, last, rng)
    told(steps)
    ranked = [
        table.ranked(place, item, is_suspect=bool(suspects[place]), above=above)
        for place, item in enumerate(scored)
    ]
    ranked.sort(key=lambda item: -item.score)
    return Triage(
        tuple(ranked),
        tuple(unreadable),
        tuple(rule_set.rules[place].words(rule_set.space) for place in rule_set.order),
        int((~suspects).sum()),
        table.timeline.unit,
        above,
    )


@dataclass(frozen=True, eq=False)
class _Scored:
    """How far and how long one recording leaves some rules."""

    score: float
    far: float
    violated: float
    row: int
    rule: int
    rule_set: RuleSet
    habits: _Habits


class _Rows:
    """All rows of all recordings, with what does not depend on rules."""

    def __init__(
        self, units: Sequence[Unit], space: FeatureSpace, peaks: FeatureSpace | None
    ) -> None:
        self.units, self.space = units, space
        data = joined([unit.data for unit in units])
        counts = [len(unit.data) for unit in units]
        self.unit_of = np.repeat(np.arange(len(units)), counts)
        self.first = np.concatenate([[0], np.cumsum(counts)])
        values = data.values[:, : len(space)]
        self.timeline = make_timeline(
            RuleSet(space, (), np.zeros((len(space), 2))),
            replace(
                data, names=space.names, values=values, recordings=self.unit_of,
                sources=tuple({'name': unit.name} for unit in units),
            ),
            Judgement.unknown(len(data)),
        )  # fmt: skip
        self.valid_for = self.timeline.valid_for
        self.known = space.knows(values)
        unit = 'rows' if data.times_ns is None else 's'
        self.least_unchanged = _LEAST_UNCHANGED[unit]
        stuck = np.concatenate([item.stuck for item in units])
        telling = self._telling(stuck)
        extra = [
            feature
            for feature, is_telling in zip(
                unchanged_space(space, unit).features, telling, strict=True
            )
            if is_telling
        ]
        self.stuck_count = len(extra)
        extra += () if peaks is None else peaks.features
        self.extra_space = FeatureSpace(tuple(extra)) if extra else None
        self.whole_space = FeatureSpace((*space.features, *extra))
        between = np.concatenate([item.peaks for item in units])
        self.values = np.concatenate([values, stuck[:, telling], between], axis=1)
        lost = np.where(self.known, 0.0, self.valid_for) + self.timeline.silence
        self.unknown = np.bincount(self.unit_of, lost, len(units))
        self.duration = np.bincount(
            self.unit_of, self.valid_for + self.timeline.silence, len(units)
        )

    def tells(self, literal: Literal) -> bool:
        """Tell whether a literal on the extra features means something.

        It is no fault to change at once, nor does a peak say anything of small values.
        """
        place = literal.members[0] - self.stuck_count
        half = (len(self.whole_space) - len(self.space) - self.stuck_count) // 2
        return literal.is_upper == (place >= half)

    def _telling(self, stuck: np.ndarray) -> np.ndarray:
        """Tell of which groups a typical recording changes the values all the time.

        What is the same for most of a recording, as where nothing is near, has nothing to be stuck.
        """
        longest = np.maximum.reduceat(stuck, self.first[:-1], axis=0)
        times = self.timeline.starts
        lengths = np.maximum.reduceat(times, self.first[:-1]) - np.minimum.reduceat(
            times, self.first[:-1]
        )
        share = longest / np.maximum(lengths, 1e-9)[:, None]
        return np.median(share, axis=0) < 0.5

    def rows_of(self, members: np.ndarray) -> np.ndarray:
        """Return the rows of some recordings, in order."""
        return np.flatnonzero(np.isin(self.unit_of, members))

    def ranked(self, place: int, scored: _Scored, *, is_suspect: bool, above: float) -> Ranked:
        """Return a recording with all that is told of it."""
        unit, rule_set = self.units[place], scored.rule_set
        rows = np.arange(self.first[place], self.first[place + 1])
        data = replace(
            self.timeline.data.select(rows), names=rule_set.space.names, values=self.values[rows]
        )
        timeline = check_data(data, rule_set)
        rule, words, row = None, '', scored.row - int(self.first[place])
        values: dict[str, float] = {}
        excerpt = None
        if scored.far > 0:
            rule = rule_set.rules[scored.rule]
            sample = data.values[row]
            words = rule.words(rule_set.space)
            deciding = rule.deciding(sample)
            values = {rule_set.space.names[feature]: float(sample[feature]) for feature in deciding}
            excerpt = _excerpt(timeline, rule, rule_set, row)
        elif timeline.unknown:
            row = int(timeline.unknown[0].samples[0])
        else:
            row = -1
        origins = data.origins
        return Ranked(
            unit.name,
            unit.path,
            scored.score,
            scored.far,
            scored.violated,
            float(self.unknown[place]),
            float(self.duration[place]),
            rule,
            words,
            None if row < 0 else float(timeline.starts[row]),
            None if row < 0 or origins is None else int(origins['time_ns'][row]),
            values,
            _events(timeline, scored),
            excerpt,
            is_suspect,
            scored.score >= above,
        )


def _excerpt(timeline: Timeline, rule: Rule, rule_set: RuleSet, row: int) -> Excerpt:
    """Return the feature whose literal is exceeded most, around a row."""
    sample, scale = timeline.data.values[row], rule_set.scale
    # The literal that is the closest to being false decides how far a rule is violated.
    literal = max(
        rule.literals,
        key=lambda item: float(
            item.distances(item.values(sample[None]), scale[item.members[0]])[0]
        ),
    )
    feature = literal.deciding(sample)
    own = (timeline.data.episodes == timeline.data.episodes[row]) & (
        np.abs(timeline.starts - timeline.starts[row]) <= _AROUND
    )
    about = rule_set.space.features[feature]
    return Excerpt(
        about.name,
        about.unit,
        literal.bound,
        timeline.starts[own],
        timeline.data.values[own, feature],
    )


def _events(timeline: Timeline, scored: _Scored) -> tuple[Event, ...]:
    """Return the stretches in which rules are exceeded, the farthest first, then those UNKNOWN."""
    rule_set, origins = scored.rule_set, timeline.data.origins
    found: list[tuple[float, Interval]] = []
    for item in timeline.violations:
        excess = float(scored.habits.excess(item.rule, np.array([item.margin]))[0])
        if excess > 0.0:
            found.append((-excess, item))
    found.sort(key=lambda pair: pair[0])

    def event(item: Interval) -> Event:
        words = 'UNKNOWN' if item.rule < 0 else rule_set.rules[item.rule].words(rule_set.space)
        if origins is None:
            return Event(item.start, item.end, words, None, None)
        first, last = (int(origins['time_ns'][item.samples[at]]) for at in (0, -1))
        return Event(item.start, item.end, words, first, last)

    return tuple(event(item) for item in (*(own for _, own in found), *timeline.unknown))


def _highest(scores: np.ndarray) -> np.ndarray:
    """Tell which recordings have the highest scores."""
    count = round(SUSPECTS * len(scores))
    chosen = np.zeros(len(scores), dtype=bool)
    chosen[np.argsort(-scores, kind='stable')[:count]] = True
    return chosen & (scores > 0)


def _first_scores(table: _Rows, plain: ConditionalSettings, rng: np.random.Generator) -> np.ndarray:
    """Return for each recording the median score by rules from random groups without it."""
    count = len(table.units)
    scores = np.full((_GROUPS, count), np.nan)
    for place in range(_GROUPS):
        group = rng.choice(count, size=min(_GROUP, count // 4), replace=False)
        if not table.known[table.rows_of(group)].any():
            continue
        others = np.setdiff1d(np.arange(count), group)
        for unit, item in zip(others, _judge(table, group, others, plain)[1], strict=True):
            scores[place, unit] = item.score
    # Who is in all groups that can be learned from is judged by none.
    return np.array([np.median(own[~np.isnan(own)]) if (~np.isnan(own)).any() else 0.0
                     for own in scores.T])  # fmt: skip


def _judge_each(
    table: _Rows,
    suspects: np.ndarray,
    conditional: ConditionalSettings,
    parts: int,
    processes: int,
    rng: np.random.Generator,
) -> tuple[RuleSet, list[_Scored]]:
    """Judge suspects by rules from all others, and these by rules from the other parts of them.

    Returns:
        The rules from all others, and for each recording its score.
    """
    core = rng.permutation(np.flatnonzero(~suspects))
    tasks = [(core, np.flatnonzero(suspects))]
    tasks += [
        (np.setdiff1d(core, part), part) for part in np.array_split(core, min(parts, len(core)))
    ]
    work = partial(_judge_task, table=table, conditional=conditional)
    results = in_processes(work, tasks, processes)
    scored: list[_Scored | None] = [None] * len(table.units)
    for (_, judged), (_, items) in zip(tasks, results, strict=True):
        for place, item in zip(judged, items, strict=True):
            scored[place] = item
    return results[0][0], [item for item in scored if item is not None]


def _judge_task(
    task: tuple[np.ndarray, np.ndarray], *, table: _Rows, conditional: ConditionalSettings
) -> tuple[RuleSet, list[_Scored]]:
    return _judge(table, *task, conditional)


def _judge(
    table: _Rows, members: np.ndarray, judged: np.ndarray, conditional: ConditionalSettings
) -> tuple[RuleSet, list[_Scored]]:
    """Learn from some recordings, and judge others by the rules.

    Returns:
        The rules, and the score of each that is judged.
    """
    rule_set = _learn(table, members, conditional)
    habits = _Habits.of(table, members, rule_set)
    typical = float(np.median(table.unknown))
    rows = table.rows_of(judged)
    known = rows[table.known[rows]]
    verdicts = rule_set.verdicts(table.values[known])
    violated = known[verdicts == Verdict.VIOLATED]
    values = table.values[violated]
    excess, which = np.zeros(len(violated)), np.full(len(violated), -1)
    for place in rule_set.order:
        rule = rule_set.rules[place]
        own = habits.excess(place, rule.margins(values, rule_set.scale))
        # What a row shows itself is the better reason, if it is about as good.
        is_extra = rule.literals[0].members[0] >= len(table.space)
        farther = own > (_BETTER * excess if is_extra else excess)
        excess = np.maximum(excess, own)
        which[farther] = place
    found = []
    for unit in judged:
        first, last = np.searchsorted(violated, table.first[[unit, unit + 1]])
        own, times = excess[first:last], table.valid_for[violated[first:last]]
        far = float(own.max(initial=0.0))
        at = first + int(own.argmax()) if len(own) else -1
        unknown = max(0.0, float(table.unknown[unit]) - typical)
        found.append(
            _Scored(
                far + float((own * times).sum()) + unknown,
                far,
                float(times[own > 0].sum()),
                int(violated[at]) if at >= 0 else -1,
                int(which[at]) if at >= 0 else -1,
                rule_set,
                habits,
            )
        )
    return rule_set, found


def _learn(table: _Rows, members: np.ndarray, conditional: ConditionalSettings) -> RuleSet:
    """Return the rules learned from some recordings, those about extra features included."""
    rows = table.rows_of(members)
    values, episodes = table.values[rows], table.timeline.data.episodes[rows]
    width = len(table.space)
    found = _rules_of(values[:, :width], episodes, table.space, conditional)
    if table.extra_space is None:
        return found
    plain = ConditionalSettings('none')
    extra = _rules_of(values[:, width:], episodes, table.extra_space, plain)
    is_stuck = np.arange(len(extra.space)) < table.stuck_count
    more = []
    for rule in extra.rules:
        if all(table.tells(literal) for literal in rule.literals):
            literals = [
                replace(
                    literal,
                    feature=tuple(member + width for member in literal.members)
                    if literal.is_family
                    else literal.members[0] + width,
                    bound=max(literal.bound, table.least_unchanged)
                    if is_stuck[literal.members[0]]
                    else literal.bound,
                )
                for literal in rule.literals
            ]
            more.append(Rule(rule.id, tuple(literals)))
    # So that the least counts as far beyond as it is long, however seldom a value stays.
    ranges = extra.demonstrated.copy()
    ranges[is_stuck, 0] = 0.0
    ranges[is_stuck, 1] = ranges[is_stuck, 1].clip(table.least_unchanged)
    return RuleSet(
        table.whole_space, (*found.rules, *more), np.concatenate([found.demonstrated, ranges])
    )


def _rules_of(
    values: np.ndarray, episodes: np.ndarray, space: FeatureSpace, conditional: ConditionalSettings
) -> RuleSet:
    samples = divide_samples(
        values, episodes, space, rng=np.random.default_rng(0), held_out_share=0.0
    )
    return learn_safe_set(samples, space, OCTreeSettings(), conditional).formula.rule_set


@dataclass(frozen=True, eq=False)
class _Habits:
    """What the recordings that were learned from do themselves, rule by rule.

    Attributes:
        reach: (rules,) the smallest margin of them all; below 0 where some violate the rule.
        distance: (rules,) how far the median recording stays from that at its closest, in parts of
            the demonstrated range, at least :data:`_LEAST_DISTANCE` and a step of rounding.
    """

    reach: np.ndarray
    distance: np.ndarray

    @classmethod
    def of(cls, table: _Rows, members: np.ndarray, rule_set: RuleSet) -> _Habits:
        rows = table.rows_of(members)
        rows = rows[table.known[rows]]
        starts = np.flatnonzero(np.diff(table.unit_of[rows], prepend=-1))
        values = table.values[rows]
        count = len(rule_set.rules)
        reach, distance = np.zeros(count), np.full(count, _LEAST_DISTANCE)
        for place, rule in enumerate(rule_set.rules):
            margins = rule.margins(values, rule_set.scale)
            closest = np.minimum.reduceat(margins, starts)
            reach[place] = min(0.0, float(closest.min()))
            distance[place] = float(np.median(closest)) - reach[place]
            if distance[place] < _LEAST_DISTANCE:
                # Of a rounded feature, one step beyond is no farther than all others are away.
                steps = np.diff(np.unique(margins))
                distance[place] = max(
                    _LEAST_DISTANCE, float(np.median(steps)) if len(steps) else 0.0
                )
        return cls(reach, distance)

    def excess(self, place: int, margins: np.ndarray) -> np.ndarray:
        """Return how far margins of a rule are beyond what the recordings do themselves: (n,)."""
        return ((self.reach[place] - margins) / self.distance[place]).clip(0.0, _FARTHEST)
