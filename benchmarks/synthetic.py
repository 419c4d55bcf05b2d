# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Synthetic samples of a car and rules for them: 20 features, 80 rules of every length."""

from __future__ import annotations

from typing import Any

import numpy as np
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Rule, RuleSet

TRAINING_ROWS = 100_000
"""Samples that the rules are learned from."""

_RULES = 80
_LIDAR_BINS = 12
# Three ways to drive, by turns: slow, city, highway. What is demonstrated of one feature depends
# on another, so the tree has several branches and its rules several literals.
_SHARES = (0.3, 0.4, 0.3)
_SPEED = ((1.5, 0.5), (11.0, 2.0), (30.0, 2.0))
_GAP = ((4.0, 1.0), (20.0, 5.0), (60.0, 10.0))
_CENTRED = {
    'a_x': (0.8, 1.0, 0.5),
    'a_y': (0.2, 1.0, 0.6),
    'yaw_rate': (0.5, 0.2, 0.05),
    'steering': (0.3, 0.1, 0.02),
}
_LIDAR_REACH = (0.95, 0.7, 0.4)
_SETTINGS = OCTreeSettings(alpha=0.5, max_depth=20)


def samples_of_a_car(rng: np.random.Generator, rows: int) -> np.ndarray:
    """Return (rows, 20) synthetic samples of a car's features, in no order.

    Args:
        rng: draws them.
        rows: how many.
    """
    way = rng.choice(3, size=rows, p=_SHARES)

    def normal(means: Any, deviations: Any) -> np.ndarray:
        return np.asarray(means)[way] + np.asarray(deviations)[way] * rng.normal(size=rows)

    speed, gap = normal(*zip(*_SPEED, strict=True)), normal(*zip(*_GAP, strict=True))
    centred = [normal((0.0, 0.0, 0.0), deviations) for deviations in _CENTRED.values()]
    brake = np.where(rng.random(rows) < 0.5, 0.0, rng.beta(2.0, 5.0, size=rows))
    reach = np.array(_LIDAR_REACH)[way, None]
    closeness = reach * rng.beta(2.0, 3.0, size=(rows, _LIDAR_BINS))
    closeness[rng.random(closeness.shape) < 0.5] = 0.0
    headway = gap / np.maximum(speed, 0.5)
    return np.column_stack([speed, gap, headway, *centred, brake, closeness])


def learned_rules(rng: np.random.Generator) -> RuleSet:
    """Return rules learned from such samples: all of one literal, and others of every length.

    Args:
        rng: draws the samples.
    """
    free = [Feature(name, unit) for name, unit in (('v', 'm/s'), ('gap', 'm'), ('headway', 's'))]
    free += [Feature(name) for name in _CENTRED]
    space = FeatureSpace(
        (
            *free,
            Feature('brake', '1', 0.0, 1.0),
            *(Feature(f'd_l{number}', '1', 0.0, 1.0) for number in range(_LIDAR_BINS)),
        )
    )
    samples = samples_of_a_car(rng, TRAINING_ROWS)
    demonstrated = np.stack([samples.min(axis=0), samples.max(axis=0)], axis=1)
    learned = extract_rules(fit_safe_set(samples, _SETTINGS), space, demonstrated)
    single = [rule for rule in learned.rules if len(rule.literals) == 1]
    several = [rule for rule in learned.rules if len(rule.literals) > 1]
    return RuleSet(space, (*single, *_evenly(several, _RULES - len(single))), demonstrated)


def _evenly(rules: list[Rule], count: int) -> list[Rule]:
    """Return so many of some rules, spread over all of them; all if there are no more."""
    places = np.linspace(0, len(rules) - 1, min(count, len(rules)))
    return [rules[place] for place in np.unique(places.round().astype(int))]
