# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: each recording before and after on one clock, and what changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.checking.comparison import Comparison, RecordingComparison, Side
from occ_constraints_pkg.checking.comparison_text import (
    amount_words,
    findings,
    headline,
    place,
    rule_words,
    worst,
)
from occ_constraints_pkg.report.page import (
    Page,
    Section,
    facts_section,
    render,
    table_section,
    write_page,
)
from occ_constraints_pkg.report.recordings import CELLS, cell_runs, verdict_cells
from occ_constraints_pkg.wording import count_of

# Changes of one recording that are listed, those that are worse first.
_MOST = 200


def comparison_page(title: str, comparison: Comparison) -> Page:
    """Return the page of a comparison.

    Args:
        title: of the page.
        comparison: what is shown.
    """
    page = Page(title)
    page.summary = headline(comparison)
    page.is_good = not comparison.is_worse
    unit = 's' if comparison.before.timeline.unit == 's' else 'rows'
    entries = [_entry(number, comparison) for number in range(len(comparison.recordings))]
    changed = [entry for entry in entries if entry['findings'] or entry['changes']]
    changed.sort(key=lambda entry: not entry['is_worse'])
    if changed:
        body = render('comparison.html.j2', entries=changed, unit=unit, cells=CELLS)
        page.add(Section('What changed', body, 'changed'))
    page.add(
        table_section(
            'All recordings',
            ['recording', 'verdict', f'VIOLATED [{unit}]', f'UNKNOWN [{unit}]', f'length [{unit}]'],
            [_row(item) for item in comparison.recordings],
            id='all',
            intro='Before and after.',
            numbers=(2, 3, 4),
        )
    )
    facts: dict[str, Any] = {
        'before': comparison.before.name,
        'after': comparison.after.name,
        'tolerance': f'{comparison.tolerance:g} {unit}',
    }
    for words, side in (('before', comparison.before), ('after', comparison.after)):
        count = count_of(len(side.rule_set.order), 'rule')
        facts[f'rules {words}'] = f'{count}, formula {side.rule_set.fingerprint}'
    page.add(facts_section('How it was compared', facts, id='settings'))
    return page


def write_comparison_page(path: str | Path, title: str, comparison: Comparison) -> None:
    """Write :func:`comparison_page` to a file.

    Raises:
        OccError: it cannot be written.
    """
    write_page(comparison_page(title, comparison), path)


def _entry(number: int, comparison: Comparison) -> dict[str, Any]:
    item = comparison.recordings[number]
    changes = [change for change in item.changes if change.is_worse or change.kind != 'same']
    changes.sort(key=lambda change: not change.is_worse)
    rows = []
    for change in changes[:_MOST]:
        episode, start, end = place(change, comparison)
        rows.append(
            {
                'kind': change.kind,
                'is_worse': change.is_worse,
                'episode': episode.strip(),
                'start': start,
                'end': end,
                'rule': rule_words(change, comparison),
                'amount': amount_words(change, comparison),
                'worst': worst(change, comparison),
            }
        )
    return {
        'name': item.name,
        'is_worse': item.is_worse,
        'findings': findings(item, comparison),
        'changes': rows,
        'more': max(0, len(changes) - _MOST),
        'lanes': _lanes(item, comparison),
    }


def _lanes(item: RecordingComparison, comparison: Comparison) -> dict[str, Any] | None:
    """Return the verdicts of both sides in cells of one clock; of several episodes, none."""
    sides = [(comparison.before, item.before_source), (comparison.after, item.after_source)]
    rows = [None if source is None else _rows(side, source) for side, source in sides]
    spans = []
    for own, (side, _), shift in zip(rows, sides, (0.0, item.shift), strict=True):
        if own is not None:
            line = side.timeline
            if len(np.unique(line.data.episodes[own])) > 1:
                return None
            ends = line.starts[own] + line.valid_for[own] + line.silence[own]
            spans.append((float(line.starts[own].min()) + shift, float(ends.max()) + shift))
    begin, end = min(low for low, _ in spans), max(high for _, high in spans)
    end = max(end, begin + 1e-9)
    lanes = []
    for name, own, (side, _), shift in zip(
        ('before', 'after'), rows, sides, (0.0, item.shift), strict=True
    ):
        runs = (
            []
            if own is None
            else cell_runs(verdict_cells(side.timeline, own, begin - shift, end - shift))
        )
        lanes.append({'name': name, 'runs': runs})
    return {'begin': begin, 'end': end, 'lanes': lanes}


def _rows(side: Side, source: int) -> np.ndarray:
    recordings = side.timeline.data.recordings
    count = len(side.timeline.data)
    return np.ones(count, dtype=bool) if recordings is None else recordings == source


def _row(item: RecordingComparison) -> list[str]:
    def both(name: str) -> str:
        times = (item.before, item.after)
        return ' → '.join('-' if one is None else f'{getattr(one, name):.2f}' for one in times)

    verdict = 'worse' if item.is_worse else 'not worse'
    return [item.name, verdict, both('violated'), both('unknown'), both('total')]
