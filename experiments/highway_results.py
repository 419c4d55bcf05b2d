# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Table and figure of the driving experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from occ_constraints_pkg.agents.evaluation import half_width
from occ_constraints_pkg.picture_style import (
    FIGURE_WIDTH,
    draw_runs,
    legend_below,
    run_handles,
    save_figure,
)
from scipy.special import ndtri

from experiments.results import markdown_table

RATES = {'collision': 'collision rate', 'off_road': 'off-road rate'}
_COLOURS = {'RL': '#888888', 'RL with engineered reward': '#e69f00', 'ours': '#0072b2'}
# Where curves cross, the colour is not all that tells them apart.
_STYLES = {'RL': '-.', 'RL with engineered reward': '--', 'ours': '-'}
# Updates over which a point of a curve is taken.
_WINDOW = 8


def wilson(count: float, total: float) -> tuple[float, float]:
    """Return the 95 % interval of a rate, after Wilson.

    Args:
        count: how often it happened.
        total: of how many times.
    """
    z = float(ndtri(0.975))
    rate, weight = count / total, z * z / total
    middle = (rate + weight / 2) / (1 + weight)
    half = z / (1 + weight) * np.sqrt(rate * (1 - rate) / total + weight / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def summary(lines: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Sum up the trainings of each agent on each set.

    Args:
        lines: one per training, as :func:`~experiments.highway.run_highway` makes them.

    Returns:
        One line per set, agent and way of acting (``sampled`` or ``mean``): rates over the episodes
        of all seeds with their 95 % intervals, the mean return with its interval over seeds.
    """
    result = []
    groups = list(dict.fromkeys((line['set'], line['agent']) for line in lines))
    for acting in ('sampled', 'mean'):
        for group in groups:
            parts = [x[acting] for x in lines if (x['set'], x['agent']) == group]
            episodes = sum(part['episodes'] for part in parts)
            returns = np.array([part['return'] for part in parts])
            half = half_width(returns)
            row = {'set': group[0], 'agent': group[1], 'acting': acting, 'seeds': len(parts)}
            row |= {'episodes': episodes, 'return': float(returns.mean())}
            row['return_ci95'] = half if np.isfinite(half) else None
            for name in RATES:
                count = sum(part[name] for part in parts)
                row[name] = count / episodes
                row[f'{name}_interval'] = list(wilson(count, episodes))
            result.append(row)
    return result


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the summary as a Markdown table, rates in percent with their 95 % intervals."""
    table = []
    for row in rows:
        half = '' if row['return_ci95'] is None else f' ± {row["return_ci95"]:.1f}'
        entries = [row['set'], row['agent'], row['acting'], f'{row["return"]:.1f}{half}']
        for name in RATES:
            low, high = row[f'{name}_interval']
            entries.append(f'{100 * row[name]:.1f} % ({100 * low:.1f} to {100 * high:.1f})')
        table.append(entries)
    heads = ['set', 'agent', 'actions', 'return', *RATES.values()]
    return markdown_table(heads, table) + '\n'


def draw_curves(path: Path, lines: Sequence[Mapping[str, Any]]) -> None:
    """Draw return, collision rate and off-road rate during training, a column for each set.

    Args:
        path: PNG file to write.
        lines: one per training, with its ``curve``.

    Raises:
        OccError: the file cannot be written.
    """
    save_figure(curves_figure(lines), path)


def curves_figure(lines: Sequence[Mapping[str, Any]]) -> Figure:
    """Return a figure of return, collision rate and off-road rate during training.

    Args:
        lines: one per training, with its ``curve``.
    """
    sets = list(dict.fromkeys(line['set'] for line in lines))
    figure, axes = plt.subplots(
        3, len(sets), figsize=(FIGURE_WIDTH, 7.6), squeeze=False, sharex=True, sharey='row',
        layout='constrained',
    )  # fmt: skip
    for column, name in enumerate(sets):
        for agent in _COLOURS:
            curves = [x['curve'] for x in lines if (x['set'], x['agent']) == (name, agent)]
            if curves:
                _draw_agent(axes[:, column], curves, agent)
        axes[0, column].set_title(f'{name} set', fontsize=10)
        axes[2, column].set_xlabel('million robot steps')
    for axis, label in zip(axes[:, 0], ('return per episode', *RATES.values()), strict=True):
        axis.set_ylabel(label)
    for axis in axes[1:].ravel():
        axis.set_yscale('symlog', linthresh=0.01)
        axis.set_ylim(0.0, 1.0)
        axis.set_yticks([0.0, 0.01, 0.1, 1.0], ['0', '1 %', '10 %', '100 %'])
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
        axis.set_xlim(left=0.0)
    figure.suptitle('Training on the highway, over the episodes that ended lately', fontsize=11)
    agents = [agent for agent in _COLOURS if any(line['agent'] == agent for line in lines)]
    handles = [
        Line2D([], [], color=_COLOURS[agent], ls=_STYLES[agent], lw=1.8, label=agent)
        for agent in agents
    ]
    seeds = max(
        sum((x['set'], x['agent']) == (name, agent) for x in lines)
        for name in sets
        for agent in agents
    )
    legend_below(figure, [*handles, *run_handles(seeds)], columns=3)
    return figure


def _draw_agent(
    axes: Sequence[Axes], curves: Sequence[Sequence[Mapping[str, float]]], agent: str
) -> None:
    """Draw each seed, and their mean, in each of three axes."""
    length = min(map(len, curves))
    if length <= _WINDOW:
        return
    names = ('steps', 'episodes', 'return', *RATES)
    # (seeds, updates, names), counted since the beginning.
    totals = np.array([[[line[n] for n in names] for line in c[:length]] for c in curves])
    ended = totals[:, _WINDOW:, 1:] - totals[:, :-_WINDOW, 1:]
    with np.errstate(invalid='ignore'):
        shares = ended[..., 1:] / ended[..., :1]
    steps = totals[:, _WINDOW:, 0].mean(axis=0) / 1e6
    for axis, values in zip(axes, np.moveaxis(shares, -1, 0), strict=True):
        draw_runs(axis, steps, values, _COLOURS[agent], style=_STYLES[agent])
