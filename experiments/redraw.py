# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pictures of results that are there already, without running anything."""

from __future__ import annotations

from pathlib import Path

from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import OccError

from experiments.highway_results import draw_curves
from experiments.learner_picture import draw_learner
from experiments.truth_picture import draw_truth

_DRAWN = {'highway': draw_curves, 'learner': draw_learner, 'truth': draw_truth}


def redraw(folder: Path) -> list[Path]:
    """Draw a picture beside each file of results in a folder that has one; return their files.

    Args:
        folder: where experiments wrote their results.

    Raises:
        OccError: there are no such results, or a file holds others.
    """
    drawn = []
    for name, draw in _DRAWN.items():
        file = folder / f'{name}.json'
        if file.exists():
            lines = read_json_object(file).get('lines')
            if not lines:
                raise OccError(f'{file} holds no lines of results; allowed is what {name} wrote')
            draw(folder / f'{name}.png', lines)
            drawn.append(folder / f'{name}.png')
    if not drawn:
        names = ', '.join(f'{name}.json' for name in _DRAWN)
        raise OccError(f'{folder} holds no results that have a picture; allowed are {names}')
    return drawn
