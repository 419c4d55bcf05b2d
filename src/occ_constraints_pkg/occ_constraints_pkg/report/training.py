# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The sections of a training: its curves, and where it ended."""

from __future__ import annotations

import platform
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg import __version__
from occ_constraints_pkg.agents.curves import draw_training
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import read_bytes
from occ_constraints_pkg.report.page import Page, facts_section, picture_section, table_section
from occ_constraints_pkg.report.rules import add_provenance, add_rules
from occ_constraints_pkg.rules.constraints_file import load_constraints

_METRICS, _SUMMARY, _CURVES, _RULES = (
    'metrics.jsonl',
    'summary.json',
    'curves.png',
    'constraints.yaml',
)
_PICTURE_BYTES = 4 << 20
_PNG = b'\x89PNG\r\n\x1a\n'
# Lines of the table: enough to see a course.
_LINES = 12
_COLUMNS = ('steps', 'mean_return', 'mean_cost', 'multiplier')
_TITLES = ('steps', 'return per episode', 'cost per episode', 'multiplier')


def training_page(title: str, path: str | Path) -> Page:
    """Return the page of a training that ``occ train`` wrote, with the rules it obeyed.

    Args:
        title: of the page.
        path: its directory, or with several seeds the one in which ``seed_0`` and so on are.

    Raises:
        DataError: there is no training, or it is damaged.
    """
    page = Page(title)
    first = add_training(page, path)
    rules = first / _RULES
    if rules.is_file():
        constraints = load_constraints(rules)
        add_rules(page, constraints)
        add_provenance(page, constraints)
    return page


def add_training(page: Page, path: str | Path) -> Path:
    """Add a training that ``occ train`` wrote, or several that differ by their seed.

    Args:
        page: where.
        path: its directory; with several, the one in which ``seed_0`` and so on are.

    Returns:
        The directory of the first of them.

    Raises:
        DataError: there is no training, or it is damaged.
    """
    folder = Path(path)
    directories = [folder] if (folder / _METRICS).is_file() else sorted(
        (item.parent for item in folder.glob(f'seed_*/{_METRICS}')),
        key=lambda item: (len(item.name), item.name),
    )  # fmt: skip
    histories = [read_metrics(item / _METRICS) for item in directories]
    if not histories or not all(histories):
        raise DataError(
            f'{folder} holds no training that has made an update; allowed is a directory that '
            '`occ train` wrote'
        )
    last = [history[-1] for history in histories]
    summary = directories[0] / _SUMMARY
    facts = dict(read_json_object(summary)) if summary.is_file() else {}
    settings = facts.pop('settings', {})
    if not isinstance(settings, dict):
        raise DataError(
            f'{summary} is damaged: settings: got {settings!r}; allowed are names and values'
        )
    words = 'Return, cost and multiplier over the steps of the training'
    page.add(picture_section('Training', _curves(folder, histories), words, id='training'))
    if len(histories) > 1:
        rows = [[item.name, *_chosen(line)] for item, line in zip(directories, last, strict=True)]
        title, first = 'Where each seed ended', 'seed'
        settings.pop('seed', None)
    else:
        page.summary = page.summary or _ending(last[0], settings.get('cost_limit'))
        stride = max(1, len(histories[0]) // _LINES)
        rows = [[line['updates'], *_chosen(line)] for line in histories[0][::-stride]]
        rows.reverse()
        title, first = 'Course of the training', 'updates'
    page.add(table_section(title, [first, *_TITLES], rows, id='course', numbers=range(1, 5)))
    page.add(facts_section('Settings of the training', {**facts, **settings}, id='settings'))
    return directories[0]


def evaluation_page(
    title: str, lines: Sequence[Mapping[str, Any]], settings: Mapping[str, Any]
) -> Page:
    """Return the page of an evaluation.

    Args:
        title: of the page.
        lines: for each policy its name as ``policy`` and the numbers of ``occ evaluate --json``.
        settings: how they were evaluated, by name.
    """
    page = Page(title)
    names = [name for name in lines[0] if not name.endswith('_ci95')]
    rows = [[_with_interval(line, name) for name in names] for line in lines]
    intro = 'Means per episode, with 95 % intervals over the episodes.'
    titles = [name.replace('_', ' ') for name in names]
    numbers = range(1, len(names))
    page.add(
        table_section('Evaluation', titles, rows, id='evaluation', intro=intro, numbers=numbers)
    )
    versions = {'occ_constraints': __version__, 'Python': platform.python_version()}
    page.add(facts_section('Settings and versions', {**settings, **versions}, id='settings'))
    return page


def _ending(line: Mapping[str, Any], limit: Any) -> str:
    allowed = '' if limit is None else f', with {_number(limit)} allowed'
    cost = _number(line.get('mean_cost')) or 'not known'
    returned = _number(line.get('mean_return')) or 'not known'
    return f'After {line["steps"]} steps: return {returned} and cost {cost} per episode{allowed}'


def _with_interval(line: Mapping[str, Any], name: str) -> str:
    half = line.get(f'{name}_ci95')
    return _number(line[name]) + ('' if half is None else f' ± {_number(half)}')


def _chosen(line: Mapping[str, Any]) -> list[str]:
    return [_number(line.get(name)) for name in _COLUMNS]


def _number(value: Any) -> str:
    return '' if value is None else f'{value:.4g}' if isinstance(value, float) else str(value)


def _curves(folder: Path, histories: Sequence[Sequence[dict[str, Any]]]) -> bytes:
    """Return the curves that the training drew, which show its limit, else new ones."""
    own = folder / _CURVES
    if own.is_file():
        png = read_bytes(own, _PICTURE_BYTES)
        if not png.startswith(_PNG):
            raise DataError(f'{own} is damaged: it is no PNG; without it, curves are drawn anew')
        return png
    with tempfile.TemporaryDirectory() as directory:
        drawn = Path(directory) / _CURVES
        draw_training(drawn, histories, None)
        return drawn.read_bytes()
