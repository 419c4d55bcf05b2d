# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The OC-tree article's benchmark (its section on experiments), over many random splits.

Approach A: all rows of a data set are targets and uniform outliers are added. Approach B: one
class is the target and outliers are rows of the other classes. Two thirds of the rows are for
training, parameters are chosen there by cross-validation on F1, and the last third is judged.

What the article leaves open, and what is done here:

- x % is a share of the targets. Outliers are added before the split, so both parts have them: the
  printed precisions of methods that accept nearly everything equal the share of targets only so.
- Uniform outliers fill the bounding box of the data.
- The split is random and not stratified, as are the folds.
- "At least 5 instances per node" is taken as part of beta: the larger of 2 % and 5 samples.
- A tree judges by the attributes it cuts; the bounding box of the training data does not count.
- Ties of F1 go to the first of the grid, the smallest alpha and nu.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.octree import fit_tree, oversteps
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.tree import Node
from sklearn.ensemble import IsolationForest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import OneClassSVM

from benchmarks.conditions import machine, versions
from experiments.article_data import (
    BENCHMARKS,
    Benchmark,
    contaminate,
    load_benchmark,
)
from experiments.article_printed import METHODS, NOISE_LEVELS, markdown
from experiments.results import data_folder, earlier_results, write_results

NUS = (0.05, 0.10, 0.15, 0.20)
_LEAST_SAMPLES = 5
# Isolation Forest's default when the article was written; scikit-learn's present default is a
# fixed threshold.
_FOREST_CONTAMINATION = 0.1
_FORMAT = 1
_FOLDER = 'oneclass'


