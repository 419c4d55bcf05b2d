# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rules of all depths as a table for people and as plain values for machines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from occ_constraints_pkg.learning.depths import DepthResult


def describe_depths(results: Sequence[DepthResult]) -> str:
    """Return one line of text for each depth."""
    scored = results[0].score is not None
    lines = [
        f'{"depth":>5} {"rules":>6} {"literals":>9} {"training":>9} {"held out":>9}'
        + (f' {"precision":>10} {"recall":>7} {"F1":>6}' if scored else '')
    ]
    for item in results:
        line = f'{item.depth:>5} {item.rules:>6} {item.literals:>9} {item.training:>9.4f}'
        line += f' {"none" if item.held_out is None else f"{item.held_out:.4f}":>9}'
        if item.score is not None:
            line += f' {_ratio(item.score.precision):>10} {_ratio(item.score.recall):>7}'
            line += f' {_ratio(item.score.f1):>6}'
        lines.append(line)
    return '\n'.join(lines)


def depths_document(results: Sequence[DepthResult]) -> list[dict[str, Any]]:
    """Return one mapping for each depth, as what JSON can hold."""
    return [
        {
            'depth': item.depth,
            'rules': item.rules,
            'literals': item.literals,
            'training': item.training,
            'held_out': item.held_out,
            **(
                {}
                if item.score is None
                else {
                    name: value if math.isfinite(value) else None
                    for name, value in item.score.ratios().items()
                }
            ),
        }
        for item in results
    ]


def _ratio(value: float) -> str:
    return f'{value:.3f}' if math.isfinite(value) else 'undef.'
