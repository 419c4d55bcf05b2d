# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the paper, drawn from the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from occ_constraints_pkg.agents.evaluation import half_width
from occ_constraints_pkg.files import PICTURE, replacing
from occ_constraints_pkg.worlds.simple_nav import FORBIDDEN_X_BELOW, FORBIDDEN_Y_ABOVE

from experiments.highway_results import draw_curves
from experiments.paper import depth, highway, safety_gym, simple_nav
from experiments.paper.plan import Scale
from experiments.paper.tables import Lines, results_of

_COLOURS = {'expert': '#3a7d44', safety_gym.MCE: '#c8862b', 'ours': '#3b6ea5'}
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
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=110, format='png')
    plt.close(figure)
    return path


def _trajectories(example: Mapping[str, Any]) -> Figure:
    """Figure 1: expert and heedless trajectories, and what is forbidden."""
    figure, axis = plt.subplots(figsize=(4.4, 4.2))
    axis.add_patch(
        Rectangle(
            (0.0, FORBIDDEN_Y_ABOVE),
            FORBIDDEN_X_BELOW,
            1.0 - FORBIDDEN_Y_ABOVE,
            color='#c03a2b',
            alpha=0.25,
            lw=0,
            label='true constraint',
        )
    )
    for driver, style, words in (
        ('expert', '-', 'expert'),
        ('straight', '--', 'unaware of the constraint'),
    ):
        for number, path in enumerate(example['trajectories'][driver]):
            x, y = np.transpose(path)
            axis.plot(x, y, style, lw=1.1, color='#222222', label='' if number else words)
    axis.set(xlim=(0, 1), ylim=(0, 1), xlabel='x', ylabel='y', aspect='equal')
    axis.legend(fontsize=8, loc='upper left')
    return figure


def _tree(tree: Mapping[str, Any]) -> Figure:
    """Figure 2: the tree, each node an interval of one feature."""
    figure, axis = plt.subplots(figsize=(6.4, 3.4))
    axis.axis('off')
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
        2, len(tasks), figsize=(3.4 * len(tasks) + 0.6, 5.0), squeeze=False, sharex='col'
    )
    for column, task in enumerate(tasks):
        for method in safety_gym.METHODS:
            for axis, name in zip(axes[:, column], ('return', 'cost'), strict=True):
                _band(axis, [item['curve'] for item in found[task, method]], name, method)
        axes[1, column].axhline(_LIMIT, color='#999999', lw=0.8, ls=':')
        axes[0, column].set_title(task, fontsize=10)
        axes[1, column].set_xlabel('million robot steps')
        axes[1, column].set_ylim(0, 150)
    axes[0, 0].set_ylabel('return')
    axes[1, 0].set_ylabel('true cost')
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    for axis in axes[0]:
        axis.legend(fontsize=8)
    return figure


def _band(
    axis: Axes, curves: Sequence[Mapping[str, Sequence[float]]], name: str, label: str
) -> None:
    """Draw the mean over runs, and its 95 % interval if there are several."""
    if not curves:
        return
    length = max(len(curve['steps']) for curve in curves)
    steps = np.linspace(
        max(curve['steps'][0] for curve in curves),
        min(curve['steps'][-1] for curve in curves),
        length,
    )
    values = np.array([np.interp(steps, curve['steps'], curve[name]) for curve in curves])
    colour, mean = _COLOURS[label], values.mean(axis=0)
    axis.plot(steps / 1e6, mean, color=colour, lw=1.3, label=label)
    if len(values) > 1:
        half = np.array([half_width(column) for column in values.T])
        axis.fill_between(steps / 1e6, mean - half, mean + half, color=colour, alpha=0.2, lw=0)


def _depths(lines: Lines, scale: Scale) -> Figure | None:
    """Coverage of held-out demonstrations and F1 against depth."""
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 3.2), sharex=True)
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
                    color=f'C{number}',
                    marker='o',
                    ms=3,
                    lw=1,
                    alpha=0.8,
                    label='' if run else title,
                )
    if not drawn:
        plt.close(figure)
        return None
    for axis, words in zip(axes, ('held-out demonstrations covered', 'F1'), strict=True):
        axis.set(xlabel='depth', ylabel=words, ylim=(0, 1.02))
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    return figure
