# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learning beside scikit-learn's Isolation Forest, on a million samples of twenty features."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
from occ_constraints_pkg.learning.estimator import OCTreeClassifier
from sklearn.ensemble import IsolationForest

_ROWS, _FEATURES, _DEPTH = 1_000_000, 20, 10
_MOST_ROUNDS = 5


def run(seconds: float = 30.0) -> dict[str, Any]:
    """Time fits, by turns, so that a change of the machine's load meets both.

    Ours cuts ten features with a stated share outside; with an estimated one hardly anything of
    such even samples is cut. All run in one thread, and the times are processor times. The forest
    fits and scores, for its fit alone looks at 256 samples of each tree only.

    Args:
        seconds: after this time no round is begun, but there are at least two.
    """
    rows = make_rows(_ROWS)
    ours, estimating, forest = [], [], []
    start = time.perf_counter()
    while len(ours) < 2 or (time.perf_counter() - start < seconds and len(ours) < _MOST_ROUNDS):
        ours.append(processor_time(lambda: OCTreeClassifier(max_depth=_DEPTH).fit(rows)))
        detector = OCTreeClassifier(max_depth=_DEPTH, most_outside=None)
        estimating.append(processor_time(lambda detector=detector: detector.fit(rows)))
        forest.append(
            processor_time(lambda: IsolationForest(random_state=0).fit(rows).score_samples(rows))
        )
    fit, peer = float(np.median(ours)), float(np.median(forest))
    return {
        'metrics': {
            'fit_s': fit,
            'fit_estimating_s': float(np.median(estimating)),
            'fit_per_isolation_forest_ratio': fit / peer,
            'peak_memory_per_input_ratio': _peak_memory() / rows.nbytes,
        },
        'peers': {'isolation_forest_fit_and_score_s': peer},
        'settings': {
            'rows': _ROWS,
            'features': _FEATURES,
            'max_depth': _DEPTH,
            'rounds': len(ours),
            'memory': 'largest total of tracemalloc during a fit, input included',
        },
    }


def make_rows(rows: int) -> np.ndarray:
    """Return (rows, 20) standard normal samples, always the same."""
    return np.random.default_rng(0).normal(size=(rows, _FEATURES))


def processor_time(call: Callable[[], Any]) -> float:
    """Return the processor time of a call in s, of all threads together."""
    start = time.process_time()
    call()
    return time.process_time() - start


def _peak_memory() -> int:
    tracemalloc.start()
    rows = make_rows(_ROWS)
    OCTreeClassifier(max_depth=_DEPTH).fit(rows)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak
