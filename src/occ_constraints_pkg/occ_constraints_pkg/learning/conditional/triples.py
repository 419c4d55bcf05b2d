# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Corners of three units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from occ_constraints_pkg.learning.conditional.acceptance import Acceptance, Found
from occ_constraints_pkg.learning.conditional.corners import LOOKS
from occ_constraints_pkg.learning.conditional.correlation import CorrelationNull
from occ_constraints_pkg.learning.conditional.evidence import needed_evidence
from occ_constraints_pkg.learning.conditional.expectation import Expectation
from occ_constraints_pkg.learning.conditional.grid import Grid, make_grid
from occ_constraints_pkg.learning.conditional.price import Seen, bad_share, worth
from occ_constraints_pkg.learning.conditional.sample import Sample
from occ_constraints_pkg.learning.conditional.units import Cut

MOST_UNITS = 30
"""Among more units than this, no triple is looked for: there would be too many of them."""

# Cells for the first look at all triples, and for the second look at the best of them.
_CELLS, _FINE_CELLS = 8, 24
_LEAST = 0.01
# Cells are wide, so that the best corner on them may be worth less than the rule will be.
_LEAST_ON_GRID = 0.005
_MOST_CANDIDATES = 40


def find_triples(
    sample: Sample,
    expectation: Expectation,
    correlation: CorrelationNull,
    pairs: Sequence[tuple[int, int]],
    found: Sequence[Found],
    *,
    looks_at_pairs: float,
    delta: float,
    most_rules: int,
) -> list[Found]:
    """Return the rules that there are, and then those about three units.

    What is expected is the least, over the three, of one unit's mass times the mass that the other
    two have together: what two literals explain is no rule of three.

    Args:
        sample: the rows.
        expectation: of these rows.
        correlation: of these rows.
        pairs: units that may be combined.
        found: rules that there are already.
        looks_at_pairs: how many corners of pairs were looked at.
        delta: chance that there is any false rule.
        most_rules: rules in all at most.
    """
    found = list(found)
    if len(sample.units) > MOST_UNITS:
        return found
    grids = {unit: make_grid(sample, unit, _CELLS) for unit in range(len(sample.units))}
    known = {pair for pair in pairs if not correlation.is_determined(*pair)}
    triples = [
        three
        for three in combinations(range(len(grids)), 3)
        if all(pair in known for pair in combinations(three, 2))
        and all(grids[unit].cuts for unit in three)
    ]
    looks = LOOKS * sum(
        float(np.prod([grids[unit].orientations for unit in three])) for three in triples
    )
    needed = needed_evidence(looks + looks_at_pairs, delta)
    joint = {pair: _joint(grids, pair, len(sample)) for pair in known}
    candidates = []
    for three in triples:
        gain = _gain(grids, three, joint, len(sample))
        best = float(gain.max())
        if best > _LEAST_ON_GRID:
            candidates.append((best, three))
    candidates.sort(key=lambda candidate: -candidate[0])
    fine: dict[int, Grid] = {}
    acceptance = Acceptance(sample, expectation, correlation)
    for _, three in candidates[:_MOST_CANDIDATES]:
        if len(found) >= most_rules:
            break
        cuts = _refined(sample, fine, three)
        rule = _judge(acceptance, expectation, cuts, needed, found)
        if rule is not None:
            found.append(rule)
            expectation.forbid([rule.cuts for rule in found])
    return found


def _refined(sample: Sample, fine: dict[int, Grid], three: tuple[int, int, int]) -> tuple[Cut, ...]:
    """Return the best corner of three units on finer cells.

    Args:
        sample: the rows.
        fine: finer grids by unit; those that are missing are added.
        three: the units.
    """
    for unit in three:
        if unit not in fine:
            fine[unit] = make_grid(sample, unit, _FINE_CELLS)
    joint = {pair: _joint(fine, pair, len(sample)) for pair in combinations(three, 2)}
    gain = _gain(fine, three, joint, len(sample))
    at = np.unravel_index(int(gain.argmax()), gain.shape)
    return tuple(fine[unit].cuts[position] for unit, position in zip(three, at, strict=True))


def _judge(
    acceptance: Acceptance,
    expectation: Expectation,
    cuts: tuple[Cut, ...],
    needed: float,
    found: Sequence[Found],
) -> Found | None:
    if expectation.share(cuts) < _LEAST:
        return None
    seen = sum(rule.seen for rule in found)
    return acceptance.judge(cuts, needed, _LEAST, seen, proven=False)


def _joint(grids: Mapping[int, Grid], pair: tuple[int, int], rows: int) -> np.ndarray:
    """Return the share of the rows in each corner of two units."""
    one, other = (grids[unit] for unit in pair)
    counts = np.bincount(one.codes * other.cells + other.codes, minlength=one.cells * other.cells)
    return one.member @ counts.reshape(one.cells, -1) @ other.member.T / rows


def _gain(
    grids: Mapping[int, Grid],
    three: tuple[int, int, int],
    joint: dict[tuple[int, int], np.ndarray],
    rows: int,
) -> np.ndarray:
    """Return what each corner of three units is worth: (a, b, c)."""
    i, j, k = three
    a, b, c = (grids[unit] for unit in three)
    cells = (a.codes * b.cells + b.codes) * c.cells + c.codes
    counts = np.bincount(cells, minlength=a.cells * b.cells * c.cells).reshape(a.cells, -1)
    first = (a.member @ counts).reshape(-1, b.cells, c.cells)
    seen = b.member @ first @ c.member.T / rows
    expected = np.minimum(
        np.minimum(
            a.mass[:, None, None] * joint[j, k][None],
            b.mass[None, :, None] * joint[i, k][:, None, :],
        ),
        c.mass[None, None, :] * joint[i, j][:, :, None],
    )
    volume = a.volume[:, None, None] * b.volume[None, :, None] * c.volume[None, None, :]
    has_core = (
        (a.core >= 0)[:, None, None] & (b.core >= 0)[None, :, None] & (c.core >= 0)[None, None]
    )
    density = bad_share(seen * rows, rows, volume)
    bad = np.where(has_core, density[np.ix_(a.core, b.core, c.core)], 0.0)
    return worth(expected, Seen(seen, seen), volume, bad)
