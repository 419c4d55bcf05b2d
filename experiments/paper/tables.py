# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From lines of the store to cells of tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.evaluation import half_width

from experiments.paper.jobs import Job

Lines = Mapping[str, Mapping[str, Any]]
"""Lines of the store by the id of their run."""

MISSING = 'not yet'
"""What a table says where no run has been made."""


def results_of(lines: Lines, jobs: Iterable[Job]) -> list[dict[str, Any]]:
    """Return the results of those runs that the store has."""
    return [lines[job.id]['result'] for job in jobs if job.id in lines]


def interval(values: Sequence[float | None], digits: int = 1) -> str:
    """Return mean and half the width of its 95 % interval over runs; the mean alone of one run.

    Args:
        values: one per run; undefined ones are left out.
        digits: after the point.
    """
    known = np.array([value for value in values if value is not None])
    if not len(known):
        return '-'
    mean = f'{known.mean():.{digits}f}'
    if len(known) == 1:
        return mean
    return f'{mean} ± {half_width(known):.{digits}f}'


def acted(results: Sequence[Mapping[str, Any]], acting: str, name: str, digits: int = 1) -> str:
    """Return a number of policies with its interval, or that there is none yet.

    Args:
        results: of trainings.
        acting: ``sampled`` or ``mean`` actions.
        name: ``return`` or ``cost``.
        digits: after the point.
    """
    if not results:
        return MISSING
    return interval([item[acting][name] for item in results], digits)
