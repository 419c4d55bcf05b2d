# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Scoring against a known truth: how well the flagged samples match the truly costly ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rules.rule import Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.terminal import printable


@dataclass(frozen=True)
class Score:
    """Counts of samples and their ratios; a ratio with denominator 0 is NaN.

    Attributes:
        samples: all samples.
        flagged: those that were flagged.
        costly: those that are truly costly.
        both: those that are flagged and truly costly.
    """

    samples: int
    flagged: int
    costly: int
    both: int

    @property
    def precision(self) -> float:
        """Share of the flagged samples that are costly."""
        return _ratio(self.both, self.flagged)

    @property
    def recall(self) -> float:
        """Share of the costly samples that are flagged."""
        return _ratio(self.both, self.costly)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; 0 where no sample is both."""
        return _ratio(2 * self.both, self.flagged + self.costly)

    @property
    def iou(self) -> float:
        """Intersection over union: samples that are both, of those that are either."""
        return _ratio(self.both, self.flagged + self.costly - self.both)

    def ratios(self) -> dict[str, float]:
        """Return ``precision``, ``recall``, ``f1`` and ``iou``."""
        return {name: getattr(self, name) for name in ('precision', 'recall', 'f1', 'iou')}


@dataclass(frozen=True)
class RuleScore:
    """The score of one enabled rule. UNKNOWN samples count for no rule.

    Attributes:
        rule: the rule.
        alone: the samples on which the rule is true, as if it were the only one.
        first: samples on which it is the first true rule, the one that a monitor reports.
        first_costly: those of them that are truly costly.
    """

    rule: Rule
    alone: Score
    first: int
    first_costly: int


@dataclass(frozen=True)
class RuleSetScore:
    """The score of a rule set.

    Attributes:
        overall: the samples that are not SAFE; UNKNOWN is flagged, as its cost is 1.
        unknown: samples whose verdict is UNKNOWN.
        unscored: samples without a finite true cost, not counted anywhere else.
        rules: the enabled rules in the order they are tried.
    """

    overall: Score
    unknown: int
    unscored: int
    rules: tuple[RuleScore, ...]


def score_flags(flagged: np.ndarray, costly: np.ndarray) -> Score:
    """Count.

    Args:
        flagged: (n,) bool.
        costly: (n,) bool.

    Raises:
        DataError: the shapes differ.
    """
    if np.shape(flagged) != np.shape(costly):
        raise DataError(
            f'{np.shape(flagged)} flags cannot be scored on {np.shape(costly)} true costs; '
            'allowed is one for each'
        )
    both = np.count_nonzero(flagged & costly)
    return Score(
        np.size(flagged), int(np.count_nonzero(flagged)), int(np.count_nonzero(costly)), int(both)
    )


def score_rules(rule_set: RuleSet, values: np.ndarray, true_cost: np.ndarray) -> RuleSetScore:
    """Judge samples and compare with their true cost.

    Args:
        rule_set: the rules; disabled ones are left out.
        values: (n, k) samples.
        true_cost: (n,) costly where above 0; samples with NaN or infinity are not scored.

    Raises:
        DataError: the shapes do not fit, or no sample has a true cost.
    """
    rows = rule_set.space.check_rows(values)
    cost = np.asarray(true_cost, dtype=np.float64)
    if cost.shape != (len(rows),):
        raise DataError(
            f'{len(rows)} samples cannot be scored on true costs of shape {cost.shape}; '
            f'allowed is one for each'
        )
    scored = np.isfinite(cost)
    if not scored.any():
        raise DataError(f'none of the {len(rows)} samples has a finite true cost to be scored on')
    unscored = int(np.count_nonzero(~scored))
    if unscored:
        rows, cost = rows[scored], cost[scored]
    costly = cost > 0
    judgement = rule_set.judge(rows)
    known = judgement.verdict != Verdict.UNKNOWN
    rules = []
    for index in rule_set.order:
        first = judgement.rule == index
        rules.append(
            RuleScore(
                rule_set.rules[index],
                score_flags(known & rule_set.rules[index].holds(rows), costly),
                int(np.count_nonzero(first)),
                int(np.count_nonzero(first & costly)),
            )
        )
    return RuleSetScore(
        score_flags(judgement.verdict != Verdict.SAFE, costly),
        int(np.count_nonzero(~known)),
        unscored,
        tuple(rules),
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float('nan')


def describe_score(score: RuleSetScore, space: FeatureSpace) -> str:
    """Return a score as lines of text, with a line for each rule that is true on some sample.

    Args:
        score: of a rule set.
        space: the features that its rules speak of.
    """
    overall = score.overall
    lines = [
        f'{overall.samples} samples: {overall.costly} truly costly, {overall.flagged} flagged, '
        f'{overall.both} both; {score.unknown / overall.samples:.2%} UNKNOWN',
        f'precision {_shown(overall.precision)}, recall {_shown(overall.recall)}, '
        f'F1 {_shown(overall.f1)}, IoU {_shown(overall.iou)}',
    ]
    if score.unscored:
        lines.append(f'not scored: {score.unscored} samples without a true cost')
    rules = [item for item in score.rules if item.alone.flagged]
    if rules:
        lines.append(f'{"first (costly)":>16}{"true (costly)":>18}  rule')
    for item in sorted(rules, key=lambda item: -item.first):
        first = f'{item.first} ({item.first_costly})'
        alone = f'{item.alone.flagged} ({item.alone.both})'
        lines.append(f'{first:>16}{alone:>18}  {item.rule.id:<9} {item.rule.words(space)}')
    return '\n'.join(map(printable, lines))


def score_document(score: RuleSetScore, space: FeatureSpace) -> dict[str, Any]:
    """Return a score as plain values, ready for JSON; an undefined ratio is None.

    Args:
        score: of a rule set.
        space: the features that its rules speak of.
    """
    return {
        'samples': score.overall.samples,
        'costly': score.overall.costly,
        **_numbers(score.overall),
        'unknown_share': score.unknown / score.overall.samples,
        'unscored': score.unscored,
        'rules': [
            {
                'id': item.rule.id,
                'text': item.rule.words(space),
                'first': item.first,
                'first_costly': item.first_costly,
                **_numbers(item.alone),
            }
            for item in score.rules
        ],
    }


def _numbers(score: Score) -> dict[str, Any]:
    ratios = {
        name: value if math.isfinite(value) else None for name, value in score.ratios().items()
    }
    return {'flagged': score.flagged, 'flagged_costly': score.both, **ratios}


def _shown(value: float) -> str:
    return f'{value:.3f}' if math.isfinite(value) else 'undefined'
