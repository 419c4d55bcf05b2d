# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all pictures share: colours, resolution, how runs are drawn and files saved.

Needs matplotlib, so only modules that draw import it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from occ_constraints_pkg.files import PICTURE, replacing

# Told apart with any colour vision and in grey: they differ in lightness as well as in hue.
SAFE, VIOLATED, NEUTRAL = '#3b6ea5', '#d55e00', '#555555'
# Areas, behind which lines and text must show.
SAFE_AREA, UNKNOWN_AREA = '#b5d0ea', '#c8c8c8'
# For several things side by side.
SERIES = ('#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#555555')
# Markers in the same order, for those who do not see the colours.
MARKERS = ('o', 's', '^', 'D', 'v', 'P')
# At most as wide as documents show a picture, so that its text keeps its size there.
FIGURE_WIDTH, DOTS_PER_INCH = 8.0, 110


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a PNG file and close it.

    Args:
        figure: what was drawn.
        path: PNG file; an older picture is replaced, nothing else is.

    Raises:
        OccError: the file cannot be written.
    """
    try:
        with replacing(path, PICTURE) as draft:
            figure.savefig(draft, dpi=DOTS_PER_INCH, format='png')
    finally:
        plt.close(figure)


def draw_runs(
    axis: Axes, x: np.ndarray, values: np.ndarray, colour: str, label: str = '', style: str = '-'
) -> None:
    """Draw each run as a thin line and, of several, their mean as a thick one.

    An interval from a few runs reaches to what cannot be, such as negative costs; the runs do not.

    Args:
        axis: where.
        x: (n,) of each point.
        values: (runs, n); NaN where a run has no value, where the mean has none either.
        colour: of all lines.
        label: of the mean, or of the only run; empty for none in the legend.
        style: of the mean's line.
    """
    if len(values) > 1:
        axis.plot(x, values.T, color=colour, lw=0.7, alpha=0.45)
    axis.plot(x, values.mean(axis=0), style, color=colour, lw=1.8, label=label or None)


def run_handles(count: int) -> list[Line2D]:
    """Return legend entries that explain :func:`draw_runs`; none for a single run."""
    if count < 2:
        return []
    return [
        Line2D([], [], color=NEUTRAL, lw=1.8, label=f'mean of {count} seeds'),
        Line2D([], [], color=NEUTRAL, lw=0.7, alpha=0.6, label='each seed'),
    ]


def legend_below(figure: Figure, handles: Sequence, columns: int = 4) -> None:
    """Put a legend under all panels of a figure of constrained layout, where it covers nothing."""
    figure.legend(
        handles=list(handles),
        loc='outside lower center',
        ncols=min(columns, len(handles)),
        fontsize=8.5,
        frameon=False,
    )
