# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in time as a picture: a band, the margin, and a line for each violated rule."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Patch

from occ_constraints_pkg.checking.timeline import Timeline
from occ_constraints_pkg.files import PICTURE, replacing
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

_COLOURS = {'SAFE': '#6aa84f', 'VIOLATED': '#c8362b', 'UNKNOWN': '#bbbbbb'}
_DOTS_PER_INCH = 110
# Rules with a line of their own at most, those violated longest.
_MOST_RULES = 20
# What fits over the width of the picture.
_LETTERS = 125


def draw_timeline(path: Path, timeline: Timeline, rule_set: RuleSet) -> None:
    """Draw a timeline; episodes of one and of several recordings are laid end to end.

    Args:
        path: PNG file to write.
        timeline: what to draw.
        rule_set: the rules.
    """
    axis_of = _Axis(timeline)
    lengths: dict[int, float] = {}
    for item in timeline.violations:
        lengths[item.rule] = lengths.get(item.rule, 0.0) + item.active
    shown = sorted(lengths, key=lambda rule: -lengths[rule])[:_MOST_RULES]
    heights = [0.5, 2.2, max(0.4 * len(shown), 0.4)]
    figure, (band, margin, rules) = plt.subplots(
        3, 1, figsize=(11, sum(heights) + 1.5), height_ratios=heights, sharex=True
    )
    _draw_band(band, timeline, axis_of)
    _draw_margin(margin, timeline, axis_of)
    for row, rule in enumerate(shown):
        spans = [
            (axis_of.at(item.episode, item.start), item.end - item.start)
            for item in timeline.violations
            if item.rule == rule
        ]
        rules.broken_barh(spans, (row - 0.35, 0.7), color=_COLOURS['VIOLATED'], lw=0.5)
    labels = [_label(rule_set, rule) for rule in shown]
    rules.set_yticks(range(len(shown)), labels, fontsize=8)
    rules.set_ylim(len(shown) - 0.4 if shown else 0.6, -0.6)
    rules.set_xlim(0.0, axis_of.end)
    if not shown:
        rules.text(0.5, 0.5, 'no rule is violated', transform=rules.transAxes, ha='center')
    elif len(lengths) > len(shown):
        rules.set_title(f'{len(shown)} of {len(lengths)} violated rules', fontsize=9)
    rules.grid(axis='x', alpha=0.3)
    for start, _ in axis_of.marks:
        for axis in (margin, rules):
            axis.axvline(start, color='black', lw=0.6, ls=':')
    rules.set_xlabel(axis_of.label)
    handles = [
        Patch(color=colour, label=f'{name} {timeline.shares[name]:.1%}')
        for name, colour in _COLOURS.items()
    ]
    rules.legend(
        handles=handles, loc='upper right', bbox_to_anchor=(1.0, -36 / rules.bbox.height),
        ncols=3, fontsize=8, frameon=False,
    )  # fmt: skip
    figure.tight_layout()
    try:
        with replacing(path, PICTURE) as draft:
            figure.savefig(draft, dpi=_DOTS_PER_INCH, format='png')
    finally:
        plt.close(figure)


class _Axis:
    """Where each episode lies on an axis that all share, one after another."""

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
        offsets = np.empty(len(episodes))
        lengths = (lasts - begins)[order]
        offsets[order] = np.cumsum(lengths) - lengths
        shifts = offsets - begins
        self._shift = dict(zip(episodes.tolist(), shifts.tolist(), strict=True))
        self.rows = timeline.starts + shifts[place.reshape(-1)]
        self.end = float(lengths.sum())
        self.marks: list[tuple[float, str]] = []
        if len(data.sources) > 1:
            names, where = np.unique(data.recordings[first[order]], return_index=True)
            starts = offsets[order][where].tolist()
            self.marks = [
                (start, data.sources[name]['name'])
                for start, name in zip(starts, names.tolist(), strict=True)
            ]
        unit = 's since the start of the recording' if timeline.unit == 's' else 'row'
        several = f'{timeline.unit}, {len(episodes)} episodes end to end'
        self.label = unit if len(episodes) == 1 else several

    def at(self, episode: int, time: float) -> float:
        return time + self._shift[episode]


def _draw_band(axis: plt.Axes, timeline: Timeline, axis_of: _Axis) -> None:
    # Silence is drawn as rows of its own, after those whose verdict it ends.
    silent = timeline.silence > 0
    starts = np.concatenate([axis_of.rows, (axis_of.rows + timeline.valid_for)[silent]])
    widths = np.concatenate([timeline.valid_for, timeline.silence[silent]])
    unknown = np.full(np.count_nonzero(silent), Verdict.UNKNOWN)
    verdicts = np.concatenate([timeline.judgement.verdict, unknown])
    order = np.argsort(starts, kind='stable')
    starts, widths, verdicts = starts[order], widths[order], verdicts[order]
    # A long recording has too many rows to draw each.
    firsts = np.flatnonzero(np.diff(verdicts, prepend=-1))
    lasts = np.append(firsts[1:] - 1, len(starts) - 1)
    ends = starts[lasts] + widths[lasts]
    for each in Verdict:
        chosen = verdicts[firsts] == each
        spans = np.stack([starts[firsts], ends - starts[firsts]], axis=1)[chosen]
        # With an edge, so that what is not safe shows however short it is.
        edge = 0.0 if each is Verdict.SAFE else 0.7
        axis.broken_barh(spans.tolist(), (0.0, 1.0), color=_COLOURS[each.name], lw=edge)
    axis.set_yticks([0.5], ['verdict'], fontsize=8)
    axis.set_ylim(0.0, 1.0)
    for number, (start, name) in enumerate(axis_of.marks):
        following = [*axis_of.marks[number + 1 :], (axis_of.end, '')][0][0]
        room = int(_LETTERS * (following - start) / axis_of.end)
        text = name if len(name) <= room else name[: room - 1] + '…'
        if room > 1:
            axis.text(start, 1.08, text, fontsize=7)


def _draw_margin(axis: plt.Axes, timeline: Timeline, axis_of: _Axis) -> None:
    order = np.argsort(axis_of.rows, kind='stable')
    times, margins = axis_of.rows[order], timeline.judgement.margin[order]
    axis.axhline(0.0, color='black', lw=0.8)
    axis.plot(times, np.where(np.isfinite(margins), margins, np.nan), color='#3b6ea5', lw=1.0)
    bad = margins < 0.0
    axis.plot(times[bad], margins[bad], '.', color=_COLOURS['VIOLATED'], ms=3)
    axis.set_ylabel('margin', fontsize=8)
    axis.grid(alpha=0.3)


def _label(rule_set: RuleSet, rule: int) -> str:
    item = rule_set.rules[rule]
    words = item.words(rule_set.space)
    return f'{item.id}  {words if len(words) <= 60 else words[:57] + "..."}'
