# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A score as text for people and as plain values for machines."""

from __future__ import annotations

import math
from typing import Any

from occ_constraints_pkg.learning.scoring import RuleSetScore, Score
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable


def describe_score(score: RuleSetScore, space: FeatureSpace) -> str:
    """Return a score as lines of text; a rule has a line when it is true on some sample.

    Args:
        score: of a rule set.
        space: the features that its rules speak of.
    """
    overall = score.overall
    lines = [
        f'{overall.samples} samples: {overall.costly} truly costly, {overall.flagged} flagged, '
        f'{overall.both} both; {score.unknown / overall.samples:.2%} UNKNOWN',
        f'precision {_ratio(overall.precision)}, recall {_ratio(overall.recall)}, '
        f'F1 {_ratio(overall.f1)}, IoU {_ratio(overall.iou)}',
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
    """Return a score as what JSON can hold; a ratio with nothing below it is None.

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


def _ratio(value: float) -> str:
    return f'{value:.3f}' if math.isfinite(value) else 'undefined'
