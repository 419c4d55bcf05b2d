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
from occ_constraints_pkg.rules import RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import Forecast, Forecaster
from sklearn.tree import DecisionTreeClassifier

from benchmarks.synthetic import TRAINING_ROWS, learned_rules, samples_of_a_car

_ROWS = 1_000_000
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
    rule_set = learned_rules(rng)
    rows = samples_of_a_car(rng, _ROWS)
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
    }


def _trees(
    rule_set: RuleSet, rng: np.random.Generator
) -> tuple[DecisionTreeClassifier, DecisionTreeClassifier]:
    samples, leaves = samples_of_a_car(rng, TRAINING_ROWS), len(rule_set.rules)
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
