# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What is known of each robot: its standing, margins, rules, and what has changed.

Times are seconds on a steady clock. A robot that nothing was heard of is LOST; a verdict that
cannot be made is UNKNOWN; neither is ever shown as safe.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.fleet.events import EventLog
from occ_constraints_pkg.fleet.health import Health
from occ_constraints_pkg.fleet.margins import MarginHistory
from occ_constraints_pkg.rules import RuleSet, Verdict
from occ_constraints_pkg.rules.listing import read_rules_in_force
from occ_constraints_pkg.wording import count_of, without_numbers

LOST_SECONDS = 2.0
"""Without a message for so long, a robot or a gate is lost; a monitor that has nothing to judge
reports so once a second."""
# A violation that begins again within this time goes on, as in `occ check`.
_BRIDGE_SECONDS = 0.5
_MOST_CHANGES = 500
# Rule sets that verdicts on the way may still name.
_MOST_RULE_SETS = 4
# A verdict that was made so much earlier than it was sent comes from a recording.
_RECORDED_SECONDS = 5.0
# Numbers that are no part of a name: the same reason with other numbers is no news.


class Standing(IntEnum):
    """How a robot stands; the larger, the less is known."""

    SAFE = 0
    VIOLATED = 1
    UNKNOWN = 2
    LOST = 3


@dataclass(frozen=True)
class ViolatedRule:
    """A rule that a verdict names.

    Attributes:
        id: of the rule.
        words: what it says, with the member of a family that decides.
        margin: of this rule, at most 0.
        values: the values of its features, for people.
        robot: which of a batch violates it.
    """

    id: str
    words: str
    margin: float
    values: str = ''
    robot: int = 0


@dataclass(frozen=True)
class Report:
    """A message on ``violation``.

    Attributes:
        verdict: the worst one in it.
        margin: that goes with it; NaN where UNKNOWN.
        robot: which of a batch it is about.
        reason: why UNKNOWN, or a warning where SAFE; may be empty.
        rules: that are violated.
        rule_set: fingerprint of the rules that judged.
        next_rule: id of the rule that is foreseen to be violated next; empty for none.
        seconds: estimated time until then.
        judged_at_ns: wall time of judging; None where the monitor does not say.
        stamp_ns: of the input.
    """

    verdict: Verdict
    margin: float = math.nan
    robot: int = 0
    reason: str = ''
    rules: tuple[ViolatedRule, ...] = ()
    rule_set: str = ''
    next_rule: str = ''
    seconds: float = math.inf
    judged_at_ns: int | None = None
    stamp_ns: int = 0


@dataclass(frozen=True)
class MonitorReport:
    """What a monitor says of itself on ``/diagnostics``.

    Attributes:
        idle: why it does not judge; empty while it does.
        doubts: what it doubts of its sensors; empty for nothing.
    """

    idle: str = ''
    doubts: str = ''


@dataclass(frozen=True)
class GateReport:
    """A message on a gate's ``~/state``.

    Attributes:
        state: PASS, SLOW or STOP.
        scale: of the speed.
        reason: for it; may be empty.
        since_ns: wall time since when.
        topics: of verdicts that the gate listens to, full names.
    """

    state: str
    scale: float = math.nan
    reason: str = ''
    since_ns: int = 0
    topics: tuple[str, ...] = ()


@dataclass(frozen=True)
class Change:
    """One line of what has happened.

    Attributes:
        time: when.
        source: robot, gate or node that it is about.
        kind: a :class:`Standing`'s name, ``ended``, ``rules``, ``gate``, ``note``, ``done`` or
            ``failed``.
        text: the rest of the line.
    """

    time: float
    source: str
    kind: str
    text: str


