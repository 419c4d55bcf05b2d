# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in time as a picture: a band, the margin, a row for each rule, features at the worst."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from occ_constraints_pkg.checking.timeline import Interval, Timeline
from occ_constraints_pkg.picture_style import (
    FIGURE_WIDTH,
    NEUTRAL,
    SAFE,
    SAFE_AREA,
    UNKNOWN_AREA,
    VIOLATED,
    legend_below,
    save_figure,
)
from occ_constraints_pkg.rules.rule import Literal, Rule, Subject, subject_label
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

_AREAS = {'SAFE': SAFE_AREA, 'VIOLATED': VIOLATED, 'UNKNOWN': UNKNOWN_AREA}
_HATCHES = {'SAFE': '', 'VIOLATED': '', 'UNKNOWN': '////'}
# Rules with a row of their own at most, those violated longest; and with a panel of the feature.
_MOST_RULES, _MOST_PANELS = 20, 3
# Features of one rule that are drawn.
_MOST_SUBJECTS = 3
# What fits over the width of the picture, in a row and in a panel.
_LETTERS, _LETTERS_OF_PANEL = 100, 36
# A violation narrower than this share of the axis is pointed at as well.
_NARROW, _MOST_POINTERS = 0.004, 40
# Episodes with a line between them at most.
_MOST_SEPARATORS = 60
# Columns over the width: of more samples, the range in each is drawn.
_COLUMNS = 800
# Between ticks: these, times a power of 10.
_STEPS = [1.0, 2.0, 5.0, 10.0]
# Of a panel: time before and after a violation, and at most, in s and in rows.
_AROUND, _LONGEST = {'s': 2.0, 'row': 20.0}, {'s': 12.0, 'row': 200.0}


def draw_timeline(path: Path, timeline: Timeline, rule_set: RuleSet, rules_name: str) -> None:
    """Draw a timeline to a file; see :func:`timeline_figure`.

    Args:
        path: PNG file to write.
        timeline: what to draw.
        rule_set: the rules.
        rules_name: their name, for the title.
    """
    save_figure(timeline_figure(timeline, rule_set, rules_name), path)


def timeline_figure(timeline: Timeline, rule_set: RuleSet, rules_name: str) -> Figure:
    """Return a figure of a timeline.

    Episodes are laid end to end; the ticks tell the time of each recording, as the list of
    violations does. Below are, for the rules violated longest, the features with their bounds
    around the worst violation.

    Args:
        timeline: what to draw.
        rule_set: the rules.
        rules_name: their name, for the title.
    """
    axis_of = _Axis(timeline)
    lengths: dict[int, float] = {}
    for item in timeline.violations:
        lengths[item.rule] = lengths.get(item.rule, 0.0) + item.active
    by_length = sorted(lengths, key=lambda rule: -lengths[rule])
    shown = by_length[:_MOST_RULES]
    worst = [
        min((item for item in timeline.violations if item.rule == rule), key=_badness)
        for rule in by_length[:_MOST_PANELS]
    ]
    heights = [0.45, 1.7, max(0.42 * len(shown), 0.5)]
    below = 1.25 * max((len(_subjects(rule_set, item)) for item in worst), default=0)
    parts = [sum(heights) + 1.75, *([below + 1.1] if worst else [])]
    # Names of features are no formulas, whatever signs are in them.
    with plt.rc_context({'text.parse_math': False}):
        figure = plt.figure(figsize=(FIGURE_WIDTH, sum(parts)), layout='constrained')
        areas = figure.subfigures(len(parts), 1, height_ratios=parts, squeeze=False)[:, 0]
        figure.suptitle(_title(timeline, rules_name), fontsize=11)
        band, margin, rows = areas[0].subplots(3, 1, height_ratios=heights, sharex=True)
        _draw_band(band, timeline, axis_of)
        _draw_margin(margin, timeline, axis_of)
        _draw_rules(rows, timeline, axis_of, rule_set, shown)
        if len(lengths) > len(shown):
            rows.set_title(f'{len(shown)} of {len(lengths)} violated rules', fontsize=9)
        for axis in (band, margin, rows):
            _draw_separators(axis, axis_of)
        rows.set_xlim(0.0, axis_of.end)
        rows.set_xticks(*axis_of.ticks)
        rows.set_xlabel(axis_of.label, fontsize=9)
        legend_below(areas[0], _verdict_handles(timeline))
        if worst:
            _draw_panels(areas[1], timeline, rule_set, worst)
    return figure


