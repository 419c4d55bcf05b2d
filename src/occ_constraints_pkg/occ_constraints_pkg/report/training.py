# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The sections of a training: its curves, and where it ended."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg.agents.curves import draw_training
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import read_bytes
from occ_constraints_pkg.report.page import Page, facts_section, table_section
from occ_constraints_pkg.report.rules import picture_section

_METRICS, _SUMMARY, _CURVES = 'metrics.jsonl', 'summary.json', 'curves.png'
_PICTURE_BYTES = 4 << 20
# Lines of the table: enough to see a course.
_LINES = 12
_COLUMNS = ('steps', 'mean_return', 'mean_cost', 'multiplier')


def add_training(page: Page, path: str | Path) -> None:
    """Add a training that ``occ train`` wrote, or several that differ by their seed.

    Args:
        page: where.
        path: its directory; with several, the one in which ``seed_0`` and so on are.

    Raises:
        DataError: there is no training, or it is damaged.
    """
    folder = Path(path)
    directories = [folder] if (folder / _METRICS).is_file() else sorted(
        item.parent for item in folder.glob(f'seed_*/{_METRICS}')
    )  # fmt: skip
    histories = [read_metrics(item / _METRICS) for item in directories]
    if not histories or not all(histories):
        raise DataError(
            f'{folder} holds no training that has made an update; allowed is a directory that '
            '`occ train` wrote'
        )
    last = [history[-1] for history in histories]
    names = [item.name for item in directories]
    page.add(
        picture_section(
            'Training',
            _curves(folder, histories),
            'Return, cost and multiplier over the steps of the training',
            id='training',
        )
    )
    if len(histories) > 1:
        rows = [
            [name, *map(_number, _chosen(line))] for name, line in zip(names, last, strict=True)
        ]
        title, first = 'Where each seed ended', 'seed'
    else:
        stride = max(1, len(histories[0]) // _LINES)
        rows = [[line['updates'], *map(_number, _chosen(line))] for line in histories[0][::-stride]]
        rows.reverse()
        title, first = 'Course of the training', 'updates'
    columns = [first, 'steps', 'return per episode', 'cost per episode', 'multiplier']
    page.add(table_section(title, columns, rows, id='course', numbers=range(1, 5)))
    summary = folder / _SUMMARY
    if summary.is_file():
        page.add(
            facts_section('Settings of the training', read_json_object(summary), id='settings')
        )


def _chosen(line: dict[str, Any]) -> list[Any]:
    return [line.get(name) for name in _COLUMNS]


def _number(value: Any) -> str:
    return '' if value is None else f'{value:.4g}' if isinstance(value, float) else str(value)


def _curves(folder: Path, histories: Sequence[Sequence[dict[str, Any]]]) -> bytes:
    """Return the curves that the training drew, which show its limit, else new ones."""
    own = folder / _CURVES
    if own.is_file():
        return read_bytes(own, _PICTURE_BYTES)
    with tempfile.TemporaryDirectory() as directory:
        drawn = Path(directory) / _CURVES
        draw_training(drawn, histories, None)
        return drawn.read_bytes()
