# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From demonstrations to the safe set: box, margins, tails, conditional rules."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.conditional.acceptance import MOST_OUTSIDE, Found, is_empty
from occ_constraints_pkg.learning.conditional.corners import CornerSearch
from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull
from occ_constraints_pkg.learning.conditional.expectation import Expectation
from occ_constraints_pkg.learning.conditional.gaps import close_on, find_gaps
from occ_constraints_pkg.learning.conditional.margins import outward_margins
from occ_constraints_pkg.learning.conditional.placing import place
from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, Feature, LearnedRules
from occ_constraints_pkg.learning.conditional.sample import MOST_ROWS, Rows, Sample
from occ_constraints_pkg.learning.conditional.settings import ConditionalSettings
from occ_constraints_pkg.learning.conditional.tails import find_glitches, flat_tails
from occ_constraints_pkg.learning.conditional.triples import find_triples
from occ_constraints_pkg.learning.conditional.units import (
    BELOW,
    Unit,
    families_of,
    make_units,
    pairs_of,
)


def learn_conditional(
    values: np.ndarray,
    episodes: np.ndarray,
    features: Sequence[Feature],
    settings: ConditionalSettings | None = None,
    *,
    bounds: np.ndarray,
    recordings: np.ndarray | None = None,
) -> LearnedRules:
    """Learn the safe set of demonstrations.

    Args:
        values: (n, k) finite samples within their physical bounds, those of an episode in the
            order of time.
        episodes: (n,) the episode of each.
        features: k descriptions.
        settings: ``None`` for the defaults.
        bounds: (k, 2) the box that a learner of boxes found: smallest and largest safe value of
            each feature. Bounds at the demonstrated minimum and maximum move outward; the others
            stay.
        recordings: (n,) the recording of each sample, where several episodes share one: what
            happens in one recording proves things only once. ``None``: episodes are independent.

    Raises:
        OccError: shapes do not fit, a value is not finite, or a name is unknown.
    """
    settings = settings if settings is not None else ConditionalSettings()
    values, episodes = _checked(values, episodes, features, bounds, recordings)
    families = families_of(features)
    demonstrated = demonstrated_ranges(values, list(families.values()))
    box = np.array(bounds, dtype=np.float64)
    units = make_units(values, features)
    clusters = episodes if recordings is None else np.asarray(recordings)
    table = _Table(
        values, units, _by_episode(episodes, _inside(values, box, demonstrated)), episodes
    )
    if settings.outside is not None:
        _move_outward(box, demonstrated, values, episodes, features, units, settings.outside)
    is_bad = _screen(box, table)
    rules: tuple[ConditionalRule, ...] = ()
    if settings.conditions != 'none' and units and len(table):
        kept = _inside(values, box, demonstrated)[table.order]
        table = _Table(values, units, table.order[kept], episodes)
        rules = _conditional_rules(table, is_bad[kept], clusters, features, settings)
    return LearnedRules(box, demonstrated, rules)


def demonstrated_ranges(values: np.ndarray, families: Sequence[Sequence[int]]) -> np.ndarray:
    """Return the (k, 2) smallest and largest values; members of a family share them."""
    ranges = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    for family in map(list, families):
        ranges[family] = ranges[family, 0].min(), ranges[family, 1].max()
    return ranges


