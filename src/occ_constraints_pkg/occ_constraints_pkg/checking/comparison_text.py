# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What got worse, as text and as plain values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from occ_constraints_pkg.checking.comparison import (
    DEEPER,
    Change,
    Comparison,
    RecordingComparison,
    Side,
    Times,
)
from occ_constraints_pkg.checking.timeline import Interval
from occ_constraints_pkg.checking.timeline_text import violation_entry
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

# At most so many changes of a recording are listed, those that are worse first.
_MOST = 20


def describe_comparison(comparison: Comparison) -> str:
    """Return the verdict, then for each recording what changed, where and by how much."""
    lines = [headline(comparison)]
    unchanged = 0
    for item in comparison.recordings:
        told = list(_recording_lines(item, comparison))
        if told:
            lines += [f'{item.name}: {"worse" if item.is_worse else "not worse"}', *told]
        else:
            unchanged += 1
    if unchanged:
        lines.append(f'{count_of(unchanged, "recording")} without a change')
    return '\n'.join(map(printable, lines))


def findings(item: RecordingComparison, comparison: Comparison) -> list[tuple[str, str]]:
    """Return what is to be said of a recording as a whole, each a word and an explanation."""
    unit = _unit(comparison)
    if item.before is None or item.after is None:
        side = comparison.before if item.before is None else comparison.after
        return [('missing', f'there is no such recording in {side.name}')]
    before, after = item.before, item.after
    found = []
    if abs(change := after.unknown - before.unknown) > comparison.tolerance:
        told = f'{before.unknown:.2f} -> {after.unknown:.2f}{unit} ({change:+.2f}{unit})'
        found.append(('UNKNOWN', told))
    is_changed = any(change.kind != 'same' for change in item.changes)
    if abs(item.shift) > comparison.tolerance and is_changed:
        told = (
            f'{item.shift:+.2f} s, by header stamps, to match moments; --clock start: by the time'
        )
        found.append(('shifted', f'{told} since each start'))
    if item.is_shorter:
        told = f'{after.total:.2f} of {before.total:.2f}{unit}; --allow-shorter accepts it'
        found.append(('too short', told))
    return found


def place(change: Change, comparison: Comparison) -> tuple[str, float, float]:
    """Return where a change is, by the clock of the recording that shows it, the later one.

    Returns:
        The episode in words, empty where each recording is one; beginning; end.
    """
    side, own = list(_own(change, comparison))[-1]
    data = side.timeline.data
    has_episodes = len(np.unique(data.episodes)) > len(side.names)
    words = f'episode {own[0].episode}  ' if has_episodes else ''
    return words, own[0].start, max(item.end for item in own)


def amount_words(change: Change, comparison: Comparison) -> str:
    """Return by how much a change is worse or better."""
    unit = _unit(comparison)
    before, after = (sum(own.active for own in side) for side in (change.before, change.after))
    if change.kind in ('new', 'gone'):
        text = f'{max(before, after):.2f}{unit}'
    else:
        text = f'{before:.2f} -> {after:.2f}{unit} ({change.seconds:+.2f}{unit})'
    if change.depth is not None and abs(change.depth) > DEEPER:
        margins = (min(own.margin for own in side) for side in (change.before, change.after))
        text += ', margin {:.3g} -> {:.3g}'.format(*margins)
    if change.unjudged and change.is_worse:
        text += f', of which {change.unjudged:.2f}{unit} cannot be judged after'
    return text


def rule_words(change: Change, comparison: Comparison) -> str:
    """Return the rule of a change, both where they differ."""
    told = [
        f'{rule.id} {rule.words(side.rule_set.space)}'
        for side, own in _own(change, comparison)
        for rule in [side.rule_set.rules[own[0].rule]]
    ]
    if change.is_same_rule or len(told) < 2:
        return told[-1]
    return f'{told[1]}, where before it was {told[0]}'


def worst(change: Change, comparison: Comparison) -> str:
    """Return the worst moment of the last side that has one, with the values that decide."""
    side, own = list(_own(change, comparison))[-1]
    item = min(own, key=lambda interval: interval.margin)
    timeline, space = side.timeline, side.rule_set.space
    sample = timeline.data.values[item.worst]
    rule = side.rule_set.rules[item.rule]
    values = ', '.join(
        f'{space.names[feature]} {sample[feature]:.4g}' for feature in rule.deciding(sample)
    )
    time = float(timeline.starts[item.worst])
    return f'worst at {_time(time, comparison)}: {values}; margin {item.margin:.4g}'


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison as plain values, ready for JSON."""
    return {
        'worse': comparison.is_worse,
        'unit': comparison.before.timeline.unit,
        'before': comparison.before.name,
        'after': comparison.after.name,
        'tolerance': comparison.tolerance,
        'counts': comparison.counts,
        'recordings': [
            {
                'name': item.name,
                'worse': item.is_worse,
                'findings': list(item.findings),
                'before': _times(item.before),
                'after': _times(item.after),
                'shift': item.shift,
                'changes': [
                    {
                        'kind': change.kind,
                        'worse': change.is_worse,
                        'same_rule': change.is_same_rule,
                        'change': change.seconds,
                        'depth': change.depth,
                        'unjudged': change.unjudged,
                        'before': _entries(change.before, comparison.before),
                        'after': _entries(change.after, comparison.after),
                    }
                    for change in item.changes
                ],
            }
            for item in comparison.recordings
        ],
    }


def headline(comparison: Comparison) -> str:
    """Return the verdict, and how many changes of each kind there are, in one sentence."""
    worse = [item for item in comparison.recordings if item.is_worse]
    kinds = ', '.join(f'{count} {kind}' for kind, count in comparison.counts.items() if count)
    told = f'violations: {kinds}' if kinds else 'no violation on either side'
    where = f'{comparison.after.name} against {comparison.before.name}'
    if not worse:
        return f'not worse: {where}; {told}'
    amount = f'{len(worse)} of {count_of(len(comparison.recordings), "recording")}'
    return f'worse in {amount}: {where}; {told}'


def _recording_lines(item: RecordingComparison, comparison: Comparison) -> Iterator[str]:
    yield from (f'  {word:<9}  {told}' for word, told in findings(item, comparison))
    changes = [change for change in item.changes if change.is_worse or change.kind != 'same']
    shown = sorted(changes, key=lambda change: not change.is_worse)[:_MOST]
    if len(changes) > len(shown):
        yield f'  {count_of(len(changes), "change")}, {_MOST} of them:'
    for change in changes:
        if change in shown:
            episode, start, end = place(change, comparison)
            where = f'{episode}{_time(start, comparison)} to {_time(end, comparison)}'
            what = f'{rule_words(change, comparison)}: {amount_words(change, comparison)}'
            yield f'  {change.kind:<9}  {where}  {what}'
            yield f'             {worst(change, comparison)}'


def _own(change: Change, comparison: Comparison) -> Iterator[tuple[Side, tuple[Interval, ...]]]:
    for side, own in ((comparison.before, change.before), (comparison.after, change.after)):
        if own:
            yield side, own


def _entries(own: tuple[Interval, ...], side: Side) -> list[dict[str, Any]]:
    return [violation_entry(item, side.timeline, side.rule_set) for item in own]


def _times(times: Times | None) -> dict[str, float] | None:
    return None if times is None else asdict(times)


def _unit(comparison: Comparison) -> str:
    return ' s' if comparison.before.timeline.unit == 's' else ' rows'


def _time(time: float, comparison: Comparison) -> str:
    return f'{time:.3f} s' if comparison.before.timeline.unit == 's' else f'row {time:.0f}'