def _badness(item: Interval) -> float:
    return item.margin if math.isfinite(item.margin) else 0.0


def _title(timeline: Timeline, rules_name: str) -> str:
    sources = [source['name'] for source in timeline.data.sources]
    what = sources[0] if len(sources) == 1 else count_of(len(sources), 'recording')
    return printable(f'{what} judged by {rules_name}')


def _verdict_handles(timeline: Timeline) -> list[Patch]:
    return [
        Patch(fc=colour, ec='white', hatch=_HATCHES[name], label=f'{name} {_percent(share)}')
        for name, colour in _AREAS.items()
        for share in [timeline.shares[name]]
    ]


def _percent(share: float) -> str:
    # What is there is not told as nothing.
    return '< 0.1%' if 0.0 < share < 0.0005 else f'{share:.1%}'


class _Axis:
    """Where each episode lies on an axis that all share, one after another.

    Attributes:
        rows: (n,) where each row of the data begins.
        end: of the axis.
        separators: where an episode begins after another of its recording.
        marks: where each recording begins, if there are several, and its name.
        ticks: places, and the times of the recordings there.
        label: of the axis.
    """

    def __init__(self, timeline: Timeline) -> None:
        data = timeline.data
        ends = timeline.starts + timeline.valid_for + timeline.silence
        episodes, first, place = np.unique(data.episodes, return_index=True, return_inverse=True)
        begins, lasts = np.full(len(episodes), np.inf), np.full(len(episodes), -np.inf)
        np.minimum.at(begins, place.reshape(-1), timeline.starts)
        np.maximum.at(lasts, place.reshape(-1), ends)
        if len(episodes) == 1:
            # The silence before the first sample is part of the recording.
            begins[:] = 0.0
        order = np.argsort(first)
        begins, lasts = begins[order], lasts[order]
        lengths = lasts - begins
        offsets = np.cumsum(lengths) - lengths
        shifts = np.empty(len(episodes))
        shifts[order] = offsets - begins
        self.rows = timeline.starts + shifts[place.reshape(-1)]
        # A single row lasts no time, but an axis has a length.
        self.end = float(lengths.sum()) or 1.0
        self.marks: list[tuple[float, str]] = []
        if len(data.sources) > 1 and data.recordings is not None:
            names, where = np.unique(data.recordings[first[order]], return_index=True)
            self.marks = [
                (float(offsets[at]), printable(data.sources[name]['name']))
                for at, name in zip(where.tolist(), names.tolist(), strict=True)
            ]
        of_recordings = {start for start, _ in self.marks} | {0.0}
        self.separators = [at for at in offsets.tolist() if at not in of_recordings]
        self.ticks = self._ticks(offsets, begins, lasts)
        each = 'each' if self.marks else 'the'
        self.label = (
            f'time since the start of {each} recording [s]'
            if timeline.unit == 's'
            else f'row of {each} file'
        )
        if len(episodes) > 1:
            self.label += f'; {len(episodes)} episodes end to end'

    def _ticks(
        self, offsets: np.ndarray, begins: np.ndarray, lasts: np.ndarray
    ) -> tuple[list[float], list[str]]:
        values = MaxNLocator(8, steps=_STEPS).tick_values(0.0, self.end)
        step = float(values[1] - values[0])
        places, labels = [-self.end], ['']
        for offset, begin, last in zip(offsets, begins, lasts, strict=True):
            times = step * np.arange(math.ceil(begin / step - 1e-9), math.floor(last / step) + 1)
            # Where one episode ends and the next begins, the next one's time is told.
            if offset + last - begin < self.end:
                times = times[last - times > 0.4 * step]
            # Of episodes shorter than a step, some are told when they begin.
            if not len(times) and offset - places[-1] > 0.9 * step:
                times = np.array([begin])
            for time in times.tolist():
                at = float(offset + time - begin)
                if at - places[-1] > 0.4 * step:
                    places.append(at)
                    labels.append(f'{time:.6g}')
        del places[0], labels[0]
        return places, labels


def _spans(starts: np.ndarray, lengths: np.ndarray, gap: float = 1e-9) -> list[tuple[float, float]]:
    """Return start and length of each stretch that intervals in ascending order cover."""
    if not len(starts):
        return []
    ends = np.maximum.accumulate(starts + lengths)
    firsts = np.flatnonzero(np.append(True, starts[1:] > ends[:-1] + gap))
    lasts = np.append(firsts[1:] - 1, len(starts) - 1)
    return list(zip(starts[firsts].tolist(), (ends[lasts] - starts[firsts]).tolist(), strict=True))


