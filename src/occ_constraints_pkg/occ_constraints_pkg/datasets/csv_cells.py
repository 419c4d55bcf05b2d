# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Cells of CSV files as numbers: quickly where all are, and cell by cell to name a faulty one."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError


def parse_quickly(lines: Iterable[str], width: int) -> np.ndarray | None:
    """Read lines of which every cell is a number; None where that is not so."""
    lines = (line for line in lines if line.strip())
    first = next(lines, None)
    if first is None:
        return np.empty((0, width))
    try:
        table = np.loadtxt(
            itertools.chain([first], lines), delimiter=',', comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        return None
    return table if table.shape[1] == width else None


def parse_cells(rows: Any, header: Sequence[str], places: Sequence[int], path: Path) -> np.ndarray:
    """Read a file cell by cell, to take empty ones as missing and to name a faulty one."""
    next(rows)
    table = []
    for row in rows:
        if is_blank(row):
            continue
        if len(row) != len(header):
            raise DataError(
                f'{path}, line {rows.line_num}: got {len(row)} cells; '
                f'allowed are {len(header)}, as in the header'
            )
        table.append([_cell(row[place], header[place], rows.line_num, path) for place in places])
    return np.array(table, dtype=np.float64).reshape(len(table), len(places))


def is_blank(row: Sequence[str]) -> bool:
    """Tell whether the cells of a row are those of a blank line."""
    return len(row) < 2 and not ''.join(row).strip()


def _cell(text: str, column: str, line: int, path: Path) -> float:
    try:
        return float(text) if text.strip() else np.nan
    except ValueError:
        raise DataError(
            f'{path}, line {line}, column {column!r}: got {text!r}; allowed is a number'
        ) from None
