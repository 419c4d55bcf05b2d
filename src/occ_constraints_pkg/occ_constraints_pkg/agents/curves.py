# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Curves of trainings, made with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from occ_constraints_pkg.picture_style import (
    FIGURE_WIDTH,
    NEUTRAL,
    SAFE,
    VIOLATED,
    draw_runs,
    legend_below,
    run_handles,
    save_figure,
)


def draw_training(
    path: Path,
    histories: Sequence[Sequence[Mapping[str, Any]]],
    cost_limit: float | None,
    *,
    cost_name: str = 'cost',
) -> None:
    """Draw return, cost and multiplier over steps to a file; see :func:`training_figure`.

    Args:
        path: PNG file to write.
        histories: the lines of the metrics file of each seed.
        cost_limit: drawn as a line; ``None``: no limit.
        cost_name: name of the cost.

    Raises:
        OccError: the file cannot be written.
    """
    save_figure(training_figure(histories, cost_limit, cost_name=cost_name), path)


def training_figure(
    histories: Sequence[Sequence[Mapping[str, Any]]],
    cost_limit: float | None,
    *,
    cost_name: str = 'cost',
) -> Figure:
    """Return a figure of return, cost and multiplier over steps: each seed, and their mean.

    Missing values are left out. Seeds are compared update by update, up to the end of the shortest.

    Args:
        histories: the lines of the metrics file of each seed.
        cost_limit: drawn as a line; ``None``: no limit.
        cost_name: name of the cost.
    """
    length = min(map(len, histories))
    steps = _column(histories, 'steps', length).mean(axis=0) / 1e6
    figure, axes = plt.subplots(
        1, 3, figsize=(FIGURE_WIDTH, 3.1), layout='constrained', sharex=True
    )
    panels = (
        ('mean_return', 'return per episode', SAFE),
        ('mean_cost', f'{cost_name} per episode', VIOLATED),
        ('multiplier', 'Lagrange multiplier', NEUTRAL),
    )
    for axis, (key, title, colour) in zip(axes, panels, strict=True):
        draw_runs(axis, steps, _column(histories, key, length), colour)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel('million robot steps', fontsize=9)
        axis.tick_params(labelsize=8.5)
        axis.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axis.grid(alpha=0.3)
    handles = run_handles(len(histories))
    if cost_limit is not None:
        axes[1].axhline(cost_limit, color='black', ls='--', lw=1)
        handles.append(Line2D([], [], color='black', ls='--', lw=1, label='cost limit'))
    for axis in axes[1:]:
        # Neither is ever negative; the top leaves room also where all are 0.
        axis.set_ylim(0.0, max(axis.get_ylim()[1], 1e-3))
    axes[0].set_xlim(0.0, steps[-1])
    figure.suptitle('Training: return and cost are means of the latest episodes', fontsize=11)
    if handles:
        legend_below(figure, handles)
    return figure


def _column(histories: Sequence[Sequence[Mapping[str, Any]]], key: str, length: int) -> np.ndarray:
    """Return (seeds, length) float64; what a file holds as null is NaN."""
    return np.array(
        [
            [np.nan if line[key] is None else line[key] for line in lines[:length]]
            for lines in histories
        ],
        dtype=np.float64,
    )
