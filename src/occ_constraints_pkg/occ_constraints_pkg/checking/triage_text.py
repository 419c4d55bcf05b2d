# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which recordings to look at, as text and as plain values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from occ_constraints_pkg.checking.triage import Ranked, Triage
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of


@dataclass(frozen=True)
class Way:
    """How to look at a recording's worst moment.

    Attributes:
        clip: path of the clip; empty for none.
        link: opens Foxglove at the moment; empty for none.
    """

    clip: str = ''
    link: str = ''


def describe_triage(result: Triage, ways: Mapping[str, Way], top: int) -> str:
    """Return the ranking: those that stand out, and others up to a number.

    Args:
        result: the ranking.
        ways: by path and name, see :func:`key_of`.
        top: at least so many are listed.
    """
    others = len(result.ranked) - result.learned_from
    but = f', but for the {f"{others} " if others > 1 else ""}most suspicious' if others else ''
    lines = [
        f'{count_of(len(result.ranked), "recording")}, each judged by rules learned from the '
        f'others{but}; {len(result.found)} {"stands" if len(result.found) == 1 else "stand"} out '
        f'(score {result.above:g} or more)',
        '   #      score        far   violated    UNKNOWN  recording',
    ]
    shown = max(top, len(result.found))
    for rank, item in enumerate(result.ranked[:shown], start=1):
        if item.score > 0:
            lines += _lines(rank, item, ways.get(key_of(item), Way()), result)
    rest = sum(1 for item in result.ranked[:shown] if item.score <= 0) + len(result.ranked[shown:])
    if rest:
        lines.append(f'{count_of(rest, "recording")} with lower scores')
    lines += [f'cannot be used: {name}: {sentence}' for name, _, sentence in result.unreadable]
    return '\n'.join(map(printable, lines))


def _lines(rank: int, item: Ranked, way: Way, result: Triage) -> Iterator[str]:
    unit = time_unit(result)
    yield (
        f'{rank:4} {item.score:10.3g} {item.far:10.3g} {item.violated:8.2f} {unit:<2}'
        f'{item.unknown:8.2f} {unit:<2} {item.name}'
    )
    yield f'       {reason(item, result)}'
    for told in (way.clip, way.link):
        if told:
            yield f'       {told}'


def reason(item: Ranked, result: Triage) -> str:
    """Return the rule that a recording leaves, and when; or that it cannot be judged."""
    if item.moment is None:
        return 'nothing that a rule flags'
    time = f'{item.moment:.3f} s' if result.unit == 's' else f'row {item.moment:.0f}'
    if item.rule is None:
        return f'at {time}: UNKNOWN'
    values = ', '.join(f'{name} {value:.4g}' for name, value in item.values.items())
    return f'at {time}: {item.rule_words}; {values}'


def key_of(item: Ranked) -> str:
    """Return what tells a recording from all others."""
    return f'{item.path}\n{item.name}'


def time_unit(result: Triage) -> str:
    """Return the unit of times."""
    return 's' if result.unit == 's' else 'rows'


def triage_document(result: Triage, ways: Mapping[str, Way]) -> dict[str, Any]:
    """Return the ranking as plain values, ready for JSON."""
    return {
        'unit': result.unit,
        'above': result.above,
        'learned_from': result.learned_from,
        'rules': list(result.rules),
        'recordings': [
            {
                'rank': rank,
                'name': item.name,
                'path': item.path,
                'score': item.score,
                'stands_out': item.stands_out,
                'learned_from': not item.is_suspect,
                'far': item.far,
                'violated': item.violated,
                'unknown': item.unknown,
                'duration': item.duration,
                'rule': item.rule_words or None,
                'moment': item.moment,
                'log_time_ns': item.log_time_ns,
                'values': item.values,
                'events': [
                    {'start': event.start, 'end': event.end, 'what': event.words}
                    for event in item.events
                ],
                'clip': ways.get(key_of(item), Way()).clip or None,
                'link': ways.get(key_of(item), Way()).link or None,
            }
            for rank, item in enumerate(result.ranked, start=1)
        ],
        'unreadable': [
            {'name': name, 'path': path, 'why': sentence}
            for name, path, sentence in result.unreadable
        ],
    }
