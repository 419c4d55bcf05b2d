# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The data sets of the OC-tree article's benchmark."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from occ_constraints_pkg.errors import OccError
from sklearn.datasets import load_iris

ALPHAS = (0.5, 0.6, 0.7, 0.8)


@dataclass(frozen=True)
class Benchmark:
    """One data set of the article and how much tuning is affordable on it.

    Attributes:
        name: as in our tables.
        file: CSV file, ``None`` for scikit-learn's own Iris.
        label: column of the class.
        classes: the article's name of each class by its label in the file.
        folds: folds of the cross-validation; the article has 10.
        used_folds: how many of them are carried out; ``None`` for all.
        alphas: the grid of alpha; the article's is :data:`ALPHAS`.
        rows: number of rows drawn anew for each split; ``None`` for all.
    """

    name: str
    file: str | None
    label: str
    classes: Mapping[str, str]
    folds: int
    alphas: tuple[float, ...] = ALPHAS
    used_folds: int | None = None
    rows: int | None = None


BENCHMARKS = (
    Benchmark('Iris', None, '', {'0': '1', '1': '2', '2': '3'}, 10),
    # The sizes of the article's classes tell which is which: 126 of Ionosphere, 268 of Pima are -1.
    Benchmark('Pima', 'pima.csv', 'label', {'anomaly': '-1', 'nominal': '+1'}, 5, (0.5,)),
    Benchmark(
        'Ionosphere', 'ionosphere.csv', 'label', {'anomaly': '-1', 'nominal': '+1'}, 3, (0.5,)
    ),
    # The article uses the 4435 rows of the training file.
    Benchmark(
        'Satimage',
        'satimage.csv',
        'class',
        {str(number): str(number + 1) for number in range(6)},
        3,
        (0.5,),
        used_folds=1,
        rows=4435,
    ),
)


def load_benchmark(benchmark: Benchmark, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the values (n, k) and the article's class names (n,) of a data set.

    Raises:
        OccError: the file is missing or has an unknown class.
    """
    if benchmark.file is None:
        values, labels = load_iris(return_X_y=True)
        names = [str(label) for label in labels]
    else:
        path = folder / benchmark.file
        try:
            with path.open(encoding='utf-8', newline='') as stream:
                rows = list(csv.DictReader(stream))
        except OSError as error:
            raise OccError(f'cannot read {path}: {error.strerror}') from error
        # A column without a name numbers the rows.
        columns = [name for name in rows[0] if name not in ('', benchmark.label)]
        values = np.array([[float(row[name]) for name in columns] for row in rows])
        names = [row[benchmark.label] for row in rows]
    unknown = set(names) - set(benchmark.classes)
    if unknown:
        raise OccError(
            f'{benchmark.name} has class {min(unknown)!r}; allowed are '
            f'{", ".join(map(str, benchmark.classes))}'
        )
    return values, np.array([benchmark.classes[name] for name in names])


def contaminate(
    values: np.ndarray,
    classes: np.ndarray,
    target: str | None,
    noise_percent: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return shuffled rows (m, k) and which of them are targets (m,).

    Args:
        values: (n, k) the data set.
        classes: (n,) class of each row.
        target: the target class (approach B), or ``None`` for all (approach A).
        noise_percent: outliers to add, in percent of the targets.
        rng: draws the outliers and the order.
    """
    if target is None:
        targets = values
        count = round(len(targets) * noise_percent / 100)
        outliers = rng.uniform(values.min(axis=0), values.max(axis=0), (count, values.shape[1]))
    else:
        targets = values[classes == target]
        count = round(len(targets) * noise_percent / 100)
        outliers = rng.choice(values[classes != target], count, replace=False)
    rows = np.concatenate([targets, outliers])
    truth = np.arange(len(rows)) < len(targets)
    order = rng.permutation(len(rows))
    return rows[order], truth[order]
