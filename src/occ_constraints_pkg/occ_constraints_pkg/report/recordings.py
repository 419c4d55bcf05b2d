# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The section with judged recordings: verdicts in time, and every violation."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, Interval, Timeline
from occ_constraints_pkg.checking.timeline_text import unusable_features
from occ_constraints_pkg.report.arrays import packed
from occ_constraints_pkg.report.page import Page, Section, render
from occ_constraints_pkg.report.rows_kept import CONTEXT_SECONDS, rows_kept
from occ_constraints_pkg.report.subjects import Subjects
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.wording import count_of

MOST_BYTES = 3_200_000
"""What the rows of all recordings may take on the page."""

# Places along the band of a recording that can have a colour of their own.
CELLS = 1000


def add_recordings(
    page: Page,
    timeline: Timeline,
    rule_set: RuleSet,
    *,
    most_bytes: int = MOST_BYTES,
    bridge: float = BRIDGE_SECONDS,
) -> None:
    """Add recordings that were judged.

    What other bounds would give can be tried where :func:`add_rules` added the same rules.

    Args:
        page: where.
        timeline: the recordings, judged.
        rule_set: the rules that judged them.
        bridge: of :func:`check_data` when they were judged.
        most_bytes: about what their rows may take; violations are shown whatever they take.
    """
    subjects = Subjects(rule_set)
    # Base64 of eight bytes for each column; of the time, the margin, the episode less.
    of_row = 11 * len(subjects) + 24
    kept = rows_kept(timeline, rule_set, max(1000, most_bytes // of_row))
    sources = _sources(timeline)
    entries, documents = [], []
    for place, source in enumerate(timeline.data.sources):
        own = sources == place
        if not own.any():
            continue
        violations = sorted(
            (item for item in timeline.violations if item.source == place),
            key=lambda item: (item.start, item.episode, item.rule),
        )
        unknown = [item for item in timeline.unknown if item.source == place]
        begin, end = _span(timeline, own)
        cells = verdict_cells(timeline, own, begin, end)
        shares = _shares(timeline, own)
        entries.append(
            {
                'place': len(entries),
                'name': source['name'],
                'sha256': source.get('sha256', ''),
                'samples': int(own.sum()),
                'length': end - begin,
                'shares': shares,
                # Violations last, so that nothing covers them.
                'runs': sorted(cell_runs(cells), key=lambda run: run[0] == 'violated'),
                'violations': len(violations),
                'unknown': len(unknown),
            }
        )
        documents.append(
            {
                'name': source['name'],
                'begin': begin,
                'end': end,
                'samples': int(own.sum()),
                'rows': _rows(timeline, subjects, kept[own[kept]]),
                'violations': [_violation(item, timeline) for item in violations],
                'unknown': [
                    [
                        item.episode,
                        item.start,
                        item.end,
                        unusable_features(item, timeline, rule_set),
                    ]
                    for item in unknown
                ],
            }
        )
    body = render(
        'recordings.html.j2',
        recordings=entries,
        unit='s' if timeline.unit == 's' else 'rows',
        cells=CELLS,
        kept=len(kept),
        total=len(timeline.data),
        problem=rule_set.problem,
    )
    page.add(Section('Recordings', body, 'recordings'))
    page.data['recordings'] = documents
    page.data['unit'] = 's' if timeline.unit == 's' else 'rows'
    page.data['thinned'] = len(kept) < len(timeline.data)
    page.data['bridge'] = bridge if timeline.unit == 's' else 0.0
    page.data['context'] = CONTEXT_SECONDS if timeline.unit == 's' else 20
    page.data['cells'] = CELLS


def summarize(page: Page, timeline: Timeline) -> None:
    """Say in one sentence on top of the page what the verdicts are."""
    shares, count = timeline.shares, len(timeline.violations)
    known = [
        f'{shares[name]:.2%} {name}' for name in ('SAFE', 'VIOLATED', 'UNKNOWN') if shares[name]
    ]
    recordings = count_of(len(timeline.data.sources), 'recording')
    violations = count_of(count, 'violation') if count else 'no violation'
    page.summary = f'{recordings}, {violations}: {", ".join(known)} of the time'
    page.is_good = timeline.is_safe


def _sources(timeline: Timeline) -> np.ndarray:
    recordings = timeline.data.recordings
    return np.zeros(len(timeline.data), dtype=np.int64) if recordings is None else recordings


def _span(timeline: Timeline, own: np.ndarray) -> tuple[float, float]:
    starts = timeline.starts[own]
    ends = starts + timeline.valid_for[own] + timeline.silence[own]
    begin, end = float(starts.min()), float(ends.max())
    return begin, max(end, begin + 1e-9)


def _shares(timeline: Timeline, own: np.ndarray) -> dict[str, float]:
    weights = timeline.valid_for[own]
    if not weights.sum():
        weights = np.ones(len(weights))
    verdict, silence = timeline.judgement.verdict[own], float(timeline.silence[own].sum())
    times = {item.name: float(weights[verdict == item].sum()) for item in Verdict}
    times['UNKNOWN'] += silence
    total = sum(times.values())
    return {name: time / total for name, time in times.items()}


def verdict_cells(timeline: Timeline, own: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Return the worst verdict in each cell of the band: -1 none, else as :class:`Verdict`."""
    scale = CELLS / (end - begin)
    starts = (timeline.starts[own] - begin) * scale
    valid = timeline.valid_for[own] * scale
    verdict = timeline.judgement.verdict[own]
    cells = np.full(CELLS, -1, dtype=np.int64)
    # The worst last, so that nothing paints over a violation.
    for value in (Verdict.SAFE, Verdict.UNKNOWN, Verdict.VIOLATED):
        chosen = verdict == value
        _paint(cells, starts[chosen], starts[chosen] + valid[chosen], int(value))
        if value == Verdict.UNKNOWN:
            silent = timeline.silence[own] > 0
            first = starts[silent] + valid[silent]
            _paint(cells, first, first + timeline.silence[own][silent] * scale, int(value))
    return cells


def _paint(cells: np.ndarray, starts: np.ndarray, ends: np.ndarray, value: int) -> None:
    first = np.clip(starts.astype(np.int64), 0, CELLS - 1)
    last = np.clip(np.ceil(ends).astype(np.int64), first + 1, CELLS)
    steps = np.zeros(CELLS + 1, dtype=np.int64)
    np.add.at(steps, first, 1)
    np.add.at(steps, last, -1)
    cells[np.cumsum(steps)[:-1] > 0] = value


def cell_runs(cells: np.ndarray) -> list[tuple[str, int, int]]:
    """Return runs of equal cells: verdict in small letters, first cell, number of cells."""
    edges = np.flatnonzero(np.diff(cells)) + 1
    bounds = [0, *edges.tolist(), len(cells)]
    names = {-1: 'none', **{int(item): item.name.lower() for item in Verdict}}
    return [
        (names[int(cells[first])], first, last - first)
        for first, last in zip(bounds, bounds[1:], strict=False)
    ]


def _rows(timeline: Timeline, subjects: Subjects, rows: np.ndarray) -> dict[str, Any]:
    data = timeline.data
    return {
        'count': len(rows),
        'times': packed(timeline.starts[rows], np.float64),
        'lengths': packed(timeline.valid_for[rows], np.float32),
        'episodes': packed(data.episodes[rows], np.int32),
        'known': packed(subjects.knows(data.values[rows]), np.uint8),
        'columns': [packed(values, np.float64) for values in subjects.values(data.values[rows])],
    }


def _violation(item: Interval, timeline: Timeline) -> list[float]:
    """Return rule, episode, start, end, moment of the worst, margin."""
    worst = float(timeline.starts[item.worst])
    margin = item.margin if np.isfinite(item.margin) else 0.0
    return [item.rule, item.episode, item.start, item.end, worst, margin]
