# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Table and figure of the driving experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from occ_constraints_pkg.agents.evaluation import half_width
from occ_constraints_pkg.files import PICTURE, replacing
from scipy.special import ndtri

from experiments.results import markdown_table

RATES = {'collision': 'collision rate', 'off_road': 'off-road rate'}
_COLOURS = {'RL': '#888888', 'RL with engineered reward': '#c8862b', 'ours': '#3b6ea5'}
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
    sets = list(dict.fromkeys(line['set'] for line in lines))
    figure, axes = plt.subplots(
        3, len(sets), figsize=(4.6 * len(sets), 7.2), squeeze=False, sharex=True, sharey='row'
    )
    for column, name in enumerate(sets):
        for agent, colour in _COLOURS.items():
            curves = [x['curve'] for x in lines if (x['set'], x['agent']) == (name, agent)]
            if curves:
                _draw_agent(axes[:, column], curves, agent, colour)
        axes[0, column].set_title(f'{name} set', fontsize=10)
        axes[2, column].set_xlabel('million robot steps')
    for axis, label in zip(axes[:, 0], ('return', *RATES.values()), strict=True):
        axis.set_ylabel(label)
    for axis in axes[1:].ravel():
        axis.set_yscale('symlog', linthresh=0.01)
        axis.set_ylim(0.0, 1.0)
        axis.set_yticks([0.0, 0.01, 0.1, 1.0], ['0', '1 %', '10 %', '100 %'])
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    if axes[0, 0].get_lines():
        axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=100, format='png')
    plt.close(figure)


def _draw_agent(
    axes: Sequence[Axes], curves: Sequence[Sequence[Mapping[str, float]]], agent: str, colour: str
) -> None:
    """Draw the mean over seeds, and their range, in each of three axes."""
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
        axis.plot(steps, values.mean(axis=0), color=colour, label=agent, lw=1.3)
        axis.fill_between(
            steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.2, lw=0
        )
