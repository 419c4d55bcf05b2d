# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the paper, drawn from the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, PercentFormatter
from occ_constraints_pkg.picture_style import (
    FIGURE_WIDTH,
    MARKERS,
    SAFE,
    SERIES,
    VIOLATED,
    draw_runs,
    legend_below,
    run_handles,
    save_figure,
)
from occ_constraints_pkg.worlds.simple_nav import FORBIDDEN_X_BELOW, FORBIDDEN_Y_ABOVE

from experiments.highway_results import draw_curves
from experiments.paper import depth, highway, safety_gym, simple_nav
from experiments.paper.plan import Scale
from experiments.paper.tables import Lines, results_of

_COLOURS = {'expert': '#009e73', safety_gym.MCE: '#e69f00', 'ours': '#0072b2'}
_STYLES = {'expert': ':', safety_gym.MCE: '--', 'ours': '-'}
_LIMIT = 25.0


def draw(lines: Lines, scale: Scale, folder: Path) -> list[Path]:
    """Draw every picture that the store has something for; return their files.

    Args:
        lines: of the store.
        scale: the runs.
        folder: gets the PNG files.
    """
    drawn = []
    (example,) = results_of(lines, simple_nav.jobs(scale)[:1]) or [None]
    if example is not None:
        drawn.append(_saved(_trajectories(example), folder / 'simple_nav_trajectories.png'))
        drawn.append(_saved(_tree(example['tree']), folder / 'simple_nav_tree.png'))
    for name, figure in (
        ('safety_gym', _training_curves(lines, scale)),
        ('depth', _depths(lines, scale)),
    ):
        if figure is not None:
            drawn.append(_saved(figure, folder / f'{name}.png'))
    drives = highway.curves(lines, scale)
    if drives:
        draw_curves(folder / 'highway.png', drives)
        drawn.append(folder / 'highway.png')
    return drawn


def _saved(figure: Figure, path: Path) -> Path:
    save_figure(figure, path)
    return path


def _trajectories(example: Mapping[str, Any]) -> Figure:
    """Figure 1: expert and heedless trajectories, and what is forbidden."""
    figure, axis = plt.subplots(figsize=(5.0, 5.4), layout='constrained')
    axis.add_patch(
        Rectangle(
            (0.0, FORBIDDEN_Y_ABOVE),
            FORBIDDEN_X_BELOW,
            1.0 - FORBIDDEN_Y_ABOVE,
            fc=(*to_rgb(VIOLATED), 0.2),
            ec=VIOLATED,
            hatch='///',
            lw=0,
            label='forbidden by the true constraint',
        )
    )
    for driver, style, colour, words in (
        ('expert', '-', SAFE, 'expert'),
        ('straight', '--', 'black', 'unaware of the constraint'),
    ):
        for number, path in enumerate(example['trajectories'][driver]):
            x, y = np.transpose(path)
            axis.plot(x, y, style, lw=1.3, color=colour, label='' if number else words)
    axis.set(xlim=(0, 1), ylim=(0, 1), xlabel='x', ylabel='y', aspect='equal')
    figure.suptitle('simple_nav: trajectories and what is forbidden', fontsize=11)
    legend_below(figure, axis.get_legend_handles_labels()[0], columns=2)
    return figure


def _tree(tree: Mapping[str, Any]) -> Figure:
    """Figure 2: the tree, each node an interval of one feature."""
    figure, axis = plt.subplots(figsize=(6.4, 3.6), layout='constrained')
    axis.axis('off')
    axis.set_title('simple_nav: the tree learned from the expert', fontsize=11)
    width = _leaves(tree)

    def place(node: Mapping[str, Any], left: float, level: int, words: str) -> float:
        size = _leaves(node)
        middle = left + size / 2
        axis.text(
            *(middle, -level, words),
            ha='center',
            va='center',
            fontsize=9,
            bbox={'boxstyle': 'round', 'fc': '#eef3f8', 'ec': '#3b6ea5'},
            zorder=2,
        )
        start = left
        for branch in node.get('branches', []):
            below = branch.get('below', {})
            text = f'{branch["from"]:.3f} ≤ {node["split"]} ≤ {branch["to"]:.3f}'
            child = place(below, start, level + 1, f'{text}\n{branch["samples"]} samples')
            axis.plot([middle, child], [-level, -level - 1], color='#888888', lw=1, zorder=1)
            start += _leaves(below)
        return middle

    place(tree, 0.0, 0, 'all states')
    axis.set(xlim=(0, width), ylim=(-_levels(tree) - 0.4, 0.4))
    return figure


def _leaves(node: Mapping[str, Any]) -> int:
    return max(1, sum(_leaves(branch.get('below', {})) for branch in node.get('branches', [])))


def _levels(node: Mapping[str, Any]) -> int:
    below = [_levels(branch.get('below', {})) for branch in node.get('branches', [])]
    return 1 + max(below) if below else 0


def _training_curves(lines: Lines, scale: Scale) -> Figure | None:
    """Return the paper's third figure: return above, true cost below, a column for each task."""
    found = {
        (task, method): results_of(
            lines,
            [
                safety_gym.method_job(scale, task, method, seed)
                for seed in range(scale.diagonal_seeds)
            ],
        )
        for task in scale.tasks
        for method in safety_gym.METHODS
    }
    # Where no episode has ended yet there is nothing to draw.
    found = {key: [x for x in items if x['curve']['steps']] for key, items in found.items()}
    tasks = [task for task in scale.tasks if any(found[task, m] for m in safety_gym.METHODS)]
    if not tasks:
        return None
    figure, axes = plt.subplots(
        2, len(tasks), figsize=(max(FIGURE_WIDTH, 2.7 * len(tasks)), 5.4), squeeze=False,
        sharex='col', layout='constrained',
    )  # fmt: skip
    for column, task in enumerate(tasks):
        for method in safety_gym.METHODS:
            for axis, name in zip(axes[:, column], ('return', 'cost'), strict=True):
                _draw_method(axis, [item['curve'] for item in found[task, method]], name, method)
        axes[1, column].axhline(_LIMIT, color='black', lw=1.0, ls='-.')
        axes[0, column].set_title(task, fontsize=10)
        axes[1, column].set_xlabel('million robot steps')
        axes[1, column].set_ylim(0, 150)
    axes[0, 0].set_ylabel('return per episode')
    axes[1, 0].set_ylabel('true cost per episode')
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    handles = [
        Line2D([], [], color=_COLOURS[method], ls=_STYLES[method], lw=1.8, label=method)
        for method in safety_gym.METHODS
    ]
    handles.append(Line2D([], [], color='black', lw=1.0, ls='-.', label='cost limit'))
    legend_below(figure, [*handles, *run_handles(max(map(len, found.values())))], columns=6)
    figure.suptitle('Return and true cost during training', fontsize=11)
    return figure


def _draw_method(
    axis: Axes, curves: Sequence[Mapping[str, Sequence[float]]], name: str, method: str
) -> None:
    """Draw each run, and their mean."""
    if not curves:
        return
    length = max(len(curve['steps']) for curve in curves)
    steps = np.linspace(
        max(curve['steps'][0] for curve in curves),
        min(curve['steps'][-1] for curve in curves),
        length,
    )
    values = np.array([np.interp(steps, curve['steps'], curve[name]) for curve in curves])
    draw_runs(axis, steps / 1e6, values, _COLOURS[method], style=_STYLES[method])


def _depths(lines: Lines, scale: Scale) -> Figure | None:
    """Coverage of held-out demonstrations and F1 against depth."""
    figure, axes = plt.subplots(
        1, 2, figsize=(FIGURE_WIDTH, 3.8), sharex=True, layout='constrained'
    )
    drawn = False
    for number, (tree, title) in enumerate(depth.COMPARED.items()):
        for run, result in enumerate(
            results_of(
                lines,
                [depth.compared_job(scale, tree, seed) for seed in range(scale.small_seeds)],
            )
        ):
            drawn = True
            for axis, name in zip(axes, ('held_out', 'f1'), strict=True):
                level = [np.nan if item[name] is None else item[name] for item in result['depths']]
                axis.plot(
                    range(len(level)),
                    level,
                    color=SERIES[number],
                    marker=MARKERS[number],
                    ms=5,
                    lw=1.2,
                    label='' if run else title,
                    clip_on=False,
                )
    if not drawn:
        plt.close(figure)
        return None
    for axis, words in zip(axes, ('held-out demonstrations covered', 'F1'), strict=True):
        axis.set(xlabel='depth (levels of splits)', ylabel=words, ylim=(0, 1))
        axis.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        axis.grid(alpha=0.3)
    axes[0].yaxis.set_major_formatter(PercentFormatter(1.0))
    figure.suptitle('What deeper trees cover and find', fontsize=11)
    legend_below(figure, axes[0].get_legend_handles_labels()[0])
    return figure
