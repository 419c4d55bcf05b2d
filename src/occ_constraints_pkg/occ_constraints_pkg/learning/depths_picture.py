# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A picture of what each level of the tree adds, made with matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator, PercentFormatter

from occ_constraints_pkg.learning.depths import DepthResult
from occ_constraints_pkg.picture_style import FIGURE_WIDTH, MARKERS, SERIES, save_figure


def draw_depths(path: Path, results: Sequence[DepthResult]) -> None:
    """Draw what each depth gives to a file; see :func:`depths_figure`.

    Args:
        path: PNG file to write.
        results: of each depth, the shallowest first.
    """
    save_figure(depths_figure(results), path)


def depths_figure(results: Sequence[DepthResult]) -> Figure:
    """Return a figure of coverage, sizes and, where the truth is known, scores over the depth.

    Args:
        results: of each depth, the shallowest first.
    """
    scored = [item for item in results if item.score is not None]
    panels = 3 if scored else 2
    figure, axes = plt.subplots(
        1, panels, figsize=(FIGURE_WIDTH, 3.6), squeeze=False, layout='constrained', sharex=True
    )
    depths = [item.depth for item in results]
    shares: dict[str, Sequence[float | None]] = {
        'training samples': [item.training for item in results]
    }
    if results[0].held_out is not None:
        shares['held-out episodes'] = [item.held_out for item in results]
    sizes = {
        'rules': [item.rules for item in results],
        'literals': [item.literals for item in results],
    }
    _draw(axes[0][0], depths, shares, 'share inside the safe set')
    _draw(axes[0][1], depths, sizes, 'size of the formula')
    axes[0][1].set_ylim(bottom=0)
    axes[0][1].yaxis.set_major_locator(MaxNLocator(integer=True))
    if scored:
        scores = {
            name: [getattr(item.score, key) for item in scored]
            for name, key in (('precision', 'precision'), ('recall', 'recall'), ('F1', 'f1'))
        }
        _draw(axes[0][2], [item.depth for item in scored], scores, 'against the true cost')
    for axis in axes[0][::2]:
        axis.set_ylim(0.0, 1.0)
        axis.yaxis.set_major_formatter(PercentFormatter(1.0))
    # Also of a single depth, an axis of whole levels.
    axes[0][0].set_xlim(min(depths) - 0.5, max(depths) + 0.5)
    figure.suptitle('What each level of splits adds', fontsize=11)
    return figure


def _draw(
    axis: Axes, depths: Sequence[int], lines: Mapping[str, Sequence[float | None]], title: str
) -> None:
    """Draw lines of which those below show beside those above, also where they coincide."""
    for number, (label, values) in enumerate(lines.items()):
        known = [float('nan') if value is None else value for value in values]
        size = 9.0 - 3.0 * number
        axis.plot(
            depths, known, color=SERIES[number], lw=1.2, label=label, clip_on=False,
            marker=MARKERS[number], ms=size, mfc='none', mew=1.4,
        )  # fmt: skip
    axis.set_title(title, fontsize=10)
    axis.set_xlabel('depth (levels of splits)', fontsize=9)
    axis.xaxis.set_major_locator(MultipleLocator(max(1, -(-(depths[-1] - depths[0]) // 8))))
    axis.tick_params(labelsize=8.5)
    axis.grid(alpha=0.3)
    axis.legend(loc='upper center', bbox_to_anchor=(0.5, -0.2), fontsize=8.5, frameon=False)
