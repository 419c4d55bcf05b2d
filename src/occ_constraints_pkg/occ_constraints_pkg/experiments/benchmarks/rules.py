# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Judging by rules beside the decision tree of scikit-learn: many rows, and one row."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from sklearn.tree import DecisionTreeClassifier

from occ_constraints_pkg.experiments.conditions import machine, versions
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.octree import fit_tree
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import Forecast, Forecaster

_ROWS, _TRAINING_ROWS, _RULES = 1_000_000, 100_000, 80
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
_LEAST_ROUNDS = 3
_SINGLE_CALLS = 2000
# Of the rows that are forecast from: 100 a second.
_STEP_NS = 10_000_000


def run(seconds: float = 5.0) -> dict[str, Any]:
    """Measure how long the rules take to judge, in one thread, and two trees of scikit-learn.

    Both trees have as many leaves as there are rules. One has learned the verdicts of the rules;
    it is deep, for nearly all samples are safe. The other has learned random labels and may be
    hardly be deeper than so many leaves need; it is as fast as such a tree can be.

    Many rows are measured in CPU time, by turns, and the fastest round counts; of one row the
    median in real time.

    Args:
        seconds: measured time per form, at least.
    """
    rng = np.random.default_rng(0)
    rule_set = _learned_rules(rng)
    rows = _drives(rng, _ROWS)
    shares = np.bincount(rule_set.verdicts(rows), minlength=3) / len(rows)
    verdict_tree, even_tree = _trees(rule_set, rng)

    batch = _fastest(
        {
            'verdict': lambda: rule_set.verdicts(rows),
            'judge': lambda: rule_set.judge(rows),
            'verdict tree': lambda: verdict_tree.predict(rows),
            'even tree': lambda: even_tree.predict(rows),
        },
        seconds,
    )
    forecaster = Forecaster(rule_set)

    def forecast(number: int) -> Forecast:
        forecaster.add(number * _STEP_NS, rows[number])
        return forecaster.forecast(Verdict.SAFE, -1)

    single = _median(
        {
            'verdict': lambda number: rule_set.verdict(rows[number]),
            'judge': lambda number: rule_set.judge(rows[number : number + 1]),
            'forecast': forecast,
            'even tree': lambda number: even_tree.predict(rows[number : number + 1]),
        }
    )
    per_row = {name: 1e9 * value / len(rows) for name, value in batch.items()}
    return {
        'metrics': {
            'verdict_ns_per_row': per_row['verdict'],
            'judge_ns_per_row': per_row['judge'],
            'single_verdict_us': 1e6 * single['verdict'],
            'single_judge_us': 1e6 * single['judge'],
            'single_forecast_us': 1e6 * single['forecast'],
            'sklearn_per_verdict_ratio': per_row['verdict tree'] / per_row['verdict'],
            'sklearn_per_judge_ratio': per_row['verdict tree'] / per_row['judge'],
            'sklearn_even_per_verdict_ratio': per_row['even tree'] / per_row['verdict'],
            'sklearn_even_per_judge_ratio': per_row['even tree'] / per_row['judge'],
            'single_sklearn_per_verdict_ratio': single['even tree'] / single['verdict'],
            'single_sklearn_per_judge_ratio': single['even tree'] / single['judge'],
        },
        'peers': {
            'sklearn_ns_per_row': per_row['verdict tree'],
            'sklearn_even_ns_per_row': per_row['even tree'],
            'single_sklearn_us': 1e6 * single['even tree'],
        },
        'settings': {
            'rows': len(rows),
            'features': rows.shape[1],
            'rules': len(rule_set.rules),
            'rules_by_literals': dict(
                sorted(Counter(len(rule.literals) for rule in rule_set.rules).items())
            ),
            'different_literals': len({item for rule in rule_set.rules for item in rule.literals}),
            'shares': {verdict.name: float(shares[verdict]) for verdict in Verdict},
            'sklearn_leaves': verdict_tree.get_n_leaves(),
            'sklearn_depth': verdict_tree.get_depth(),
            'sklearn_even_leaves': even_tree.get_n_leaves(),
            'sklearn_even_depth': even_tree.get_depth(),
            'seconds': seconds,
        },
        'machine': machine(),
        'versions': versions(('numpy', 'scikit-learn')),
    }


def _drives(rng: np.random.Generator, rows: int) -> np.ndarray:
    """Return (rows, 20) made-up samples of a car's features, in no order."""
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


def _learned_rules(rng: np.random.Generator) -> RuleSet:
    """Return rules learned from such samples: all of one literal, and others of every length."""
    free = [Feature(name, unit) for name, unit in (('v', 'm/s'), ('gap', 'm'), ('headway', 's'))]
    free += [Feature(name) for name in _CENTRED]
    space = FeatureSpace(
        (
            *free,
            Feature('brake', '1', 0.0, 1.0),
            *(Feature(f'd_l{number}', '1', 0.0, 1.0) for number in range(_LIDAR_BINS)),
        )
    )
    samples = _drives(rng, _TRAINING_ROWS)
    demonstrated = np.stack([samples.min(axis=0), samples.max(axis=0)], axis=1)
    learned = extract_rules(fit_tree(samples, _SETTINGS), space, demonstrated)
    single = [rule for rule in learned.rules if len(rule.literals) == 1]
    several = [rule for rule in learned.rules if len(rule.literals) > 1]
    return RuleSet(space, (*single, *_evenly(several, _RULES - len(single))), demonstrated)


def _evenly(rules: list[Rule], count: int) -> list[Rule]:
    """Return so many of some rules, spread over all of them; all if there are no more."""
    places = np.linspace(0, len(rules) - 1, min(count, len(rules)))
    return [rules[place] for place in np.unique(places.round().astype(int))]


def _trees(
    rule_set: RuleSet, rng: np.random.Generator
) -> tuple[DecisionTreeClassifier, DecisionTreeClassifier]:
    samples, leaves = _drives(rng, _TRAINING_ROWS), len(rule_set.rules)
    labels = rng.random(len(samples)) < 0.5
    deep = DecisionTreeClassifier(max_leaf_nodes=leaves, random_state=0)
    even = DecisionTreeClassifier(
        max_leaf_nodes=leaves, max_depth=math.ceil(math.log2(leaves)) + 1, random_state=0
    )
    return deep.fit(samples, rule_set.verdicts(samples)), even.fit(samples, labels)


def _fastest(forms: Mapping[str, Callable[[], Any]], seconds: float) -> dict[str, float]:
    """Return the CPU time of each form's fastest call, after one that does not count."""
    for form in forms.values():
        form()
    times: dict[str, list[float]] = {name: [] for name in forms}
    while any(len(took) < _LEAST_ROUNDS or sum(took) < seconds for took in times.values()):
        for name, form in forms.items():
            begin = time.process_time()
            form()
            times[name].append(time.process_time() - begin)
    return {name: min(took) for name, took in times.items()}


def _median(forms: Mapping[str, Callable[[int], Any]]) -> dict[str, float]:
    """Return the median time of each form over calls with one row after another."""
    times: dict[str, list[int]] = {name: [] for name in forms}
    for name, form in forms.items():
        form(0)
        for number in range(_SINGLE_CALLS):
            begin = time.perf_counter_ns()
            form(number)
            times[name].append(time.perf_counter_ns() - begin)
    return {name: 1e-9 * float(np.median(took)) for name, took in times.items()}
