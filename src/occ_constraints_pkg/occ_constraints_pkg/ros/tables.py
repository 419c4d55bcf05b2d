# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the columns of our tables mean, and their way to and from the values in the code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occ_constraints_pkg.errors import InputError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules.ruleset import RuleCounts
from occ_constraints_pkg.rules.verdict import Judgement
from occ_constraints_pkg.worlds.base import Column
from occ_constraints_pkg.worlds.stream import StepBatch

STEP_COLUMNS = ('reward', 'terminated', 'truncated', 'episode', 'true_cost')
COST_COLUMNS = ('cost', 'verdict', 'margin', 'rule')
RULE_COLUMNS = ('evaluated', 'violated')


def observation_table(columns: Sequence[Column], batch: StepBatch) -> Table:
    """Return a step as the table that ``observation`` carries: float32, one row per robot.

    An episode's number is exact in float32 up to 16.7 million.
    """
    names = (*(column.name for column in columns), *STEP_COLUMNS)
    values = np.empty((len(batch.reward), len(names)), dtype=np.float32)
    values[:, : len(columns)] = batch.observation
    for place, name in enumerate(STEP_COLUMNS, start=len(columns)):
        values[:, place] = getattr(batch, name)
    return Table(names, values)


def step_batch(table: Table) -> StepBatch:
    """Return the step that an observation table carries.

    Raises:
        OccError: the table does not end in the columns of a step.
    """
    size = len(STEP_COLUMNS)
    if table.names[-size:] != STEP_COLUMNS:
        raise InputError(
            f'an observation table must end in the columns {", ".join(STEP_COLUMNS)}; '
            f'this one has {", ".join(table.names)}'
        )
    reward, terminated, truncated, episode, true_cost = table.values[:, -size:].T
    return StepBatch(
        table.values[:, :-size],
        reward.astype(np.float64),
        terminated > 0,
        truncated > 0,
        episode.astype(np.int64),
        true_cost.astype(np.float64),
    )


def action_table(columns: Sequence[Column], action: np.ndarray) -> Table:
    """Return actions (N, a) as the table that ``action`` carries: float32."""
    return Table(tuple(column.name for column in columns), np.asarray(action, dtype=np.float32))


def costs_table(judgement: Judgement) -> Table:
    """Return a judgement as the table that ``costs`` carries: float64, one row per robot."""
    values = np.empty((len(judgement.verdict), len(COST_COLUMNS)))
    columns = (judgement.cost, judgement.verdict, judgement.margin, judgement.rule)
    for place, column in enumerate(columns):
        values[:, place] = column
    return Table(COST_COLUMNS, values)


def training_table(metrics: Mapping[str, float]) -> Table:
    """Return the metrics of an update as the table that ``training`` carries: float64, one row."""
    return Table(tuple(metrics), np.array([list(metrics.values())], dtype=np.float64))


def rule_stats_table(counts: RuleCounts) -> Table:
    """Return counters as the table that ``rule_stats`` carries: float64, one row per rule."""
    columns = (counts.evaluated, counts.violated)
    return Table(RULE_COLUMNS, np.stack(columns, axis=1).astype(np.float64))
