# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Judged recordings for the tests of pages."""

import numpy as np
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.datasets.dataset import Dataset


def drives(rule_set, *, recordings=2, samples=400, seed=0):
    """Return judged recordings at 20 Hz of a robot that sometimes is too fast or too near."""
    rng = np.random.default_rng(seed)
    time = np.tile(np.arange(samples) * 0.05, recordings)
    phase = np.repeat(rng.uniform(0, 6, recordings), samples)
    speed = 0.5 + 0.55 * np.sin(time + phase)
    near = 2.0 + 1.8 * np.cos(0.7 * time + phase)
    values = np.column_stack([speed, near, near + 0.2])
    values[::97, 0] = np.nan
    episodes = np.repeat(np.arange(recordings), samples)
    data = Dataset(
        names=rule_set.space.names,
        values=values,
        episodes=episodes,
        stamps_ns=(time * 1e9).astype(np.int64),
        true_cost=None,
        times_ns=(time * 1e9).astype(np.int64),
        recordings=episodes,
        sources=tuple({'name': f'drive_{i}', 'sha256': f'{i:064x}'} for i in range(recordings)),
    )
    return check_data(data, rule_set)
