# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Hypothesis strategies that tests of several folders share."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.tree import Branch, Node
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.rule import OPERATORS

# Few values, so that bounds of several rules, branches and samples often coincide.
COARSE = st.integers(-8, 8).map(lambda number: number / 4)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
_EITHER = st.booleans()


@st.composite
def spaces(draw, *, most=3, bounds=COARSE):
    """Feature spaces; each feature may have a lower and an upper physical bound.

    Some are of a family; its members may be apart, and it may have but one.
    """
    features, families = [], {}
    for index in range(draw(st.integers(1, most))):
        low, high = sorted((draw(bounds), draw(bounds)))
        low = low if draw(st.booleans()) else -np.inf
        high = high if draw(st.booleans()) else np.inf
        family = draw(st.sampled_from(['', '', 'f', 'g']))
        own = draw(st.sampled_from(['1', 'm/s'])), low, high
        own = families.setdefault(family, own) if family else own
        features.append(Feature(f'x{index}', *own, family))
    return FeatureSpace(tuple(features))


@st.composite
def rule_sets(draw, *, most=3, bounds=COARSE, most_rules=6, enabled=_EITHER):
    """Rule sets of any literals, also several on one side, but no contradictory rule.

    Literals may be about families, if there are any.
    """
    space = draw(spaces(most=most, bounds=bounds))
    subjects = st.integers(0, len(space) - 1)
    if space.families:
        subjects |= st.sampled_from(space.families)
    literal = st.builds(Literal, subjects, st.sampled_from(OPERATORS), bounds)
    rules = [
        Rule(f'R{index}', tuple(draw(st.lists(literal, min_size=1, max_size=4))), draw(enabled))
        for index in range(draw(st.integers(0, most_rules)))
    ]
    ranges = [sorted((draw(bounds), draw(bounds))) for _ in space.features]
    kept = tuple(rule for rule in rules if not rule.is_contradictory)
    return RuleSet(space, kept, np.array(ranges, dtype=np.float64))


@st.composite
def trees(draw, *, most=3, depth=4):
    """``(root, space, demonstrated)``: a tree nested within the demonstrated box.

    Splits have one to three branches with or without gaps, go into shrunk intervals, come back to
    features that were split above, and touch physical bounds.
    """
    count = draw(st.integers(1, most))
    box = np.array([sorted((draw(COARSE), draw(COARSE))) for _ in range(count)])
    features = []
    for index, (low, high) in enumerate(box):
        # At the demonstrated extreme, beyond it, or absent.
        floor = draw(st.sampled_from([low, low - 1.0, -np.inf]))
        ceiling = draw(st.sampled_from([high, high + 1.0, np.inf]))
        features.append(Feature(f'x{index}', '1', floor, ceiling))
    return _node(draw, box, depth), FeatureSpace(tuple(features)), box


def _node(draw, box, depth):
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        return Node()
    feature = draw(st.integers(0, len(box) - 1))
    low, high = box[feature]
    number = st.floats(low, high, allow_subnormal=False) | COARSE.filter(
        lambda number: low <= number <= high
    )
    ends = sorted(set(draw(st.lists(st.sampled_from([low, high]) | number, max_size=6))))
    if not ends:
        ends = sorted({low, high})
    intervals = []
    while ends:
        left = ends.pop(0)
        right = ends.pop(0) if ends and draw(st.booleans()) else left
        intervals.append((left, right))
        # Half-open pieces leave the smallest of gaps.
        close = float(np.nextafter(right, np.inf))
        if (not ends or close < ends[0]) and close <= high and draw(st.booleans()):
            ends.insert(0, close)
            if len(intervals) > 4:
                break
    branches = []
    for left, right in intervals:
        inner = box.copy()
        inner[feature] = left, right
        branches.append(Branch(left, right, 1, _node(draw, inner, depth - 1)))
    return Node(feature, tuple(branches))


@st.composite
def samples(draw, *, most_rows=200, most_features=4):
    """(n, k) demonstrations: smooth, with atoms, repeated rows, constants, whole numbers."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows = draw(st.integers(1, most_rows))
    kinds = draw(st.lists(st.sampled_from(sorted(_COLUMNS)), min_size=1, max_size=most_features))
    values = np.stack([_COLUMNS[kind](rng, rows) for kind in kinds], axis=1)
    if draw(st.booleans()):
        values = values[rng.integers(0, max(rows // 2, 1), size=rows)]
    return values


_COLUMNS = {
    'normal': lambda rng, n: rng.normal(size=n),
    'two modes': lambda rng, n: rng.normal(size=n) + 9.0 * (rng.random(n) < 0.4),
    'atom': lambda rng, n: np.where(rng.random(n) < 0.5, 0.0, rng.beta(2.0, 3.0, size=n)),
    'constant': lambda rng, n: np.full(n, 0.3),
    'whole': lambda rng, n: rng.integers(0, 4, size=n).astype(np.float64),
    'far out': lambda rng, n: rng.standard_cauchy(size=n),
    'float32': lambda rng, n: rng.normal(5e6, 1.0, size=n).astype(np.float32).astype(np.float64),
    'huge': lambda rng, n: rng.normal(size=n) * 1e300,
    'tiny': lambda rng, n: rng.normal(size=n) * 1e-310,
}


def probes(rng, bounds, rows=64):
    """(n, k) points at random, exactly on the bounds, and one float beside them.

    Args:
        rng: draws the points.
        bounds: for each of the k features the interesting values.
        rows: number of points.
    """
    columns = []
    for given in bounds:
        numbers = np.array([number for number in given if np.isfinite(number)] or [0.0])
        low, high = numbers.min(), numbers.max()
        with np.errstate(over='ignore'):
            beside = np.nextafter(numbers, -np.inf), np.nextafter(numbers, np.inf)
            extent = high - low
        pool = np.concatenate([numbers, *beside, [low / 2 + high / 2, low - 0.5, high + 0.5]])
        between = low + rng.random(rows) * extent if np.isfinite(extent) else pool
        columns.append(
            np.where(rng.random(rows) < 0.7, rng.choice(pool, size=rows), rng.choice(between, rows))
        )
    return np.stack(columns, axis=1)


def tree_bounds(root, space, demonstrated):
    """Return for each feature the bounds that a tree, its space and its box mention."""
    bounds = [
        [feature.low, feature.high, *demonstrated[index]]
        for index, feature in enumerate(space.features)
    ]

    def visit(node):
        for branch in node.branches:
            bounds[node.feature] += [branch.low, branch.high]
            visit(branch.node)

    visit(root)
    return bounds


def fit_settings():
    """Settings of the tree learner, far from its defaults too."""
    return st.builds(
        OCTreeSettings,
        max_depth=st.sampled_from([0, 1, 3, 6]),
        clip=st.sampled_from(['mass', 'density']),
        contamination=st.sampled_from([0.0, 0.05, 0.5]),
        gamma=st.sampled_from([0.0, 0.05, 0.3]),
        alpha=st.sampled_from([0.0, 0.5, 1.0]),
        beta=st.sampled_from([0.0, 0.02]),
        min_split=st.sampled_from([0.0, 0.1]),
        nu=st.sampled_from([None, 0.0, 0.1, 0.5]),
    )