def _draw_band(axis: Axes, timeline: Timeline, axis_of: _Axis) -> None:
    # Silence is drawn as rows of its own, after those whose verdict it ends.
    silent = timeline.silence > 0
    starts = np.concatenate([axis_of.rows, (axis_of.rows + timeline.valid_for)[silent]])
    widths = np.concatenate([timeline.valid_for, timeline.silence[silent]])
    unknown = np.full(np.count_nonzero(silent), Verdict.UNKNOWN)
    verdicts = np.concatenate([timeline.judgement.verdict, unknown])
    order = np.argsort(starts, kind='stable')
    starts, widths, verdicts = starts[order], widths[order], verdicts[order]
    for each in Verdict:
        chosen = verdicts == each
        # A long recording has too many rows to draw each.
        spans = _spans(starts[chosen], widths[chosen])
        is_safe = each is Verdict.SAFE
        # With an edge, so that what is not safe shows however short it is.
        axis.broken_barh(
            spans, (0.0, 1.0), fc=_AREAS[each.name], ec='white' if is_safe else _AREAS[each.name],
            lw=0.0 if is_safe else 0.7,
        )  # fmt: skip
        if each is Verdict.UNKNOWN and spans:
            axis.broken_barh(
                spans, (0.0, 1.0), fc='none', ec='white', hatch=_HATCHES[each.name], lw=0.0
            )
        if each is Verdict.VIOLATED:
            narrow = [at + width / 2 for at, width in spans if width < _NARROW * axis_of.end]
            if len(narrow) <= _MOST_POINTERS:
                axis.plot(narrow, [0.82] * len(narrow), 'v', color=VIOLATED, ms=6, mec='white',
                          mew=0.6)  # fmt: skip
    axis.set_yticks([0.5], ['verdict'], fontsize=9)
    axis.tick_params(length=0)
    axis.set_ylim(0.0, 1.0)
    for number, (start, name) in enumerate(axis_of.marks):
        following = [*axis_of.marks[number + 1 :], (axis_of.end, '')][0][0]
        room = int(_LETTERS * (following - start) / axis_of.end)
        text = name if len(name) <= room else name[: room - 1] + '…'
        if room > 1:
            axis.text(start, 1.1, text, fontsize=8)


def _draw_margin(axis: Axes, timeline: Timeline, axis_of: _Axis) -> None:
    order = np.argsort(axis_of.rows, kind='stable')
    times, margins = axis_of.rows[order], timeline.judgement.margin[order]
    margins = np.where(np.isfinite(margins), margins, np.nan)
    axis.axhline(0.0, color='black', lw=0.8)
    axis.set_ylabel('margin', fontsize=9)
    axis.tick_params(axis='y', labelsize=8)
    axis.grid(alpha=0.3)
    known = margins[np.isfinite(margins)]
    if not len(known):
        return
    if len(times) <= 2 * _COLUMNS:
        # No line from one episode to the next, and none where nothing came.
        episodes, silence = timeline.data.episodes[order], timeline.silence[order]
        breaks = np.flatnonzero((np.diff(episodes) != 0) | (silence[:-1] > 0)) + 1
        axis.plot(np.insert(times, breaks, np.nan), np.insert(margins, breaks, np.nan),
                  color=SAFE, lw=1.0)  # fmt: skip
        low_times, lows = times, margins
    else:
        low_times, lows, highs = _columns(times, margins, axis_of.end)
        axis.fill_between(low_times, lows, highs, color=SAFE_AREA, lw=0)
        axis.plot(low_times, lows, color=SAFE, lw=0.8)
    # One outlier would leave all others no height.
    usual = np.percentile(known, [1.0, 99.0])
    height = max(usual[1], 0.0) - min(usual[0], 0.0)
    bottom, top = min(known.min(), 0.0), max(known.max(), 0.0)
    if height and bottom < min(usual[0], 0.0) - height:
        bottom = min(usual[0], 0.0) - 0.5 * height
        axis.set_title(f'lowest margin {known.min():.3g}', fontsize=8, loc='right', pad=2)
    if height and top > max(usual[1], 0.0) + height:
        top = max(usual[1], 0.0) + 0.5 * height
    room = 0.08 * (top - bottom) or 0.1
    axis.set_ylim(bottom - room, top + room)
    bad = lows < 0.0
    below = bad & (lows < bottom)
    axis.plot(low_times[bad & ~below], lows[bad & ~below], '.', color=VIOLATED, ms=4)
    axis.plot(low_times[below], np.full(below.sum(), bottom), 'v', color=VIOLATED, ms=6)