class _Table:
    """Rows in the order of time; columns are copied when they are asked for.

    Attributes:
        units: what the rows have values of.
        order: (n,) positions of the rows among the samples.
        goes_on: (n,) bool, whether the next row is the next one of the same episode.
    """

    def __init__(
        self,
        values: np.ndarray,
        units: Sequence[Unit],
        order: np.ndarray,
        episodes: np.ndarray,
    ) -> None:
        self.units = units
        self.order = order
        labels = episodes[order]
        self.goes_on = np.append(labels[1:] == labels[:-1], False)[: len(order)]
        self._values = values

    def __len__(self) -> int:
        return len(self.order)

    def column(self, unit: int) -> np.ndarray:
        return self.units[unit].of(self._values)[self.order]

    def rows(self, needed: set[int]) -> Rows:
        """Return all rows, with the values of some units."""
        empty = np.empty(0)
        columns = [
            self.column(unit) if unit in needed else empty for unit in range(len(self.units))
        ]
        following = [column[1:] for column in columns]
        return Rows(self.units, columns, following, self.goes_on)

    def sample(self, is_bad: np.ndarray, clusters: np.ndarray) -> Sample:
        """Return some of the rows that are not bad, evenly chosen."""
        good = np.flatnonzero(~is_bad)
        chosen = good[:: max(1, -(-len(good) // MOST_ROWS))]
        later = np.minimum(chosen + 1, len(self) - 1)
        columns, following = (
            [unit.of(self._values[self.order[rows]]) for unit in self.units]
            for rows in (chosen, later)
        )
        labels = clusters[self.order[chosen]]
        return Sample(self.units, columns, following, self.goes_on[chosen], labels)


def _checked(
    values: np.ndarray,
    episodes: np.ndarray,
    features: Sequence[Feature],
    bounds: np.ndarray,
    recordings: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(features) or not rows.size:
        raise OccError(
            f'samples have shape {rows.shape}; allowed is (n, {len(features)}), n of 1 or more'
        )
    for name, labels in (('episodes', episodes), ('recordings', recordings)):
        if labels is not None and np.shape(labels) != (len(rows),):
            raise OccError(f'{name} have shape {np.shape(labels)}; allowed is ({len(rows)},)')
    if np.shape(bounds) != (len(features), 2):
        raise OccError(f'bounds have shape {np.shape(bounds)}; allowed is ({len(features)}, 2)')
    with np.errstate(over='ignore', invalid='ignore'):
        glance = rows.sum()
    if not np.isfinite(glance) and not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        raise OccError(
            f'sample {row} of {features[column].name!r} is {rows[row, column]}; allowed is a '
            'finite number'
        )
    return rows, np.asarray(episodes)


def _by_episode(episodes: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return the positions of the rows inside, episode after episode."""
    rows = np.flatnonzero(inside)
    labels = episodes[rows]
    # Whole episodes one after the other are in order already, whatever they are called.
    changes = np.flatnonzero(labels[1:] != labels[:-1])
    if len(np.unique(labels)) == len(changes) + 1 or not len(rows):
        return rows
    return rows[np.argsort(labels, kind='stable')]


def _inside(values: np.ndarray, box: np.ndarray, demonstrated: np.ndarray) -> np.ndarray:
    """Tell for each of (n, k) samples whether it is in a box: (n,) bool.

    Args:
        values: the samples.
        box: (k, 2) bounds.
        demonstrated: (k, 2) ranges; a feature whose bounds lie beyond has nothing outside.
    """
    inside = np.ones(len(values), dtype=bool)
    beyond = (box[:, 0] <= demonstrated[:, 0]) & (box[:, 1] >= demonstrated[:, 1])
    for column in np.flatnonzero(~beyond):
        low, high = box[column]
        inside &= (values[:, column] >= low) & (values[:, column] <= high)
    return inside


def _move_outward(
    box: np.ndarray,
    demonstrated: np.ndarray,
    values: np.ndarray,
    episodes: np.ndarray,
    features: Sequence[Feature],
    units: Sequence[Unit],
    outside: float,
) -> None:
    """Move bounds at the demonstrated minimum and maximum outward; changes ``box``."""
    discrete = [unit.columns[0] for unit in units if unit.is_discrete]
    together = list(families_of(features).values())
    margins = outward_margins(values, episodes, together, outside, discrete)
    lows = np.array([feature.low for feature in features])
    highs = np.array([feature.high for feature in features])
    at_low, at_high = box[:, 0] == demonstrated[:, 0], box[:, 1] == demonstrated[:, 1]
    box[at_low, 0] = np.maximum(box[:, 0] - margins[:, 0], lows)[at_low]
    box[at_high, 1] = np.minimum(box[:, 1] + margins[:, 1], highs)[at_high]


def _screen(box: np.ndarray, table: _Table) -> np.ndarray:
    """Move bounds inward where a tail is made of bad samples; changes ``box``.

    Returns:
        (n,) bool, the rows that are glitches in several features at once. One bad row puts all of
        its features anywhere, so they seem to hang together.
    """
    glitches = np.zeros(len(table), dtype=np.int64)
    for number, unit in enumerate(table.units):
        if unit.is_discrete or not len(table):
            continue
        column = table.column(number)
        found = find_glitches(column, table.goes_on)
        if not unit.is_family:
            glitches += found
        for cut in flat_tails(number, unit, column, found):
            columns, end = list(unit.columns), 0 if cut.side == BELOW else 1
            tighter = np.maximum if end == 0 else np.minimum
            box[columns, end] = tighter(box[columns, end], cut.bound)
    return glitches > 1


def _conditional_rules(
    table: _Table,
    is_bad: np.ndarray,
    clusters: np.ndarray,
    features: Sequence[Feature],
    settings: ConditionalSettings,
) -> tuple[ConditionalRule, ...]:
    if is_bad.all():
        return ()
    sample = table.sample(is_bad, clusters)
    units = table.units
    pairs = pairs_of(units, features, settings.apart)
    expectation, correlation = Expectation(sample), CorrelationNull(sample)
    found = find_gaps(sample, delta=settings.delta)[: settings.most_rules]
    search = CornerSearch(
        sample,
        expectation,
        correlation,
        pairs,
        found,
        delta=settings.delta,
        most_rules=settings.most_rules,
    )
    found = search.run()
    if settings.conditions == 'triples':
        found = find_triples(
            sample,
            expectation,
            correlation,
            pairs,
            found,
            looks_at_pairs=search.looks,
            delta=settings.delta,
            most_rules=settings.most_rules,
        )
    return tuple(
        ConditionalRule(
            tuple(
                literal
                for cut in rule.cuts
                for literal in units[cut.unit].literals(cut.side, cut.bound)
            ),
            rule.expected,
            rule.seen,
            rule.evidence,
        )
        for rule in _settled(table, is_bad, sample, found)
    )


def _settled(
    table: _Table, is_bad: np.ndarray, sample: Sample, found: Sequence[Found]
) -> list[Found]:
    """Return the rules with their bounds placed on all rows; those go that do not hold there."""
    settled: list[Found] = []
    free = ~is_bad
    for rule in found:
        rows = table.rows({cut.unit for cut in rule.cuts})
        if rule.is_gap:
            closed = close_on(rule, rows)
            if closed is not None:
                settled.append(closed)
            continue
        cuts = rule.cuts
        if len(rows) > len(sample):
            cuts = place(sample, rows, free, cuts, rule.evidence, rule.strip)
        inside = rows.inside(cuts)
        seen = float((inside & free).mean())
        candidate = Found(cuts, rule.expected, seen, rule.evidence, rule.strip)
        total = seen + sum(one.seen for one in settled)
        if total <= MOST_OUTSIDE and is_empty(sample, rows, candidate):
            settled.append(candidate)
            free &= ~inside
    return settled