def run_article(
    output: Path,
    *,
    splits: int = 20,
    seed: int = 0,
    folder: Path | None = None,
    names: Sequence[str] = (),
    noise_levels: Sequence[int] = NOISE_LEVELS,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run what ``output/article.json`` lacks yet; write that file and ``article.md``.

    The files are brought up to date after each cell (data set, class and noise level), so a
    stopped run can be continued. Each cell has its own seed, so order does not matter.

    Args:
        output: directory of the results.
        splits: random splits per cell.
        seed: of everything random.
        folder: where the CSV files are; default: ``oneclass``, see :func:`.data_folder`.
        names: the data sets to run; all if empty.
        noise_levels: outliers in percent of the targets.
        progress: called with (cells done, cells in all).

    Raises:
        OccError: a name is unknown, ``splits`` is not positive, or the directory holds results
            of other settings.
    """
    known = [benchmark.name for benchmark in BENCHMARKS]
    for name in names:
        if name not in known:
            raise OccError(f'there is no data set {name!r}; allowed are {", ".join(known)}')
    if splits < 1:
        raise OccError(f'splits is {splits}; allowed is 1 or more')
    settings = {
        'format': _FORMAT,
        'splits': splits,
        'seed': seed,
        'nus': list(NUS),
        'tuning': {
            benchmark.name: {
                'folds': benchmark.folds,
                'used_folds': benchmark.used_folds or benchmark.folds,
                'alphas': list(benchmark.alphas),
            }
            for benchmark in BENCHMARKS
        },
    }
    cells = earlier_results(output / 'article.json', settings).get('cells', {})
    skipped: dict[str, str] = {}
    todo = []
    for benchmark in BENCHMARKS:
        if names and benchmark.name not in names:
            continue
        try:
            values, classes = load_benchmark(benchmark, folder or data_folder(_FOLDER))
        except OccError as error:
            skipped[benchmark.name] = str(error)
            continue
        for target in (None, *benchmark.classes.values()):
            todo += [(benchmark, values, classes, target, noise) for noise in noise_levels]
    todo.sort(key=lambda item: item[3] is not None)  # approach A first
    result = {
        'settings': settings,
        'skipped': skipped,
        'cells': cells,
        'machine': machine(),
        'versions': versions(('numpy', 'scipy', 'scikit-learn')),
    }
    for number, (benchmark, values, classes, target, noise) in enumerate(todo):
        title = benchmark.name if target is None else f'{benchmark.name} {target}'
        key = f'{title}, {noise} %'
        if key not in cells:
            # Not hash(): that differs from process to process.
            rng = np.random.default_rng([seed, noise, *key.encode()])
            cells[key] = {
                'approach': 'A' if target is None else 'B',
                'target': title,
                'noise_percent': noise,
                **_run_cell(benchmark, values, classes, target, noise, splits, rng),
            }
            write_results(output, 'article', result)
        progress(number + 1, len(todo))
    write_results(output, 'article', result, markdown(cells))
    return result


def at_most_outside(tree: Node, total: int, nu: float) -> Node:
    """Return the tree as the stop by a smaller ``nu`` would have left it.

    The stop undoes the first level that leaves more than ``nu`` outside, so the trees of several
    nu are the first levels of one. That saves a fit for each value of the grid.

    Args:
        tree: a tree grown with a larger nu.
        total: number of samples it was grown on.
        nu: the smaller value.
    """
    depth, leaves, level = 0, 0, [(total, tree)]
    while any(node.branches for _, node in level):
        leaves += sum(samples for samples, node in level if not node.branches)
        level = [(branch.samples, branch.node) for _, node in level for branch in node.branches]
        covered = leaves + sum(samples for samples, _ in level)
        if oversteps(covered, total, nu):
            break
        depth += 1
    return _first_levels(tree, depth)


def _first_levels(node: Node, depth: int) -> Node:
    if depth == 0 or node.feature is None:
        return Node()
    branches = (
        replace(branch, node=_first_levels(branch.node, depth - 1)) for branch in node.branches
    )
    return Node(node.feature, tuple(branches))


# One way of fitting gives, per choice of parameters, a function that judges rows.
_Judges = dict[tuple[float, ...], Callable[[np.ndarray], np.ndarray]]


def _trees(alphas: Sequence[float], nus: Sequence[float], training: np.ndarray) -> _Judges:
    judges: _Judges = {}
    for alpha in alphas:
        beta = max(OCTreeSettings.article().beta, _LEAST_SAMPLES / len(training))
        settings = OCTreeSettings.article(alpha=alpha, beta=beta, nu=max(nus))
        tree = fit_tree(training, settings)
        for nu in nus:
            judges[alpha, nu] = at_most_outside(tree, len(training), nu).contains
    return judges


def _support_vectors(nus: Sequence[float], training: np.ndarray) -> _Judges:
    judges: _Judges = {}
    for nu in nus:
        model = make_pipeline(StandardScaler(), OneClassSVM(nu=nu)).fit(training)
        judges[(nu,)] = lambda rows, model=model: model.predict(rows) > 0
    return judges


def _forest(seed: int, training: np.ndarray) -> _Judges:
    model = IsolationForest(contamination=_FOREST_CONTAMINATION, random_state=seed).fit(training)
    return {(): lambda rows: model.predict(rows) > 0}


def _run_cell(
    benchmark: Benchmark,
    values: np.ndarray,
    classes: np.ndarray,
    target: str | None,
    noise: int,
    splits: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    start = time.perf_counter()
    scores: dict[str, list[tuple[float, float, float]]] = {method: [] for method in METHODS}
    choices: dict[str, list[tuple[float, ...]]] = {'oc_tree': [], 'ocsvm': []}
    for _ in range(splits):
        drawn = rng.permutation(len(values))[: benchmark.rows]
        rows, truth = contaminate(values[drawn], classes[drawn], target, noise, rng)
        cut = round(len(rows) * 2 / 3)
        training, labels, judged, expected = rows[:cut], truth[:cut], rows[cut:], truth[cut:]
        folds = list(_folds(len(training), benchmark.folds, rng))[: benchmark.used_folds]
        fits: dict[str, Callable[..., _Judges]] = {
            'oc_tree': lambda part, choice=None: _trees(
                benchmark.alphas if choice is None else choice[:1],
                NUS if choice is None else choice[1:],
                part,
            ),
            'ocsvm': lambda part, choice=None: _support_vectors(
                NUS if choice is None else choice, part
            ),
        }
        for method, fit in fits.items():
            choice = _tune(fit, training, labels, folds)
            choices[method].append(choice)
            scores[method].append(rate(fit(training, choice)[choice](judged), expected))
        forest = _forest(int(rng.integers(2**31)), training)[()]
        scores['isolation_forest'].append(rate(forest(judged), expected))
    return {
        'methods': {method: _summary(values) for method, values in scores.items()},
        'chosen': {
            'alpha': _mean([alpha for alpha, _ in choices['oc_tree']]),
            'nu': _mean([nu for _, nu in choices['oc_tree']]),
            'ocsvm_nu': _mean([nu for (nu,) in choices['ocsvm']]),
        },
        'seconds': round(time.perf_counter() - start, 1),
    }


def _folds(
    count: int, parts: int, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield (fitted, validated) masks of a cross-validation."""
    place = rng.permutation(count) % parts
    for part in range(parts):
        yield place != part, place == part


def _tune(
    fit: Callable[..., _Judges],
    training: np.ndarray,
    labels: np.ndarray,
    folds: Sequence[tuple[np.ndarray, np.ndarray]],
) -> tuple[float, ...]:
    """Return the choice of parameters with the largest mean F1 over the folds."""
    total: dict[tuple[float, ...], float] = {}
    for fitted, validated in folds:
        for choice, judge in fit(training[fitted]).items():
            f1 = rate(judge(training[validated]), labels[validated])[2]
            total[choice] = total.get(choice, 0.0) + f1
    return max(total, key=lambda choice: total[choice])


def rate(accepted: np.ndarray, truth: np.ndarray) -> tuple[float, float, float]:
    """Return precision, recall and F1 with the targets as positives; 0 where undefined."""
    hits = int(np.sum(accepted & truth))
    precision = hits / max(int(accepted.sum()), 1)
    recall = hits / max(int(truth.sum()), 1)
    return precision, recall, 2 * hits / max(int(accepted.sum() + truth.sum()), 1)


def _summary(scores: Sequence[tuple[float, float, float]]) -> dict[str, dict[str, float]]:
    table = np.array(scores)
    deviations = table.std(axis=0, ddof=1) if len(table) > 1 else np.zeros(3)
    return {
        measure: {'mean': round(float(mean), 4), 'std': round(float(deviation), 4)}
        for measure, mean, deviation in zip(
            ('precision', 'recall', 'f1'), table.mean(axis=0), deviations, strict=True
        )
    }


def _mean(values: Sequence[float]) -> float:
    return round(float(np.mean(values)), 4)
