# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of how well the true cost is recovered."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from occ_constraints_pkg.picture_style import FIGURE_WIDTH, MARKERS, SERIES, save_figure

_TITLES = {'expert': 'experts demonstrate', 'mixed': 'a heedless driver is among them'}


def draw_truth(path: Path, lines: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw F1 against the number of demonstrated samples to a file; see :func:`truth_figure`.

    Args:
        path: PNG file to write.
        lines: the ``lines`` of the results of the experiment ``truth``.
    """
    save_figure(truth_figure(lines), path)


def truth_figure(lines: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Return a figure of F1 against the number of demonstrated samples.

    A bar is one standard deviation over the repetitions, as far as F1 goes. The worlds are beside
    each other, so that no bar covers another.

    Args:
        lines: the ``lines`` of the results of the experiment ``truth``.
    """
    levels = [level for level in _TITLES if any(x['level'] == level for x in lines.values())]
    figure, axes = plt.subplots(
        1, max(1, len(levels)), figsize=(FIGURE_WIDTH, 4.0), sharey=True, squeeze=False,
        layout='constrained',
    )  # fmt: skip
    worlds = list(dict.fromkeys(line['world'] for line in lines.values()))
    for axis, level in zip(axes[0], levels, strict=False):
        for number, world in enumerate(worlds):
            chosen = sorted(
                (line['samples'], line['f1']['mean'] or 0.0, line['f1']['std'] or 0.0)
                for line in lines.values()
                if line['world'] == world and line['level'] == level
            )
            if chosen:
                samples, means, deviations = np.array(chosen).T
                ends = np.clip([means - deviations, means + deviations], 0.0, 1.0)
                axis.errorbar(
                    samples * 1.08 ** (number - (len(worlds) - 1) / 2), means, abs(ends - means),
                    marker=MARKERS[number], ms=5, capsize=3, lw=1.2, color=SERIES[number],
                    label=world,
                )  # fmt: skip
        axis.set(xscale='log', xlabel='demonstrated samples', ylim=(0.0, 1.0))
        axis.set_title(_TITLES[level], fontsize=10)
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel('F1 against the true cost')
    figure.suptitle('How well the true cost is recovered: mean ± standard deviation', fontsize=11)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=4, fontsize=9, frameon=False)
    return figure
