# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Truth and margin of each rule by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.rules.rule import Rule


class OneByOne:
    """Rules as arrays, for what has to tell them apart.

    Every literal becomes ``sign * x > threshold``: a lower-or-equal comparison with b is a strict
    one with the next float above b, and a comparison from below is one of the negated numbers.
    Both steps are exact.

    Args:
        rules: one or more.
        scale: (k,) the unit of distance of each feature.
    """

    def __init__(self, rules: Sequence[Rule], scale: np.ndarray) -> None:
        literals = [literal for rule in rules for literal in rule.literals]
        unique = list(dict.fromkeys(literals))
        place = {literal: index for index, literal in enumerate(unique)}
        self._members = np.array([place[literal] for literal in literals])
        self._starts = np.cumsum([0, *(len(rule.literals) for rule in rules[:-1])])
        self._feature = np.array([literal.feature for literal in unique])
        bound = np.array([literal.bound for literal in unique], dtype=np.float64)
        # All are columns: one number per literal, for any number of samples.
        self._sign = np.array([[-1.0] if literal.is_upper else [1.0] for literal in unique])
        strict = np.array([[literal.operator in ('<', '>')] for literal in unique])
        self._signed_bound = self._sign * bound[:, None]
        with np.errstate(over='ignore'):
            below = np.nextafter(self._signed_bound, -np.inf)
        self._threshold = np.where(strict, self._signed_bound, below)
        # Not its reciprocal, which a very small range does not have.
        self._scale = scale[self._feature, None]

    def truth(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) bool, for (n, k) samples."""
        holds = self._signed(rows) > self._threshold
        return np.logical_and.reduceat(holds[self._members], self._starts, axis=0)

    def margins(self, rows: np.ndarray) -> np.ndarray:
        """Return (rules, n) float64, for (n, k) samples."""
        with np.errstate(invalid='ignore', over='ignore'):
            short_of = (self._signed_bound - self._signed(rows)) / self._scale
        # Adding 0 leaves no minus zero.
        return np.maximum.reduceat(short_of[self._members], self._starts, axis=0) + 0.0

    def _signed(self, rows: np.ndarray) -> np.ndarray:
        return self._sign * rows.T[self._feature]
