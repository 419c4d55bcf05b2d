# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts: what the rules say of each sample."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Verdict(IntEnum):
    """SAFE, VIOLATED, or UNKNOWN when an input cannot be judged; UNKNOWN is never safe.

    Example:
        >>> [verdict.name for verdict in occ.Verdict]
        ['SAFE', 'VIOLATED', 'UNKNOWN']
    """

    SAFE = 0
    VIOLATED = 1
    UNKNOWN = 2


# NumPy takes a plain number much faster than a member of an enumeration.
_SAFE = int(Verdict.SAFE)


@dataclass(frozen=True)
class Judgement:
    """The verdicts on n samples.

    Attributes:
        verdict: (n,) int8, values of :class:`Verdict`.
        rule: (n,) int64, position in the rule set of the first violated rule, -1 where none.
        margin: (n,) float64, signed distance to the boundary of the safe set with each feature
            scaled by its demonstrated range: at least 0 where SAFE, at most 0 where VIOLATED,
            NaN where UNKNOWN. See :meth:`RuleSet.judge`.

    Example:
        >>> space = occ.FeatureSpace((occ.Feature('speed', 'm/s'),))
        >>> fast = occ.Rule('fast', (occ.Literal(0, '>', 1.5),))
        >>> rule_set = occ.RuleSet(space, (fast,), np.array([[0.0, 1.0]]))
        >>> judgement = rule_set.judge(np.array([[1.0], [2.0], [np.nan]]))
        >>> judgement.verdict, judgement.cost
        (array([0, 1, 2], dtype=int8), array([0., 1., 1.]))
    """

    verdict: np.ndarray
    rule: np.ndarray
    margin: np.ndarray

    @classmethod
    def unknown(cls, count: int) -> Judgement:
        """Return UNKNOWN for so many samples."""
        verdict = np.full(count, Verdict.UNKNOWN, dtype=np.int8)
        return cls(verdict, np.full(count, -1), np.full(count, np.nan))

    @property
    def cost(self) -> np.ndarray:
        """(n,) float64: 1.0 where not SAFE, else 0.0."""
        return (self.verdict != _SAFE).astype(np.float64)