def _columns(
    times: np.ndarray, values: np.ndarray, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle of each column that has values, and the least and largest in it."""
    known = np.isfinite(values)
    column = np.minimum((times[known] / end * _COLUMNS).astype(np.int64), _COLUMNS - 1)
    lows, highs = np.full(_COLUMNS, np.inf), np.full(_COLUMNS, -np.inf)
    np.minimum.at(lows, column, values[known])
    np.maximum.at(highs, column, values[known])
    used = np.isfinite(lows)
    middles = (np.arange(_COLUMNS) + 0.5) * end / _COLUMNS
    return middles[used], lows[used], highs[used]


def _draw_rules(
    axis: Axes, timeline: Timeline, axis_of: _Axis, rule_set: RuleSet, shown: Sequence[int]
) -> None:
    for row, rule in enumerate(shown):
        # Without the breaks that make one violation of two: then the verdict may be another.
        samples = np.concatenate(
            [item.samples for item in timeline.violations if item.rule == rule]
        )
        samples = samples[np.argsort(axis_of.rows[samples], kind='stable')]
        spans = _spans(axis_of.rows[samples], timeline.valid_for[samples])
        axis.broken_barh(spans, (row - 0.05, 0.38), color=VIOLATED, lw=0.7)
        item = rule_set.rules[rule]
        words = printable(f'{item.id}: {item.words(rule_set.space)}')
        text = words if len(words) <= _LETTERS else words[: _LETTERS - 1] + '…'
        axis.text(0.006, row - 0.12, text, fontsize=8, transform=axis.get_yaxis_transform(),
                  bbox={'color': 'white', 'alpha': 0.8, 'pad': 0.5})  # fmt: skip
    axis.set_yticks([])
    axis.set_ylabel('rules', fontsize=9)
    axis.tick_params(axis='x', labelsize=9)
    axis.set_ylim(len(shown) - 0.55 if shown else 0.6, -0.6)
    if not shown:
        axis.text(0.5, 0.5, 'no rule is violated', transform=axis.transAxes, ha='center',
                  va='center', fontsize=9)  # fmt: skip
    axis.grid(axis='x', alpha=0.3)


def _draw_separators(axis: Axes, axis_of: _Axis) -> None:
    marks = [start for start, _ in axis_of.marks if start > 0.0]
    for places, style in ((axis_of.separators, ':'), (marks, '-')):
        if len(places) <= _MOST_SEPARATORS:
            for place in places:
                axis.axvline(place, color='black', lw=0.8, ls=style)


def _subjects(rule_set: RuleSet, item: Interval) -> dict[Subject, list[Literal]]:
    """Return the literals of a violated rule by what they limit, the first few."""
    found: dict[Subject, list[Literal]] = {}
    for literal in rule_set.rules[item.rule].tightest_literals:
        found.setdefault(literal.subject, []).append(literal)
    return dict(list(found.items())[:_MOST_SUBJECTS])


def _draw_panels(
    part: SubFigure, timeline: Timeline, rule_set: RuleSet, worst: Sequence[Interval]
) -> None:
    """Draw the features of rules against their bounds, a column for each rule."""
    lines = max(len(_subjects(rule_set, item)) for item in worst)
    # A single one is no wider than one of two, so that its text has the same size.
    columns = max(2, len(worst))
    axes = part.subplots(lines, columns, squeeze=False, sharex='col')
    part.suptitle('Features against their bounds around the worst violation of a rule', fontsize=10)
    unit = 's' if timeline.unit == 's' else ''
    for number, column in enumerate(axes.T):
        if number >= len(worst):
            for axis in column:
                axis.remove()
            continue
        item = worst[number]
        subjects = _subjects(rule_set, item)
        window = _Window.around(timeline, item)
        for axis, (subject, literals) in zip(column, subjects.items(), strict=False):
            window.draw(axis, timeline, literals)
            axis.set_ylabel(
                '\n'.join(textwrap.wrap(subject_label(subject, rule_set.space), 16)), fontsize=8
            )
        for axis in column[len(subjects) :]:
            axis.remove()
        last = column[len(subjects) - 1]
        last.tick_params(labelbottom=True)
        last.set_xlabel('time [s]' if unit else 'row', fontsize=8)
        column[0].set_title(
            _panel_title(timeline, rule_set.rules[item.rule], rule_set, item), fontsize=8,
            loc='left',
        )  # fmt: skip
    handles = [
        plt.Line2D([], [], color=SAFE, lw=1.4, marker='.', label='feature'),
        plt.Line2D([], [], color=VIOLATED, lw=1.4, ls='--', label='bound'),
        Patch(fc=VIOLATED, alpha=0.25, label='rule violated'),
        plt.Line2D([], [], color=NEUTRAL, marker='o', mfc='none', ls='', label='worst sample'),
    ]
    legend_below(part, handles)


def _panel_title(timeline: Timeline, rule: Rule, rule_set: RuleSet, item: Interval) -> str:
    words = f'{rule.id}: {rule.words(rule_set.space)}'
    lines = textwrap.wrap(printable(words), _LETTERS_OF_PANEL)
    if len(lines) > 2:
        lines = [lines[0], lines[1][: _LETTERS_OF_PANEL - 1] + '…']
    if len(timeline.data.sources) > 1:
        name = printable(timeline.data.sources[item.source]['name'])
        lines.append(
            name if len(name) <= _LETTERS_OF_PANEL else '…' + name[1 - _LETTERS_OF_PANEL :]
        )
    return '\n'.join(lines)


@dataclass(frozen=True)
class _Window:
    """The samples of an episode around a violation.

    Attributes:
        rows: row numbers, in the order of time.
        times: (n,) when they came, of their recording.
        lengths: (n,) how long their verdict is valid.
        worst: the worst row.
        ends: first and last time.
        held: start and length of the stretches in which the rule is true.
    """

    rows: np.ndarray
    times: np.ndarray
    lengths: np.ndarray
    worst: int
    ends: tuple[float, float]
    held: list[tuple[float, float]]

    @classmethod
    def around(cls, timeline: Timeline, item: Interval) -> _Window:
        """Return the window of an interval; of a long one, what is around its worst sample."""
        around, longest = _AROUND[timeline.unit], _LONGEST[timeline.unit]
        begin, end = item.start - around, item.end + around
        if end - begin > longest:
            middle = float(timeline.starts[item.worst])
            begin = min(max(begin, middle - longest / 2), end - longest)
            end = begin + longest
        rows = np.flatnonzero(
            (timeline.data.episodes == item.episode)
            & (timeline.starts >= begin)
            & (timeline.starts <= end)
        )
        rows = rows[np.argsort(timeline.starts[rows], kind='stable')]
        times, lengths = timeline.starts[rows], timeline.valid_for[rows]
        ends = float(times[0]), float(times[-1] + lengths[-1])
        # Of all violations of this rule, not only of this one.
        true = np.zeros(len(timeline.data), dtype=bool)
        for each in timeline.violations:
            if each.rule == item.rule and each.episode == item.episode:
                true[each.samples] = True
        held = _spans(times[true[rows]], lengths[true[rows]])
        return cls(rows, times, lengths, item.worst, ends, held)

    def draw(self, axis: Axes, timeline: Timeline, literals: Iterable[Literal]) -> None:
        """Draw one feature, and the bounds that the literals set it."""
        literals = list(literals)
        # The same number decides for each of them.
        values = literals[0].values(timeline.data.values[self.rows])
        values = np.where(np.isfinite(values), values, np.nan)
        axis.broken_barh(
            self.held, (0.0, 1.0), transform=axis.get_xaxis_transform(), fc=VIOLATED, alpha=0.2,
            lw=0,
        )  # fmt: skip
        marker = '.' if len(values) <= 150 else ''
        axis.plot(self.times, values, color=SAFE, lw=1.2, marker=marker, ms=4)
        place = int(np.flatnonzero(self.rows == self.worst)[0])
        axis.plot(self.times[place], values[place], 'o', mfc='none', color=NEUTRAL, ms=8)
        for literal in literals:
            axis.axhline(literal.bound, color=VIOLATED, lw=1.4, ls='--')
        axis.margins(y=0.15)
        axis.set_xlim(*self.ends if self.ends[1] > self.ends[0] else (None, None))
        axis.xaxis.set_major_locator(MaxNLocator(4, steps=_STEPS))
        axis.yaxis.set_major_locator(MaxNLocator(4, steps=_STEPS))
        axis.ticklabel_format(useOffset=False)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.3)
