# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of how well the true cost is recovered."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')

from matplotlib import pyplot as plt
from occ_constraints_pkg.files import PICTURE, replacing

_STYLES = {'expert': '-', 'mixed': '--'}


def draw_truth(path: Path, lines: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw F1 against the number of demonstrated samples.

    Args:
        path: PNG file to write.
        lines: the ``lines`` of the results of the experiment ``truth``.
    """
    figure, axis = plt.subplots(figsize=(6.5, 4.0))
    worlds = list(dict.fromkeys(line['world'] for line in lines.values()))
    for number, world in enumerate(worlds):
        for level, style in _STYLES.items():
            chosen = sorted(
                (line['samples'], line['f1']['mean'] or 0.0, line['f1']['std'] or 0.0)
                for line in lines.values()
                if line['world'] == world and line['level'] == level
            )
            if chosen:
                samples, means, deviations = zip(*chosen, strict=True)
                axis.errorbar(
                    samples,
                    means,
                    deviations,
                    ls=style,
                    marker='o',
                    ms=3,
                    capsize=2,
                    color=f'C{number}',
                    label=f'{world}, {level}',
                )
    axis.set(xscale='log', xlabel='demonstrated samples', ylabel='F1', ylim=(0.0, 1.0))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    figure.tight_layout()
    with replacing(path, PICTURE) as draft:
        figure.savefig(draft, dpi=110, format='png')
    plt.close(figure)