@dataclass(frozen=True)
class RuleRow:
    """A rule and how close it is to being violated.

    Attributes:
        id: of the rule.
        words: what it says.
        enabled: whether it is in force.
        margin: its own; NaN where disabled or nothing is known.
        values: the values that decide, for people.
        counted: violated and evaluated; None where unknown.
    """

    id: str
    words: str
    enabled: bool
    margin: float = math.nan
    values: str = ''
    counted: tuple[int, int] | None = None


@dataclass
class _Episode:
    """A violation of one rule, or UNKNOWN for one reason, that has not ended."""

    begin: float
    last: float
    kind: Standing
    words: str
    margin: float = math.nan
    values: str = ''


@dataclass
class Gate:
    """What is known of one gate.

    Attributes:
        name: full name of its node.
        report: the newest one.
        heard: when it came.
        is_lost: whether it is silent.
    """

    name: str
    report: GateReport
    heard: float
    is_lost: bool = False

    @property
    def words(self) -> str:
        """Its state and why, or that nothing is known of it."""
        if self.is_lost:
            return 'LOST'
        scale = f' {self.report.scale:.0%}' if self.report.state == 'SLOW' else ''
        return f'{self.report.state}{scale}'


class Robot:
    """What is known of the robot that one topic of verdicts is about.

    Attributes:
        topic: the full name of the topic.
        name: what to call the robot: mostly its namespace.
        monitor: full name of the node that publishes the verdicts; empty where unknown.
        publishers: how many nodes publish them; exactly one may.
        report: the newest verdict; None before the first.
        heard: when that came.
        sample: (k,) the features judged last, of the robot that the verdict is about.
        idle: why the monitor does not judge, as it says on ``/diagnostics``.
        health: how its verdicts come.
        problem: why rules or features cannot be shown; empty while they can.
        is_recorded: whether verdicts were made long before they were sent, as in a recording.
    """

    def __init__(self, topic: str, now: float) -> None:
        self.topic, self.name = topic, robot_name(topic)
        self.monitor, self.publishers = '', 0
        self.report: Report | None = None
        self.heard = self._found = now
        self.sample: np.ndarray | None = None
        # When it came, and the fingerprint of the rules that judged it.
        self._sampled, self._sampled_by = -math.inf, ''
        self.idle, self._idle_at = '', -math.inf
        self.health = Health()
        self.problem, self.is_recorded = '', False
        self._counts: np.ndarray | None = None
        self._rule_sets: dict[str, RuleSet] = {}
        self._shown_rules = ''
        self._episodes: dict[object, _Episode] = {}
        self._margins = MarginHistory()
        # The standing that was noted last, and for which kind of reason.
        self._noted: tuple[Standing, str] | None = None
        self.changes: deque[Change] = deque(maxlen=_MOST_CHANGES)

    @property
    def rule_set(self) -> RuleSet | None:
        """The rules that the newest verdict was made by, or else those that came last."""
        named = self._rule_sets.get(self.report.rule_set) if self.report else None
        return named or next(reversed(self._rule_sets.values()), None)

    def standing(self, now: float) -> Standing:
        """Return how the robot stands: the worst that is open, or LOST after silence."""
        if self.report is None or now - self.heard > LOST_SECONDS:
            is_idle = now - self._idle_at <= LOST_SECONDS
            is_new = self.report is None and now - self._found <= LOST_SECONDS
            return Standing.UNKNOWN if is_idle or is_new else Standing.LOST
        worst = max((item.kind for item in self._episodes.values()), default=Standing.SAFE)
        return max(worst, Standing(int(self.report.verdict)))

    def why(self, now: float) -> str:
        """Return in words why the robot stands so; empty where nothing is to be said."""
        standing = self.standing(now)
        if standing is Standing.LOST:
            if self.report is None:
                return 'no verdict has come yet'
            return f'not heard from for {now - self.heard:.0f} s'
        if self.report is None or now - self.heard > LOST_SECONDS:
            return self.idle or 'no verdict yet'
        if standing is Standing.SAFE:
            return self.report.reason
        open_ones = [item for item in self._episodes.values() if item.kind is standing]
        return '; '.join(item.words for item in open_ones) or self.report.reason

    def hear(self, report: Report, when: float, sent_ns: int = 0) -> None:
        """Take a verdict.

        Args:
            report: what it says.
            when: it came.
            sent_ns: wall time of sending; 0 where unknown.
        """
        self._close(when - self.heard > LOST_SECONDS)
        self.report, self.heard = report, max(self.heard, when)
        made = report.judged_at_ns
        self.health.hear(when, made, report.stamp_ns)
        self.is_recorded = bool(
            made is not None and sent_ns and sent_ns - made > _RECORDED_SECONDS * 1e9
        )
        is_unknown = report.verdict is Verdict.UNKNOWN
        self._margins.keep(math.nan if is_unknown else report.margin, when)
        if is_unknown:
            kind = without_numbers(report.reason)
            self._open(('unknown', kind), Standing.UNKNOWN, report.reason, math.nan, '', when)
        for rule in report.rules:
            which = f' (robot {rule.robot})' if rule.robot else ''
            key = ('rule', rule.robot, rule.id)
            words = f'{rule.id}: {rule.words}{which}'
            self._open(key, Standing.VIOLATED, words, rule.margin, rule.values, when)
        if report.verdict is Verdict.VIOLATED and not report.rules:
            self._open(('rule', -1, ''), Standing.VIOLATED, report.reason, report.margin, '', when)

    def hear_rules(self, text: str, now: float) -> None:
        """Take a message on ``rules``."""
        try:
            rule_set = _read_rules(text)
        except OccError as error:
            self.problem = str(error)
            return
        self.problem = ''
        self._rule_sets.pop(rule_set.fingerprint, None)
        self._rule_sets[rule_set.fingerprint] = rule_set
        while len(self._rule_sets) > _MOST_RULE_SETS:
            del self._rule_sets[next(iter(self._rule_sets))]
        if rule_set.fingerprint != self._shown_rules:
            self._shown_rules = rule_set.fingerprint
            of = f' of {len(rule_set.rules)}' if len(rule_set.rules) > len(rule_set.order) else ''
            words = f'{count_of(len(rule_set.order), "rule")}{of} in force'
            self._add(now, 'rules', f'{words}, rule set {rule_set.fingerprint}')

    def hear_features(self, rows: np.ndarray, rule_set: str, when: float) -> None:
        """Take the features of one input.

        Args:
            rows: (robots, k) what was judged.
            rule_set: fingerprint of the rules that judged.
            when: they came.
        """
        rules, robot = self._rule_sets.get(rule_set), self.report.robot if self.report else 0
        fits = rules is not None and rows.ndim == 2 and rows.shape[1] == len(rules.space)
        # Monitors with a common topic may judge by other rules.
        if fits and robot < len(rows) and (not self.report or rule_set == self.report.rule_set):
            self.sample = np.array(rows[robot], dtype=np.float64)
            self._sampled, self._sampled_by = when, rule_set

    def hear_counts(self, counts: np.ndarray) -> None:
        """Take the counters: (rules, 2), evaluated and violated."""
        self._counts = counts

    def hear_monitor(self, report: MonitorReport, now: float) -> None:
        """Take what the monitor says of itself, so it runs."""
        self.idle, self._idle_at = report.idle, now
        self.health.doubts = report.doubts

    def tick(self, now: float) -> None:
        """Close what has ended, and note what has changed by now."""
        self._close(now - self.heard > LOST_SECONDS)
        standing, why = self.standing(now), ''
        if standing is Standing.UNKNOWN and not self._episodes:
            why = self.why(now)
        noted = standing, without_numbers(why)
        if noted == self._noted:
            return
        self._noted = noted
        if standing is Standing.LOST:
            self._add(now, 'LOST', self.why(now))
        elif standing is Standing.SAFE:
            self._add(now, 'SAFE', f'margin {self.report.margin:.3g}')
        elif why:
            self._add(now, 'UNKNOWN', why)

    def _close(self, is_lost: bool) -> None:
        """Drop the episodes that no verdict has named for a while, or all after silence."""
        for key, item in list(self._episodes.items()):
            if is_lost or self.heard - item.last > _BRIDGE_SECONDS:
                del self._episodes[key]
                if item.kind is Standing.VIOLATED:
                    values = f' ({item.values})' if item.values else ''
                    self._add(
                        item.last,
                        'ended',
                        f'after {item.last - item.begin:.2f} s: {item.words}; worst margin '
                        f'{item.margin:.3g}{values}'
                        + ('; nothing was heard since' if is_lost else ''),
                    )

    def _open(
        self, key: object, kind: Standing, words: str, margin: float, values: str, when: float
    ) -> None:
        """Begin an episode, or go on with it."""
        item = self._episodes.get(key)
        if item is None:
            self._episodes[key] = _Episode(when, when, kind, words, margin, values)
            numbers = f', margin {margin:.3g}' if kind is Standing.VIOLATED else ''
            told = f' ({values})' if values else ''
            self._add(when, kind.name, f'{words}{told}{numbers}')
            return
        item.last = max(item.last, when)
        if kind is Standing.UNKNOWN:
            item.words = words
        if margin < item.margin:
            item.words, item.margin, item.values = words, margin, values

    def margins(self, count: int, now: float) -> list[float | None]:
        """Return the smallest margin of each of the last spans, the present one last.

        Args:
            count: how many spans of :data:`BUCKET_SECONDS`.
            now: the time.

        Returns:
            ``-inf`` for a span with UNKNOWN in it, None for one without a verdict.
        """
        return self._margins.newest(count, now)

    def closeness(self, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which rules are the closest to being violated.

        Returns:
            The positions of all rules, the closest first and the disabled ones last; and (rules,)
            their margins, NaN where a rule is disabled or nothing is known of now.
        """
        rule_set = self.rule_set
        if rule_set is None:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        sample = self._current_sample(now)
        if sample is None:
            margins = np.full(len(rule_set.rules), np.nan)
        else:
            margins = rule_set.rule_margins(sample)
        ranks = np.where(np.isnan(margins), np.inf, margins)
        disabled = np.array([not rule.enabled for rule in rule_set.rules], dtype=bool)
        return np.lexsort((ranks, disabled)), margins

    def rule_row(self, index: int, margins: np.ndarray, now: float) -> RuleRow:
        """Return one rule for people, by its position and what :meth:`closeness` returned."""
        rule_set, counts = self.rule_set, self._counts
        rule, sample = rule_set.rules[index], self._current_sample(now)
        has_counts = counts is not None and len(counts) == len(rule_set.rules)
        return RuleRow(
            rule.id,
            rule.words(rule_set.space),
            rule.enabled,
            float(margins[index]),
            '' if sample is None else _values(rule_set, index, sample),
            (int(counts[index, 1]), int(counts[index, 0])) if has_counts else None,
        )

    def _current_sample(self, now: float) -> np.ndarray | None:
        """Return the features, unless they say nothing of now."""
        is_of_these = self.rule_set is not None and self._sampled_by == self.rule_set.fingerprint
        return self.sample if is_of_these and now - self._sampled <= LOST_SECONDS else None

    def _add(self, time: float, kind: str, text: str) -> None:
        self.changes.append(Change(time, self.name, kind, text))


@dataclass
class Fleet:
    """All robots and gates that were found.

    Attributes:
        robots: by the topic of their verdicts.
        gates: by the name of their node.
        events: that event recorders told of.
        change_count: how many changes there were so far.
    """

    robots: dict[str, Robot] = field(default_factory=dict)
    gates: dict[str, Gate] = field(default_factory=dict)
    events: EventLog = field(default_factory=EventLog)
    change_count: int = 0
    _changes: deque[Change] = field(default_factory=lambda: deque(maxlen=_MOST_CHANGES))
    _fresh: list[Change] = field(default_factory=list)

    def robot(self, topic: str, now: float) -> Robot:
        """Return the robot of a topic of verdicts, which may be new."""
        if topic not in self.robots:
            self.robots[topic] = Robot(topic, now)
            self.robots = dict(sorted(self.robots.items()))
            self.note(now, robot_name(topic), 'note', f'found verdicts on {topic}')
        return self.robots[topic]

    def forget_lost(self, now: float) -> list[str]:
        """Drop the robots and gates that are lost; return the topics of those robots."""
        lost = [topic for topic, item in self.robots.items() if item.standing(now) is Standing.LOST]
        for topic in lost:
            del self.robots[topic]
        self.gates = {name: gate for name, gate in self.gates.items() if not gate.is_lost}
        return lost

    def hear_gate(self, name: str, report: GateReport, when: float) -> None:
        """Take a message on the ``~/state`` of a gate."""
        gate = self.gates.get(name)
        before = None if gate is None or gate.is_lost else gate.report
        self.gates[name] = Gate(name, report, when)
        if before is None or _gate_kind(before) != _gate_kind(report):
            reason = f': {report.reason}' if report.reason else ''
            self.note(when, name, 'gate', f'{self.gates[name].words}{reason}')

    def gates_of(self, robot: Robot) -> list[Gate]:
        """Return the gates that listen to the verdicts on a robot."""
        return [gate for gate in self.gates.values() if robot.topic in gate.report.topics]

    def note(self, time: float, source: str, kind: str, text: str) -> None:
        """Add a change that is not found by listening to verdicts."""
        self._take(Change(time, source, kind, text))

    def tick(self, now: float) -> None:
        """Bring all robots and gates up to date."""
        for robot in self.robots.values():
            robot.tick(now)
            while robot.changes:
                self._take(robot.changes.popleft())
        for gate in self.gates.values():
            if now - gate.heard > LOST_SECONDS and not gate.is_lost:
                gate.is_lost = True
                self.note(now, gate.name, 'gate', f'LOST: silent for {LOST_SECONDS:g} s')

    def _take(self, change: Change) -> None:
        self.change_count += 1
        self._changes.append(change)
        self._fresh.append(change)

    def fresh_changes(self) -> list[Change]:
        """Return what has changed since the last call, oldest first."""
        fresh, self._fresh = self._fresh, []
        return sorted(fresh, key=lambda change: change.time)

    def changes(self) -> Iterator[Change]:
        """Return the newest changes, newest first."""
        return iter(sorted(self._changes, key=lambda change: change.time, reverse=True))


def robot_name(topic: str) -> str:
    """Return what to call the robot that a topic of verdicts is about.

    Example:
        >>> robot_name('/robot1/violation'), robot_name('/violation'), robot_name('/r/alarms')
        ('/robot1', '/', '/r/alarms')
    """
    return (topic.removesuffix('/violation') or '/') if topic.endswith('/violation') else topic


@lru_cache(maxsize=4)
def _read_rules(text: str) -> RuleSet:
    # The robots of a fleet mostly have the same ones, and to read thousands takes a while.
    return read_rules_in_force(text, 'topic rules')


def _gate_kind(report: GateReport) -> str:
    """Return what is news of a gate: that it stops, and why; not how fast it lets a robot go."""
    return f'STOP {without_numbers(report.reason)}' if report.state == 'STOP' else 'open'


def _values(rule_set: RuleSet, index: int, sample: np.ndarray) -> str:
    rule, names = rule_set.rules[index], rule_set.space.names
    if not np.isfinite(sample).all():
        members = [member for literal in rule.literals for member in literal.members]
        deciding = tuple(dict.fromkeys(members))[:1]
    else:
        deciding = rule.deciding(sample)
    return ', '.join(f'{names[feature]} {sample[feature]:.4g}' for feature in deciding)
