# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The bounds of a box and of conditional rules moved outward, for the false-alarm guarantee."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_constraints_pkg.learning.conditional.rules import ConditionalRule, LearnedRules, Literal

_LARGEST = float(np.finfo(np.float64).max)


@dataclass(frozen=True, eq=False)
class MovableRules:
    """A box less what conditional rules forbid; the larger the margin, the larger the safe set.

    Bounds of the box move outward, those of a conditional rule into what it forbids. A discrete
    feature has no value in between, so its literals stay, and the rule goes once the margin reaches
    from one value to the next.

    Attributes:
        learned: the safe set.
        scale: (k,) unit of the margin in each feature; does not change when bounds move.
        limits: (k, 2) physical bounds, infinite where there is none.
    """

    learned: LearnedRules
    scale: np.ndarray
    limits: np.ndarray

    def moved(self, margin: float) -> MovableRules:
        """Return the safe set with all its bounds moved.

        Args:
            margin: at least 0, in parts of each feature's scale.
        """
        with np.errstate(over='ignore'):
            step = np.minimum(margin * self.scale, _LARGEST)
            lows, highs = self.learned.box[:, 0] - step, self.learned.box[:, 1] + step
        box = np.stack(
            [np.maximum(lows, self.limits[:, 0]), np.minimum(highs, self.limits[:, 1])], axis=1
        )
        rules = []
        for rule in self.learned.rules:
            literals = self._moved(rule, step, margin)
            if literals:
                rules.append(replace(rule, literals=literals))
        return replace(self, learned=replace(self.learned, box=box, rules=tuple(rules)))

    def contains(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) finite rows whether it is inside: (n,) bool."""
        return ~self.learned.flagged(rows)

    def tolerances(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) the margins at which each of (n, k) rows is just inside, but for rounding."""
        box = self.learned.box
        with np.errstate(over='ignore'):
            outside = np.maximum(box[:, 0] - rows, rows - box[:, 1]) / self.scale
        worst = np.maximum(outside.max(axis=1, initial=0.0), 0.0)
        for rule in self.learned.rules:
            inside = np.flatnonzero(rule.holds(rows))
            depths = [self._depths(literal, rows[inside]) for literal in rule.literals]
            worst[inside] = np.maximum(worst[inside], np.min(depths, axis=0))
        return worst

    def _depths(self, literal: Literal, rows: np.ndarray) -> np.ndarray:
        """Return (n,) the margins up to which a literal stays true on rows where it is."""
        if (gap := self._gap(literal)) is not None:
            return np.full(len(rows), gap)
        columns = list(literal.columns)
        values, scale = rows[:, columns], self.scale[columns]
        with np.errstate(over='ignore'):
            deep = literal.bound - values if literal.is_upper else values - literal.bound
            return np.asarray((deep / scale).max(axis=1))

    def _gap(self, literal: Literal) -> float | None:
        """Return the margin from one value of a discrete feature to the next, else ``None``."""
        # A family is continuous, even if its first member is discrete.
        if literal.family:
            return None
        steps, column = self.learned.steps, literal.columns[0]
        return steps[column] / float(self.scale[column]) if column in steps else None

    def _moved(self, rule: ConditionalRule, step: np.ndarray, margin: float) -> tuple[Literal, ...]:
        """Return the moved literals of a rule, none if it can no longer be true."""
        literals = []
        for literal in rule.literals:
            column = literal.columns[0]
            if (gap := self._gap(literal)) is not None:
                if margin >= gap:
                    return ()
                literals.append(literal)
                continue
            columns = list(literal.columns)
            if literal.is_upper:
                bound = max(literal.bound - float(step[column]), -_LARGEST)
                is_possible = bound > max(self.limits[columns, 0].min(), -_LARGEST)
            else:
                bound = min(literal.bound + float(step[column]), _LARGEST)
                is_possible = bound < min(self.limits[columns, 1].max(), _LARGEST)
            if not is_possible:
                return ()
            literals.append(replace(literal, bound=bound))
        return () if _is_closed(literals) else tuple(literals)


def _is_closed(literals: Sequence[Literal]) -> bool:
    """Tell whether literals are those of a gap of one feature that has no value left."""
    if len({literal.columns for literal in literals}) > 1 or literals[0].family:
        return False
    low = max((item.bound for item in literals if not item.is_upper), default=-math.inf)
    high = min((item.bound for item in literals if item.is_upper), default=math.inf)
    return math.nextafter(low, math.inf) >= high
