# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Other ways to learn from demonstrations which states are unsafe, for comparison.

Each gives a function from states to flags. What learns by training agents is in
:mod:`~experiments.inverse_learning`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

Flags = Callable[[np.ndarray], np.ndarray]
"""Maps (n, k) states to (n,) bool, which of them it takes for unsafe."""

OUTLIERS = 0.01
"""Share of the samples that learners without a default of their own take for outliers."""

# Rows that a support vector machine can bear.
_SVM_ROWS = 4_000
# Facets of a hull grow exponentially with its dimensions.
_HULL_DIMENSIONS = 4


def minimum_and_maximum(values: np.ndarray) -> Flags:
    """Flag what lies outside the demonstrated range of any feature.

    Args:
        values: (n, k) demonstrated samples.
    """
    low, high = values.min(axis=0), values.max(axis=0)
    return lambda rows: ((rows < low) | (rows > high)).any(axis=1)


def isolation_forest(values: np.ndarray) -> Flags:
    """Flag as scikit-learn's IsolationForest does (Liu, Ting and Zhou 2008).

    Args:
        values: (n, k) demonstrated samples.
    """
    from sklearn.ensemble import IsolationForest

    model = IsolationForest(random_state=0, n_jobs=1, contamination=OUTLIERS).fit(values)
    return lambda rows: model.predict(rows) < 0


def one_class_svm(values: np.ndarray) -> Flags:
    """Flag as scikit-learn's OneClassSVM does (Schölkopf et al. 2001), on standardised features.

    Args:
        values: (n, k) demonstrated samples.
    """
    from sklearn.svm import OneClassSVM

    rng = np.random.default_rng(0)
    rows = values[rng.choice(len(values), min(len(values), _SVM_ROWS), replace=False)]
    mean, deviation = values.mean(axis=0), values.std(axis=0) + 1e-12
    model = OneClassSVM(nu=OUTLIERS, gamma='scale').fit((rows - mean) / deviation)
    return lambda rows: model.predict((rows - mean) / deviation) < 0


@dataclass(frozen=True, eq=False)
class HullOfMeans:
    """The convex hull of the feature means of episodes (CoCoRL, Lindner et al. 2024).

    It is a set of means, not of states: an episode is safe while the mean of its states so far
    lies in it. Beyond four dimensions a hull has too many facets, so it is one of the principal
    directions in which the means differ most; others are not bounded.

    Attributes:
        directions: (d, k) orthonormal rows.
        normals: (f, d) outward normals of the facets.
        offsets: (f,): a point x is inside where ``normals @ x + offsets <= 0``.
    """

    directions: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray, episodes: np.ndarray) -> HullOfMeans:
        """Return the hull of demonstrations.

        Args:
            values: (n, k) demonstrated samples.
            episodes: (n,) the episode each belongs to; more of them than dimensions of the hull.
        """
        names, inverse, lengths = np.unique(episodes, return_inverse=True, return_counts=True)
        sums = np.zeros((len(names), values.shape[1]))
        np.add.at(sums, inverse, values)
        means = sums / lengths[:, None]
        _, sizes, directions = np.linalg.svd(means - means.mean(axis=0), full_matrices=False)
        wide = int((sizes > 1e-9 * sizes[0]).sum())
        directions = directions[: min(wide, _HULL_DIMENSIONS, len(names) - 1)]
        points = means @ directions.T
        if len(directions) == 1:
            # What a hull is in one dimension; qhull needs two.
            return cls(
                directions, np.array([[-1.0], [1.0]]), np.array([points.min(), -points.max()])
            )
        facets = ConvexHull(points, qhull_options='QJ').equations
        return cls(directions, facets[:, :-1], facets[:, -1])

    def outside(self, means: np.ndarray) -> np.ndarray:
        """Tell for each of (n, k) means whether it lies outside: (n,) bool."""
        distances = means @ self.directions.T @ self.normals.T + self.offsets
        return (distances > 1e-9).any(axis=1)

    def flags(self, values: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Flag states of episodes while the mean so far lies outside.

        Args:
            values: (n, k) states, those of an episode in the order of time.
            episodes: (n,) the episode each belongs to.

        Returns:
            (n,) bool.
        """
        flagged = np.zeros(len(values), dtype=bool)
        for name in np.unique(episodes):
            rows = np.flatnonzero(episodes == name)
            means = np.cumsum(values[rows], axis=0) / np.arange(1, len(rows) + 1)[:, None]
            flagged[rows] = self.outside(means)
        return flagged


STATIC: dict[str, Callable[[np.ndarray], Flags]] = {
    'minimum and maximum': minimum_and_maximum,
    'Isolation Forest': isolation_forest,
    'one-class SVM': one_class_svm,
}
"""The baselines that judge single states, by name: demonstrated samples to flags."""

HULL = 'hull of means'
"""Name of :class:`HullOfMeans`."""
