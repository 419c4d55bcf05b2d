# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Many rules at once: their literals as arrays, for what has to tell rules apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.rules.rule import Rule


class RuleTable:
    """The literals of some rules as arrays, each different literal once.

    Every literal is ``sign * x > threshold``, see :class:`~occ_constraints_pkg.rules.rule.Literal`;
    that is exact, bounds included.

    Attributes:
        feature: (m,) the feature of each literal.
        sign: (m, 1) 1.0 or -1.0; a column, for any number of samples.
        threshold: (m, 1) the largest signed value on which the literal is false.
        members: (all literals,) for the literals of one rule after the other their places above.
        starts: (rules,) where each rule begins in ``members``.

    Args:
        rules: which.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, rules: Sequence[Rule], scale: np.ndarray) -> None:
        literals = [literal for rule in rules for literal in rule.literals]
        unique = list(dict.fromkeys(literals))
        place = {literal: index for index, literal in enumerate(unique)}
        self.members = np.array([place[literal] for literal in literals], dtype=np.intp)
        self.starts = np.cumsum([0, *(len(rule.literals) for rule in rules)], dtype=np.intp)[:-1]
        self.feature = np.array([literal.feature for literal in unique], dtype=np.intp)
        self.sign = np.array([[literal.sign] for literal in unique]).reshape(-1, 1)
        bound = np.array([[literal.bound] for literal in unique]).reshape(-1, 1)
        last = np.array([[literal.last] for literal in unique]).reshape(-1, 1)
        self.threshold = self.sign * last
        self._signed_bound = self.sign * bound
        # Not its reciprocal, which a very small range does not have.
        self._scale = scale[self.feature, None]

    def truth(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) bool: which rules are true on (n, k) samples."""
        holds = self._signed(rows) > self.threshold
        return np.logical_and.reduceat(holds[self.members], self.starts, axis=0)

    def margins(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) float64: how far (n, k) samples are from making each rule true."""
        with np.errstate(invalid='ignore', over='ignore'):
            distances = (self._signed_bound - self._signed(rows)) / self._scale
        # Adding 0 leaves no minus zero.
        return np.maximum.reduceat(distances[self.members], self.starts, axis=0) + 0.0

    def _signed(self, rows: np.ndarray) -> np.ndarray:
        return self.sign * rows.T[self.feature]
