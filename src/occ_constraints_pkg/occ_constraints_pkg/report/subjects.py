# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules as the program of a page knows them: literals that compare a column with a bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.rules.rule import Literal, Subject
from occ_constraints_pkg.rules.ruleset import RuleSet


class Subjects:
    """What is compared with bounds: a column for each feature, and each end of a family.

    Args:
        rule_set: the rules.

    Attributes:
        literals: for each column one that compares it, which knows its values.
    """

    def __init__(self, rule_set: RuleSet) -> None:
        self._space = rule_set.space
        self._demonstrated = rule_set.demonstrated
        found: dict[Subject, Literal] = {}
        for rule in rule_set.rules:
            for literal in rule.literals:
                found.setdefault(literal.subject, literal)
        self._columns = {subject: place for place, subject in enumerate(found)}
        self.literals: tuple[Literal, ...] = tuple(found.values())

    def __len__(self) -> int:
        return len(self.literals)

    def column(self, literal: Literal) -> int:
        """Return which column a literal compares with its bound."""
        return self._columns[literal.subject]

    def values(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return the (n,) values of each column in (n, k) samples."""
        return [literal.values(rows) for literal in self.literals]

    def knows(self, rows: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) samples whether it can be judged, by any enabled rules."""
        return self._space.knows(rows)

    def document(self) -> list[dict[str, Any]]:
        """Return name, unit and demonstrated range of each column as plain values."""
        return [self._described(literal) for literal in self.literals]

    def _described(self, literal: Literal) -> dict[str, Any]:
        ranges = np.asarray(self._demonstrated)[list(literal.members)]
        unit = self._space.features[literal.members[0]].unit
        which = {-1: 'smallest ', 0: '', 1: 'largest '}[literal.subject[1]]
        name = (
            literal.name(self._space).removeprefix('any ') if which else literal.name(self._space)
        )
        return {
            'name': which + name,
            'unit': '' if unit == '1' else unit,
            'range': [float(ranges[:, 0].min()), float(ranges[:, 1].max())],
        }


def rules_data(rule_set: RuleSet, subjects: Subjects) -> list[dict[str, Any]]:
    """Return all rules as plain values, in the order of the file."""
    return [
        {
            'id': rule.id,
            'words': rule.words(rule_set.space),
            'enabled': rule.enabled,
            'literals': _literals(rule.literals, subjects),
        }
        for rule in rule_set.rules
    ]


def _literals(literals: Sequence[Literal], subjects: Subjects) -> list[dict[str, Any]]:
    return [
        {
            'column': subjects.column(literal),
            'operator': literal.operator,
            'bound': float(literal.bound),
        }
        for literal in literals
    ]
