# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in time, as text and as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.checking.early_warning import WarningRecord
from occ_constraints_pkg.checking.early_warning_text import warnings_document
from occ_constraints_pkg.checking.timeline import Interval, Timeline
from occ_constraints_pkg.rules.ruleset import RuleCounts, RuleSet
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

# At most so many violations are listed one by one.
_MOST = 20


def describe_timeline(timeline: Timeline, rule_set: RuleSet) -> str:
    """Return shares of time, what was violated, and the worst intervals in order of time."""
    data, unit = timeline.data, _unit(timeline)
    amount = count_of(len(data), 'sample') + (f' in {timeline.duration:.2f} s' if unit else '')
    shares = ', '.join(f'{share:.2%} {name}' for name, share in timeline.shares.items())
    lines = [f'{amount}: {shares}' + (' of the time' if unit else '')]
    silent = timeline.silence > 0
    if silent.any():
        lines.append(
            f'no new input for longer than a verdict is valid, {np.count_nonzero(silent)} times, '
            f'{timeline.silence.sum():.2f} s in all, which count as UNKNOWN'
        )
    if timeline.unknown:
        lines.append(
            f'{count_of(len(timeline.unknown), "interval")} UNKNOWN: {_causes(timeline, rule_set)}'
        )
    if timeline.violations:
        lines += _rule_lines(timeline, rule_set) + _violation_lines(timeline, rule_set)
    return '\n'.join(map(printable, lines))


def check_document(
    timeline: Timeline, rule_set: RuleSet, counts: RuleCounts, warnings: WarningRecord | None
) -> dict[str, Any]:
    """Return all that ``occ check`` finds as plain values, ready for JSON.

    Args:
        timeline: of the verdicts.
        rule_set: the rules.
        counts: of these rules on the timeline's samples.
        warnings: how early violations were warned of, if that was asked for.
    """
    verdict, margin = timeline.judgement.verdict, timeline.judgement.margin
    violated = [
        {'id': rule.id, 'text': rule.words(rule_set.space), 'violated': int(count)}
        for rule, count in zip(rule_set.rules, counts.violated, strict=True)
        if count
    ]
    known = verdict != Verdict.UNKNOWN
    smallest = float(np.nanmin(margin)) if known.any() else np.nan
    return {
        'samples': len(timeline.data),
        'shares': {item.name: float(np.mean(verdict == item)) for item in Verdict},
        'violated_rules': sorted(violated, key=lambda item: -item['violated']),
        'smallest_margin': smallest if np.isfinite(smallest) else None,
        **timeline_document(timeline, rule_set),
        **({'warnings': warnings_document(warnings, timeline, rule_set)} if warnings else {}),
    }


def timeline_document(timeline: Timeline, rule_set: RuleSet) -> dict[str, Any]:
    """Return the timeline as plain values, ready for JSON."""
    return {
        'unit': timeline.unit,
        'duration': timeline.duration,
        'shares_of_time': timeline.shares,
        'silence': float(timeline.silence.sum()),
        'sources': [source['name'] for source in timeline.data.sources],
        'violations': [violation_entry(item, timeline, rule_set) for item in timeline.violations],
        'unknown': [
            {**_entry(item, timeline), 'features': unusable_features(item, timeline, rule_set)}
            for item in timeline.unknown
        ],
    }


def _rule_lines(timeline: Timeline, rule_set: RuleSet) -> list[str]:
    """Say how often and how long each rule is violated, the longest first."""
    totals: dict[int, list[float]] = {}
    for item in timeline.violations:
        total = totals.setdefault(item.rule, [0.0, 0])
        total[0] += item.active
        total[1] += 1
    lines = ['rules violated:']
    for place, (active, count) in sorted(totals.items(), key=lambda item: -item[1][0]):
        rule = rule_set.rules[place]
        time = f'{active:9.3f} s' if _unit(timeline) else f'{active:9.0f} rows'
        lines.append(f'{time}  {count:>5} x  {rule.id:<9} {rule.words(rule_set.space)}')
    return lines


