# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Gaps: a range of one feature that nobody was ever in, with many on either side of it."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.learning.conditional.acceptance import Found
from occ_constraints_pkg.learning.conditional.evidence import needed_evidence, visit_evidence
from occ_constraints_pkg.learning.conditional.sample import Rows, Sample
from occ_constraints_pkg.learning.conditional.units import ABOVE, BELOW, Cut

_CELLS = 64
# Ranges of one feature that are as good as independent.
_LOOKS = 256.0
# Share of the time on either side, within the gap's own width.
_LEAST = 0.05
# A value that is taken more often than this is a sentinel, such as 500 for "none in sight".
_SENTINEL = 0.01
_LEAST_ORDINARY = 0.2
# Share of the rows, of what is expected, that a gap may hold while it is looked for.
_STRAYS = 0.001
_TAIL = 0.005
_STRIP = 1.0


def find_gaps(sample: Sample, *, delta: float) -> list[Found]:
    """Return a rule for the widest gap of each continuous feature, if the evidence is there.

    Args:
        sample: the rows.
        delta: chance that there is any false rule.
    """
    needed = needed_evidence(len(sample.units) * _LOOKS, delta)
    found = []
    for number, unit in enumerate(sample.units):
        if not (unit.is_discrete or unit.is_family):
            gap = _widest_gap(sample, number, needed)
            if gap is not None:
                found.append(gap)
    return found


def close_on(found: Found, rows: Rows) -> Found | None:
    """Return a gap with its bounds at the nearest of some rows, or ``None`` if one is within.

    Args:
        found: the gap.
        rows: on which nobody may be in it.
    """
    lower, upper = found.cuts
    values = rows.columns[lower.unit]
    if rows.inside(found.cuts).any():
        return None
    low, high = values[values <= lower.bound].max(), values[values >= upper.bound].min()
    pad = min(0.5, found.strip / found.evidence) * (high - low) / 2
    cuts = (
        lower._replace(bound=float(low + pad)),
        upper._replace(bound=float(high - pad)),
    )
    return Found(cuts, found.expected, 0.0, found.evidence, found.strip)


def _widest_gap(sample: Sample, unit: int, needed: float) -> Found | None:
    column = sample.columns[unit]
    kinds, counts = np.unique(column, return_counts=True)
    ordinary = ~np.isin(column, kinds[counts > _SENTINEL * len(sample)])
    if ordinary.mean() < _LEAST_ORDINARY:
        return None
    low, high = np.quantile(column[ordinary], [_TAIL, 1 - _TAIL]).tolist()
    edges = np.linspace(low, high, _CELLS + 1)
    if not edges[0] < edges[-1]:
        return None
    below = np.concatenate(([0], np.cumsum(np.histogram(column[ordinary], edges)[0])))
    below = below / len(sample)
    first, last = np.triu_indices(_CELLS + 1, 2)
    width = last - first
    beside = np.minimum(
        below[first] - below[np.maximum(first - width, 0)],
        below[np.minimum(last + width, _CELLS)] - below[last],
    )
    beside[below[last] - below[first] > _STRAYS * beside] = 0.0
    best = int(beside.argmax())
    low, high = float(edges[first[best]]), float(edges[last[best]])
    if beside[best] < _LEAST or ((column > low) & (column < high)).any():
        return None
    evidence = np.inf
    for start, end in ((2 * low - high, low), (high, 2 * high - low)):
        flank = (column >= start) & (column <= end) & ordinary
        visits = np.bincount(sample.clusters[flank], minlength=sample.cluster_count)
        evidence = min(evidence, visit_evidence(visits[None], sample.cluster_shares, 0.0))
    if evidence < needed:
        return None
    cuts = (Cut(unit, ABOVE, low), Cut(unit, BELOW, high))
    return Found(cuts, float(beside[best]), 0.0, float(evidence), _STRIP)
