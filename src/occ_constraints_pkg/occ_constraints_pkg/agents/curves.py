# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Curves of trainings, made with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt

from occ_constraints_pkg.agents.evaluation import half_width
from occ_constraints_pkg.files import PICTURE, replacing

_BLUE, _RED, _GREY = '#3b6ea5', '#c8362b', '#555555'
_DOTS_PER_INCH = 110


def draw_training(
    path: Path,
    histories: Sequence[Sequence[Mapping[str, Any]]],
    cost_limit: float | None,
    *,
    cost_name: str = 'cost',
) -> None:
    """Draw return, cost and multiplier over steps: mean of the seeds and its 95 % interval.

    Missing values are left out. Seeds are compared update by update, up to the end of the shortest.

    Args:
        path: PNG file to write.
        histories: the lines of the metrics file of each seed.
        cost_limit: drawn as a line; ``None``: no limit.
        cost_name: name of the cost.

    Raises:
        OccError: the file cannot be written.
    """
    length = min(map(len, histories))
    steps = _column(histories, 'steps', length).mean(axis=0) / 1e6
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.4))
    panels = (
        ('mean_return', 'return per episode', _BLUE),
        ('mean_cost', f'{cost_name} per episode', _RED),
        ('multiplier', 'Lagrange multiplier', _GREY),
    )
    for axis, (key, title, colour) in zip(axes, panels, strict=True):
        values = _column(histories, key, length)
        mean = values.mean(axis=0)
        axis.plot(steps, mean, color=colour)
        if len(values) > 1:
            half = np.array([half_width(column) for column in values.T])
            axis.fill_between(steps, mean - half, mean + half, color=colour, alpha=0.25, lw=0)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel('million robot steps')
        axis.grid(alpha=0.3)
    if cost_limit is not None:
        axes[1].axhline(cost_limit, color='black', ls='--', lw=1)
        axes[1].text(steps[-1], cost_limit, 'limit ', ha='right', va='bottom', fontsize=8)
    if len(histories) > 1:
        figure.text(
            0.995, 0.01, f'mean and 95 % interval of {len(histories)} seeds', ha='right', fontsize=7
        )
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=_DOTS_PER_INCH, format='png')
    plt.close(figure)


def _column(histories: Sequence[Sequence[Mapping[str, Any]]], key: str, length: int) -> np.ndarray:
    """Return (seeds, length) float64; what a file holds as null is NaN."""
    return np.array(
        [
            [np.nan if line[key] is None else line[key] for line in lines[:length]]
            for lines in histories
        ],
        dtype=np.float64,
    )