def _violation_lines(timeline: Timeline, rule_set: RuleSet) -> list[str]:
    space, unit = rule_set.space, _unit(timeline)
    worst = set(sorted(timeline.violations, key=lambda item: item.margin)[:_MOST])
    count = len(timeline.violations)
    lines = [count_of(count, 'violation') + (f', the {_MOST} worst:' if count > _MOST else ':')]
    several = len(timeline.data.sources) > 1
    episodes = len(np.unique(timeline.data.episodes)) > len(timeline.data.sources)
    digits = 3 if unit else 0
    shown = [item for item in timeline.violations if item in worst]
    for item in shown:
        rule = rule_set.rules[item.rule]
        where = f'{timeline.data.sources[item.source]["name"]}  ' if several else ''
        where += f'episode {item.episode}  ' if episodes else ''
        sample = timeline.data.values[item.worst]
        values = ', '.join(
            f'{space.names[place]} {sample[place]:.4g}' for place in rule.deciding(sample)
        )
        length = f'  {item.end - item.start:.{digits}f}{unit or " rows"}'
        lines.append(
            f'  {where}{item.start:9.{digits}f} to {item.end:9.{digits}f}{unit}{length:>10}  '
            f'{rule.id:<9} {rule.words(space)}'
        )
        lines.append(
            f'      worst at {timeline.starts[item.worst]:.{digits}f}{unit}: {values}; '
            f'margin {item.margin:.4g}'
        )
    return lines


def violation_entry(item: Interval, timeline: Timeline, rule_set: RuleSet) -> dict[str, Any]:
    """Return one violation as plain values, ready for JSON."""
    rule, worst = rule_set.rules[item.rule], item.worst
    return {
        'rule': rule.id,
        'text': rule.words(rule_set.space),
        **_entry(item, timeline),
        'worst': {
            'time': float(timeline.starts[worst]),
            'stamp_ns': int(timeline.data.stamps_ns[worst]),
            'margin': item.margin,
            'values': dict(
                zip(rule_set.space.names, timeline.data.values[worst].tolist(), strict=True)
            ),
        },
    }


def _entry(item: Interval, timeline: Timeline) -> dict[str, Any]:
    stamps = timeline.data.stamps_ns
    return {
        'source': timeline.data.sources[item.source]['name'],
        'episode': item.episode,
        'start': item.start,
        'end': item.end,
        'duration': item.end - item.start,
        'active': item.active,
        'samples': len(item.samples),
        'first_stamp_ns': int(stamps[item.samples[0]]),
        'last_stamp_ns': int(stamps[item.samples[-1]]),
    }


def unusable_features(item: Interval, timeline: Timeline, rule_set: RuleSet) -> list[str]:
    """Return the features that made samples UNKNOWN."""
    values, space = timeline.data.values[item.samples], rule_set.space
    usable = np.isfinite(values) & (values >= space.lows) & (values <= space.highs)
    return [space.names[place] for place in np.flatnonzero(~usable.all(axis=0))]


def _causes(timeline: Timeline, rule_set: RuleSet) -> str:
    if rule_set.problem:
        return rule_set.problem
    verdict = timeline.judgement.verdict
    values, space = timeline.data.values[verdict == Verdict.UNKNOWN], rule_set.space
    unusable = ~(np.isfinite(values) & (values >= space.lows) & (values <= space.highs))
    counts = zip(space.names, unusable.sum(axis=0).tolist(), strict=True)
    ordered = sorted((item for item in counts if item[1]), key=lambda item: -item[1])
    return ', '.join(f'{name} unusable in {count_of(count, "sample")}' for name, count in ordered)


def _unit(timeline: Timeline) -> str:
    return ' s' if timeline.unit == 's' else ''
