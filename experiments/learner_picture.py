# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of how soon policies are within their limit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from occ_constraints_pkg.picture_style import NEUTRAL, SAFE, VIOLATED, legend_below, save_figure

_STYLES = {'mean': '-', 'sampled': ':'}


def draw_learner(path: Path, lines: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw return and cost over steps and over minutes, a row for each world, cost and limit.

    Args:
        path: PNG file to write.
        lines: the ``lines`` of the results of the experiment ``learner``.
    """
    rows = list(dict.fromkeys(_row(line) for line in lines.values()))
    figure, axes = plt.subplots(len(rows), 4, figsize=(13, 2.6 * len(rows) + 0.5), squeeze=False,
                             layout='constrained')  # fmt: skip
    scales = (('steps', 1e6, 'million robot steps'), ('core_s', 60.0, 'minutes of one core'))
    for row, panels in zip(rows, axes, strict=True):
        chosen = [line for line in lines.values() if _row(line) == row]
        for panel, axis in enumerate(panels):
            key, unit, label = scales[panel // 2]
            what, colour = (('return', SAFE), ('cost', VIOLATED))[panel % 2]
            for line in chosen:
                x = np.array([point[key] for point in line['curve']]) / unit
                for actions, style in _STYLES.items():
                    y = [point[f'{actions}_{what}'] for point in line['curve']]
                    axis.plot(x, y, style, color=colour, lw=1, alpha=0.7)
            if what == 'cost':
                axis.axhline(row[2], color='black', ls='--', lw=1)
                axis.set_ylim(0, 4 * row[2])
            axis.set_xlabel(label, fontsize=8)
            axis.set_title(f'{row[0]}: {what}' if panel % 2 == 0 else what, fontsize=9)
            axis.grid(alpha=0.3)
        panels[0].set_ylabel(f'{row[1]} cost, limit {row[2]:g}', fontsize=8)
    handles = [
        Line2D([], [], color=NEUTRAL, ls=style, label=f'a seed, {actions} actions')
        for actions, style in _STYLES.items()
    ]
    handles.append(Line2D([], [], color='black', ls='--', label='cost limit'))
    legend_below(figure, handles)
    save_figure(figure, path)


def _row(line: Mapping[str, Any]) -> tuple[str, str, float]:
    return line['world'], line['cost'], line['limit']
