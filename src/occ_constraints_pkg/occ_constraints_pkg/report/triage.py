# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of a triage: what stands out with its feature against the bound, then all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.checking.triage import Excerpt, Ranked, Triage
from occ_constraints_pkg.checking.triage_text import Way, key_of, reason, time_unit
from occ_constraints_pkg.report.page import (
    Page,
    Section,
    facts_section,
    render,
    table_section,
    write_page,
)
from occ_constraints_pkg.wording import count_of

# Size of a chart, and the room for its labels, in units of its view box.
_WIDTH, _HEIGHT, _LEFT, _EDGE = 640.0, 190.0, 64.0, 24.0
# Stretches that are listed of one recording, and points of a chart on each side of the worst.
_MOST_EVENTS, _MOST_POINTS = 10, 400


def triage_page(title: str, result: Triage, ways: Mapping[str, Way]) -> Page:
    """Return the page of a triage.

    Args:
        title: of the page.
        result: the ranking.
        ways: clips and links, see :func:`~occ_constraints_pkg.checking.triage_text.key_of`.
    """
    found = result.found
    page = Page(title)
    page.summary = (
        f'{len(found)} of {count_of(len(result.ranked), "recording")} stand out from what the '
        'others do'
    )
    if result.unreadable:
        page.summary += f'; {len(result.unreadable)} cannot be used'
    page.is_good = not found and not result.unreadable
    unit = time_unit(result)
    if found:
        entries = [_entry(item, ways.get(key_of(item), Way()), result) for item in found]
        body = render('triage.html.j2', entries=entries, unit=unit)
        page.add(Section('What stands out', body, 'found'))
    if result.unreadable:
        page.add(
            table_section(
                'Cannot be used',
                ['recording', 'path', 'why'],
                result.unreadable,
                id='unreadable',
            )
        )
    page.add(
        table_section(
            'All recordings',
            ['#', 'recording', 'score', 'far', f'violated [{unit}]', f'UNKNOWN [{unit}]', 'worst'],
            [
                [
                    rank,
                    item.name,
                    f'{item.score:.3g}',
                    f'{item.far:.3g}',
                    f'{item.violated:.2f}',
                    f'{item.unknown:.2f}',
                    reason(item, result),
                ]
                for rank, item in enumerate(result.ranked, start=1)
            ],
            id='all',
            intro='Far: by how much a rule is violated, in parts of the distance that a typical '
            'recording keeps from the bound. Score: far, plus that excess times how long it lasts, '
            'plus unusual UNKNOWN time.',
            numbers=(0, 2, 3, 4, 5),
        )
    )
    page.add(
        table_section(
            'Rules',
            ['a violation is'],
            [[words] for words in result.rules],
            id='rules-learned',
            intro=f'As learned from {count_of(result.learned_from, "recording")}: all but the '
            'most suspicious. Each of these is judged by rules from others of them, whose bounds '
            'may differ a little.',
        )
    )
    page.add(
        facts_section(
            'How it was judged',
            {
                'recordings': len(result.ranked),
                'learned from': result.learned_from,
                'score from which on a recording stands out': f'{result.above:g}',
            },
            id='settings',
        )
    )
    return page


def write_triage_page(
    path: str | Path, title: str, result: Triage, ways: Mapping[str, Way]
) -> None:
    """Write :func:`triage_page` to a file.

    Raises:
        OccError: it cannot be written.
    """
    write_page(triage_page(title, result, ways), path)


def _entry(item: Ranked, way: Way, result: Triage) -> dict[str, Any]:
    return {
        'item': item,
        'way': way,
        'reason': reason(item, result),
        'events': item.events[:_MOST_EVENTS],
        'more': max(0, len(item.events) - _MOST_EVENTS),
        'chart': item.excerpt and _chart(item.excerpt, item.moment or 0.0, time_unit(result)),
    }


def _chart(excerpt: Excerpt, moment: float, unit: str) -> dict[str, Any]:
    """Return where things are in a chart of a feature against its bound."""
    kept = _around(excerpt.times, moment)
    times, values = excerpt.times[kept], excerpt.values[kept]
    finite = values[np.isfinite(values)]
    least, most = float(finite.min()), float(finite.max())
    low, high = min(least, excerpt.bound), max(most, excerpt.bound)
    room = 0.08 * (high - low) or 1.0
    low, high = float(low - room), float(high + room)
    begin, end = float(times[0]), float(max(times[-1], times[0] + 1e-9))

    def x(time: Any) -> Any:
        return _LEFT + (time - begin) / (end - begin) * (_WIDTH - _LEFT - 10.0)

    def y(value: Any) -> Any:
        return _EDGE + (high - value) / (high - low) * (_HEIGHT - 2 * _EDGE)

    suffix = '' if excerpt.unit == '1' else f' {excerpt.unit}'
    worst = int(np.abs(times - moment).argmin())
    return {
        'name': excerpt.name + (f' [{excerpt.unit}]' if suffix else ''),
        'width': _WIDTH,
        'height': _HEIGHT,
        'left': _LEFT,
        'edge': _EDGE,
        'traces': _traces(x(times), y(values)),
        'limit': y(excerpt.bound),
        'limit_words': f'bound {excerpt.bound:.4g}{suffix}',
        'worst': (x(times[worst]), y(values[worst])),
        'worst_words': f'{values[worst]:.4g}{suffix} at {moment:.2f} {unit}',
        'ends': (f'{begin:.1f} {unit}', f'{end:.1f} {unit}'),
        'scale': ((f'{most:.3g}', y(most)), (f'{least:.3g}', y(least))),
    }


def _around(times: np.ndarray, moment: float) -> np.ndarray:
    """Return the rows of a chart: all, or of too many an even choice with the worst among them."""
    if len(times) <= 2 * _MOST_POINTS:
        return np.arange(len(times))
    chosen = np.linspace(0, len(times) - 1, 2 * _MOST_POINTS).astype(int)
    return np.unique(np.append(chosen, np.abs(times - moment).argmin()))


def _traces(xs: np.ndarray, ys: np.ndarray) -> Sequence[str]:
    """Return the points of each run of finite values."""
    runs: list[list[str]] = [[]]
    for x, y in zip(xs.tolist(), ys.tolist(), strict=True):
        if np.isfinite(y):
            runs[-1].append(f'{x:.1f},{y:.1f}')
        elif runs[-1]:
            runs.append([])
    return [' '.join(run) for run in runs if run]
