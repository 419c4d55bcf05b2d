# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A picture of what each level of the tree adds, made with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from occ_constraints_pkg.files import PICTURE, replacing
from occ_constraints_pkg.learning.depths import DepthResult

_TRAINING, _HELD_OUT, _COUNT = '#3b6ea5', '#6aa84f', '#555555'
_PRECISION, _RECALL, _F1 = '#b9a3d3', '#e0a030', '#c8362b'
_DOTS_PER_INCH = 110


def draw_depths(path: Path, results: Sequence[DepthResult]) -> None:
    """Draw coverage, sizes and, where the truth is known, scores over the depth.

    Args:
        path: PNG file to write.
        results: of each depth, the shallowest first.
    """
    scored = [item for item in results if item.score is not None]
    panels = 3 if scored else 2
    figure, axes = plt.subplots(1, panels, figsize=(4.2 * panels, 3.6), squeeze=False)
    coverage, sizes = axes[0][:2]
    _draw(coverage, results, [item.training for item in results], _TRAINING, 'training samples')
    if results[0].held_out is not None:
        held_out = [item.held_out for item in results]
        _draw(coverage, results, held_out, _HELD_OUT, 'held-out episodes')
    coverage.set_title('share inside the safe set', fontsize=10)
    _draw(sizes, results, [item.rules for item in results], _COUNT, 'rules')
    _draw(sizes, results, [item.literals for item in results], _TRAINING, 'literals')
    sizes.set_title('size of the formula', fontsize=10)
    sizes.set_ylim(bottom=0)
    if scored:
        judged = axes[0][2]
        for name, colour in (('precision', _PRECISION), ('recall', _RECALL), ('f1', _F1)):
            ratios = [getattr(item.score, name) for item in scored]
            _draw(judged, scored, ratios, colour, 'F1' if name == 'f1' else name)
        judged.set_title('against the true cost', fontsize=10)
        judged.set_ylim(-0.03, 1.03)
    for axis in axes[0]:
        axis.set_xlabel('depth (levels of splits)')
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=_DOTS_PER_INCH, format='png')
    plt.close(figure)


def _draw(
    axis: Axes,
    results: Sequence[DepthResult],
    numbers: Sequence[Any],
    colour: str,
    label: str,
) -> None:
    # Few levels are a likely result, and a single one has no line.
    axis.plot([item.depth for item in results], numbers, 'o-', color=colour, ms=4, label=label)
