# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From demonstrations to the safe set: box, margins, tails, conditional rules."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.learning.conditional.acceptance import MOST_OUTSIDE, Found, is_empty
from occ_constraints_pkg.learning.conditional.bounds import (
    demonstrated_ranges,
    fit_box,
    inside_box,
)
from occ_constraints_pkg.learning.conditional.corners import LOOKS, CornerSearch
from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull
from occ_constraints_pkg.learning.conditional.evidence import most_evidence, needed_evidence
from occ_constraints_pkg.learning.conditional.expectation import Expectation
from occ_constraints_pkg.learning.conditional.gaps import close_on, find_gaps
from occ_constraints_pkg.learning.conditional.placing import place
from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, Feature, LearnedRules
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.settings import ConditionalSettings
from occ_constraints_pkg.learning.conditional.table import Table
from occ_constraints_pkg.learning.conditional.triples import find_triples
from occ_constraints_pkg.learning.conditional.units import (
    families_of,
    make_units,
    pairs_of,
)
from occ_constraints_pkg.learning.samples import checked_samples


def learn_conditional(
    values: np.ndarray,
    episodes: np.ndarray,
    features: Sequence[Feature],
    settings: ConditionalSettings | None = None,
    *,
    bounds: np.ndarray,
    recordings: np.ndarray | None = None,
    cuts_stay: bool = False,
) -> LearnedRules:
    """Learn the safe set of demonstrations.

    Args:
        values: (n, k) finite samples within their physical bounds, those of an episode in the
            order of time.
        episodes: (n,) the episode of each.
        features: k descriptions.
        settings: ``None`` for the defaults.
        bounds: (k, 2) the box that a learner of boxes found: smallest and largest safe value of
            each feature. They are moved, see
            :func:`~occ_constraints_pkg.learning.conditional.bounds.fit_box`.
        recordings: (n,) the recording of each sample, where several episodes share one: what
            happens in one recording proves things only once. ``None``: episodes are independent.
        cuts_stay: whether bounds within what was demonstrated stay where they are, because it is
            known that some of the samples are bad.

    Raises:
        DataError: shapes do not fit, or a value is not finite.
        ConfigurationError: ``apart`` has an unknown name.
    """
    settings = settings if settings is not None else ConditionalSettings()
    values, episodes = _checked(values, episodes, features, bounds, recordings)
    units = make_units(values, features)
    table = Table(values, units, _by_episode(episodes), episodes)
    limits = np.array([(feature.low, feature.high) for feature in features])
    groups = [*families_of(features).values(), *((one,) for one in range(len(features)))]
    demonstrated = demonstrated_ranges(values, groups)
    box, is_bad = fit_box(
        table, bounds, demonstrated, limits, settings.outside, cuts_stay=cuts_stay
    )
    rules: tuple[ConditionalRule, ...] = ()
    if units:
        kept = inside_box(values, box, demonstrated)[table.order]
        table = Table(values, units, table.order[kept], episodes)
        if not is_bad[kept].all():
            clusters = episodes if recordings is None else np.asarray(recordings)
            rules = _conditional_rules(table, is_bad[kept], clusters, features, settings)
    steps = {
        unit.columns[0]: float(np.diff(unit.kinds).min())
        for unit in units
        if unit.kinds is not None
    }
    return LearnedRules(box, demonstrated, rules, steps)


def _checked(
    values: np.ndarray,
    episodes: np.ndarray,
    features: Sequence[Feature],
    bounds: np.ndarray,
    recordings: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    rows = checked_samples(values)
    if rows.shape[1] != len(features):
        raise DataError(f'samples have shape {rows.shape}; allowed is (n, {len(features)})')
    for name, labels in (('episodes', episodes), ('recordings', recordings)):
        if labels is not None and np.shape(labels) != (len(rows),):
            raise DataError(f'{name} have shape {np.shape(labels)}; allowed is ({len(rows)},)')
    if np.shape(bounds) != (len(features), 2):
        raise DataError(f'bounds have shape {np.shape(bounds)}; allowed is ({len(features)}, 2)')
    return rows, np.asarray(episodes)


def _by_episode(episodes: np.ndarray) -> np.ndarray:
    """Return the positions of the rows, episode after episode."""
    # Whole episodes one after the other are in order already, whatever they are called.
    changes = np.count_nonzero(episodes[1:] != episodes[:-1])
    if len(np.unique(episodes)) == changes + 1:
        return np.arange(len(episodes))
    return np.argsort(episodes, kind='stable')


def _conditional_rules(
    table: Table,
    is_bad: np.ndarray,
    clusters: np.ndarray,
    features: Sequence[Feature],
    settings: ConditionalSettings,
) -> tuple[ConditionalRule, ...]:
    units = table.units
    pairs = pairs_of(units, features, settings.apart)
    sample = table.sample(is_bad, clusters)
    if most_evidence(sample.cluster_count) < needed_evidence(LOOKS, settings.delta):
        # So few can prove nothing.
        return ()
    found = find_gaps(sample, delta=settings.delta)[: settings.most_rules]
    if pairs:
        found = _combined(sample, pairs, found, settings)
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


def _combined(
    sample: Sample,
    pairs: Sequence[tuple[int, int]],
    found: Sequence[Found],
    settings: ConditionalSettings,
) -> list[Found]:
    """Return the rules that there are, and then those about pairs and triples of units."""
    expectation, correlation = Expectation(sample), CorrelationNull(sample)
    search = CornerSearch(
        sample,
        expectation,
        correlation,
        pairs,
        found,
        delta=settings.delta,
        most_rules=settings.most_rules,
    )
    pairwise = search.run()
    if settings.conditions != 'triples':
        return pairwise
    return find_triples(
        sample,
        expectation,
        correlation,
        pairs,
        pairwise,
        looks_at_pairs=search.looks,
        delta=settings.delta,
        most_rules=settings.most_rules,
    )


def _settled(
    table: Table, is_bad: np.ndarray, sample: Sample, found: Sequence[Found]
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
            cuts = place(sample, rows, free, cuts, rule.evidence / rule.strip)
        inside = rows.inside(cuts)
        seen = float((inside & free).mean())
        candidate = Found(cuts, rule.expected, seen, rule.evidence, rule.strip)
        total = seen + sum(one.seen for one in settled)
        if total <= MOST_OUTSIDE and is_empty(sample, rows, candidate):
            settled.append(candidate)
            free &= ~inside
    return settled
