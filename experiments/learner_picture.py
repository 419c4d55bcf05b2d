# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of how soon policies are within their limit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from occ_constraints_pkg.files import PICTURE, replacing

_STYLES = {'mean': '-', 'sampled': ':'}


def draw_learner(path: Path, lines: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw return and cost over steps and over minutes, a row for each world, cost and limit.

    Args:
        path: PNG file to write.
        lines: the ``lines`` of the results of the experiment ``learner``.
    """
    rows = list(dict.fromkeys(_row(line) for line in lines.values()))
    figure, axes = plt.subplots(len(rows), 4, figsize=(13, 2.6 * len(rows)), squeeze=False)
    scales = (('steps', 1e6, 'million robot steps'), ('core_s', 60.0, 'minutes of one core'))
    for row, panels in zip(rows, axes, strict=True):
        chosen = [line for line in lines.values() if _row(line) == row]
        for panel, axis in enumerate(panels):
            key, unit, label = scales[panel // 2]
            what, colour = (('return', 'C0'), ('cost', 'C3'))[panel % 2]
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
    figure.text(0.995, 0.005, 'solid: mean actions; dotted: sampled', ha='right', fontsize=8)
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=110, format='png')
    plt.close(figure)


def _row(line: Mapping[str, Any]) -> tuple[str, str, float]:
    return line['world'], line['cost'], line['limit']
