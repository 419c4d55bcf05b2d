# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How the time to learn grows from a hundred thousand samples to ten million (1.6 GB)."""

from __future__ import annotations

from typing import Any

import numpy as np
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import OCTreeSettings

from benchmarks.learn import make_rows, processor_time

_ROWS = (100_000, 1_000_000, 10_000_000)
_SETTINGS = OCTreeSettings(max_depth=10, contamination=0.01)


def run(seconds: float = 0.0) -> dict[str, Any]:
    """Time one fit of each size, of small ones the fastest of three.

    Args:
        seconds: has no effect; the work is what it is.
    """
    times = {}
    for rows in _ROWS:
        samples = make_rows(rows)
        rounds = 1 if rows == max(_ROWS) else 3
        times[rows] = min(
            processor_time(lambda samples=samples: fit_safe_set(samples, _SETTINGS))
            for _ in range(rounds)
        )
    few, most = min(_ROWS), max(_ROWS)
    return {
        'metrics': {
            **{f'fit_{rows}_rows_s': value for rows, value in times.items()},
            'growth_exponent': float(np.log(times[most] / times[few]) / np.log(most / few)),
        },
        'peers': {},
        'settings': {'features': samples.shape[1], 'max_depth': _SETTINGS.max_depth},
    }
