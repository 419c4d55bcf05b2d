# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The formula with common literals factored out: what all fast evaluation works on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.rules.rule import Literal, Rule, split_off_single
from occ_constraints_pkg.rules.space import FeatureSpace

# Common literals are factored out this many times within one another; what is left is evaluated
# rule by rule, so that neither recursion nor generated code can become too deep.
_DEEPEST = 20


class Group(NamedTuple):
    """Literals of one feature, at most one lower and one upper.

    Attributes:
        feature: the feature's position.
        literals: one or two.
    """

    feature: int
    literals: tuple[Literal, ...]


class Disjunction(NamedTuple):
    """True when any literal of ``ends`` is, or any of ``parts``.

    The same structure gives the margin: put the literals' distances from becoming true for the
    literals, the smallest for *or*, the largest for *and*.

    Attributes:
        ends: literals that are enough alone; of those alike but for the bound the widest only.
        parts: each the conjunction of all literals of some groups and of another disjunction.
    """

    ends: tuple[Group, ...]
    parts: tuple[tuple[tuple[Group, ...], Disjunction], ...]


def factor(rules: Iterable[Rule]) -> Disjunction:
    """Write the disjunction of some rules with common literals factored out.

    Rules learned from a tree repeat the conditions of their branch: ``(a and b) or (a and c)``
    becomes ``a and (b or c)``. A rule that implies a wider one is left out. Truth and margin stay
    the same, exactly: both are made of *min* and *max*, which distribute and absorb.
    """
    conjunctions = [rule.tightest_literals for rule in rules]
    uses = Counter(literal for literals in conjunctions for literal in literals)
    first_seen = {literal: place for place, literal in enumerate(uses)}
    # The commonest first, so that rules share as long a beginning as possible.
    ordered = [
        tuple(sorted(literals, key=lambda item: (-uses[item], first_seen[item])))
        for literals in conjunctions
    ]
    return _factor(ordered, _DEEPEST)


def safe_box(space: FeatureSpace, formula: Disjunction) -> np.ndarray:
    """Return (2, k) what the literals that are enough alone leave of the physical bounds."""
    box = space.finite_bounds.copy()
    for group in formula.ends:
        for literal in group.literals:
            end, pick = (0, max) if literal.is_upper else (1, min)
            box[end, literal.feature] = pick(box[end, literal.feature], literal.last)
    return box


def _factor(conjunctions: list[tuple[Literal, ...]], levels: int) -> Disjunction:
    single, left = split_off_single(conjunctions)
    shared: dict[object, list[tuple[Literal, ...]]] = {}
    for place, literals in enumerate(left):
        shared.setdefault(literals[0] if levels else place, []).append(literals)
    parts = []
    for together in shared.values():
        if len(together) == 1:
            *condition, last = together[0]
            inner = Disjunction(_groups([last]), ())
        else:
            condition = [together[0][0]]
            inner = _factor([literals[1:] for literals in together], levels - 1)
        if not inner.ends and len(inner.parts) == 1:
            groups, inner = inner.parts[0]
            condition += [literal for group in groups for literal in group.literals]
        parts.append((_groups(condition), inner))
    return Disjunction(_groups(single), tuple(parts))


def _groups(literals: Iterable[Literal]) -> tuple[Group, ...]:
    by_feature = sorted(literals, key=attrgetter('feature'))
    return tuple(
        Group(feature, tuple(same)) for feature, same in groupby(by_feature, attrgetter('feature'))
    )
