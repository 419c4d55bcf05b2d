# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which rows of judged recordings go on a page: all would make it too large."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from occ_constraints_pkg.checking.timeline import Interval, Timeline
from occ_constraints_pkg.rules.ruleset import RuleSet

CONTEXT_SECONDS = 3.0
"""What is shown before and after a violation."""

# Rows of one violation, and of its surroundings on each side, at most.
_WITHIN, _AROUND = 16, 12
# Rules whose closest row is kept in each stretch of a recording; of more, the closest of all.
_MOST_RULES = 24


def rows_kept(timeline: Timeline, rule_set: RuleSet, most: int) -> np.ndarray:
    """Return the rows to show, ascending.

    Of each violation, however many there are, the first, the worst and the last row; if there is
    room, more of it and of what is around it. The rest of the room is shared by stretches of the
    recordings; of each, the first row is kept, and for each rule the one that comes closest to
    making it true: where a bound moved inward would be crossed at all, it is crossed there.

    Args:
        timeline: the recordings, judged.
        rule_set: the rules that judged them.
        most: rows; exceeded only if violations alone need more.
    """
    total = len(timeline.data)
    if total <= most:
        return np.arange(total)
    essential = _union(_ends(item) for item in timeline.violations + timeline.unknown)
    room = max(0, most - len(essential))
    around = _thinned(_union(_surroundings(timeline)), room // 2)
    stretches = _thinned(_stretches(timeline, rule_set, room - len(around)), room)
    return np.unique(np.concatenate([essential, around, stretches]))


def _union(parts: Iterable[np.ndarray]) -> np.ndarray:
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *parts]))


def _thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """Return at most so many of the rows, evenly."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)] if most else rows[:0]


def _ends(item: Interval) -> np.ndarray:
    return np.array([item.samples[0], item.worst, item.samples[-1]])


def _surroundings(timeline: Timeline) -> Iterable[np.ndarray]:
    """Yield rows of each violation and of what is around it in its episode."""
    data, starts = timeline.data, timeline.starts
    order = np.lexsort((starts, data.episodes))
    episodes, times = data.episodes[order], starts[order]
    for item in timeline.violations:
        first, last = np.searchsorted(episodes, [item.episode, item.episode + 1])
        own = times[first:last]
        edges = [item.start - CONTEXT_SECONDS, item.start, item.end, item.end + CONTEXT_SECONDS]
        a, b, c, d = first + np.searchsorted(own, edges)
        yield _thinned(order[a:b], _AROUND)
        yield _thinned(item.samples, _WITHIN)
        yield _thinned(order[c:d], _AROUND)


def _stretches(timeline: Timeline, rule_set: RuleSet, most: int) -> np.ndarray:
    """Return the first row of each stretch, and those closest to a violation."""
    data = timeline.data
    rules = [rule_set.rules[place] for place in rule_set.order]
    measures = min(len(rules), _MOST_RULES) if len(rules) <= _MOST_RULES else 1
    count = most // (measures + 1)
    total = len(data)
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    firsts = np.unique(np.linspace(0, total, count, endpoint=False).astype(np.int64))
    found = [firsts]
    if len(rules) <= _MOST_RULES:
        closeness = (rule.margins(data.values, rule_set.scale) for rule in rules)
    else:
        closeness = iter([timeline.judgement.margin])
    for margins in closeness:
        # What cannot be judged is in no hurry.
        margins = np.where(np.isnan(margins), np.inf, margins)
        smallest = np.minimum.reduceat(margins, firsts)
        stretch = np.searchsorted(firsts, np.arange(total), side='right') - 1
        at = np.flatnonzero(margins == smallest[stretch])
        _, places = np.unique(stretch[at], return_index=True)
        found.append(at[places])
    return _union(found)
