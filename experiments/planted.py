# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Planted problems: how well known rules are found, and how often rules that are not there.

Run it as ``python -m experiments.planted --help``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.scoring import score_flags

from benchmarks.conditions import machine, versions
from experiments.planted_methods import METHODS
from experiments.planted_problems import MADE_UP, SIZES, Problem
from experiments.planted_simulated import SIMULATED
from experiments.results import markdown_table, write_results

PROBLEMS: dict[str, Callable[[str, int], Problem]] = dict(sorted((MADE_UP | SIMULATED).items()))
"""Every problem by its name: (size, seed) to the problem."""

SEEDS = (1, 2, 3, 4, 5)
"""Seeds that results are reported on; nothing was tuned on them."""

_HEADS = (
    *('problem', 'samples', 'method', 'seeds', 'F1', 'median', 'precision', 'recall'),
    *('fresh flagged', 'by conditions', 'rules', 'conditional', 'seconds'),
)
Task = tuple[str, str, int, str]


def run_planted(
    output: Path,
    *,
    problems: Sequence[str] = (),
    sizes: Sequence[str] = (),
    seeds: Sequence[int] = SEEDS,
    methods: Sequence[str] = (),
    processes: int = 1,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run what ``output/planted.json`` lacks yet; write that file and ``planted.md``.

    The files are brought up to date after each line, so a stopped run can be continued.

    Args:
        output: directory of the results.
        problems: names; all if empty.
        sizes: keys of :data:`~experiments.planted_problems.SIZES`; all if empty.
        seeds: one line each.
        methods: names; all if empty.
        processes: that work at once.
        progress: called with (lines done, lines in all).

    Raises:
        ConfigurationError: a name is not known.
    """
    chosen = [
        _chosen(names, known, what)
        for names, known, what in (
            (problems, PROBLEMS, 'problem'),
            (sizes, SIZES, 'size'),
            (methods, METHODS, 'method'),
        )
    ]
    file = output / 'planted.json'
    lines = read_json_object(file)['lines'] if file.exists() else {}
    wanted = [
        (problem, size, seed, method)
        for problem in chosen[0]
        for size in chosen[1]
        for seed in seeds
        for method in chosen[2]
    ]
    todo = [task for task in wanted if _key(task) not in lines]
    done, result = len(wanted) - len(todo), _document(lines)

    def finish(task: Task, line: dict[str, Any]) -> None:
        nonlocal done, result
        lines[_key(task)] = line
        result = _document(lines)
        write_results(output, 'planted', result, table(lines))
        done += 1
        progress(done, len(wanted))

    if processes <= 1:
        for task in todo:
            finish(task, run_one(*task))
    else:
        with ProcessPoolExecutor(processes) as pool:
            running = {pool.submit(run_one, *task): task for task in todo}
            for future in as_completed(running):
                finish(running[future], future.result())
    return result


def run_one(problem: str, size: str, seed: int, method: str) -> dict[str, Any]:
    """Learn one problem with one method and judge the result.

    Args:
        problem: its name.
        size: key of :data:`~experiments.planted_problems.SIZES`.
        seed: of all chance.
        method: its name.

    Returns:
        ``f1``, ``precision``, ``recall`` on test states, ``None`` for a null; ``flagged`` and
        ``conditional_flagged``, shares of the time of fresh safe episodes; ``rules`` and
        ``conditional``, their numbers; ``seconds`` that learning took.
    """
    drawn = PROBLEMS[problem](size, seed)
    start = time.perf_counter()
    learned = METHODS[method](drawn)
    seconds = time.perf_counter() - start
    line: dict[str, Any] = dict.fromkeys(('f1', 'precision', 'recall'))
    if not drawn.is_null:
        score = score_flags(learned.flags(drawn.states), drawn.violated)
        # A learner that flags nothing has no precision.
        found = {name: _rounded(getattr(score, name)) for name in line}
        line = {name: None if np.isnan(value) else value for name, value in found.items()}
    conditional = learned.conditional_flags
    return {
        'problem': problem,
        'size': size,
        'seed': seed,
        'method': method,
        **line,
        'flagged': _rounded(learned.flags(drawn.fresh).mean()),
        'conditional_flagged': _rounded(
            0.0 if conditional is None else conditional(drawn.fresh).mean()
        ),
        'rules': learned.rules,
        'conditional': learned.conditional,
        'seconds': round(seconds, 2),
    }


def table(lines: dict[str, dict[str, Any]]) -> str:
    """Return means over seeds, and the median of F1, as a Markdown table."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for line in lines.values():
        groups.setdefault((line['problem'], line['size'], line['method']), []).append(line)
    order = {
        name: number for names in (PROBLEMS, SIZES, METHODS) for number, name in enumerate(names)
    }
    rows = []
    for key in sorted(groups, key=lambda key: [order[name] for name in key]):
        found = groups[key]

        def mean(name: str, found: list[dict[str, Any]] = found) -> float:
            return float(np.mean([np.nan if line[name] is None else line[name] for line in found]))

        values = [np.nan if line['f1'] is None else line['f1'] for line in found]
        f1, median, precision, recall = (
            '-' if np.isnan(value) else f'{value:.2f}'
            for value in (
                mean('f1'),
                float(np.median(values)),
                mean('precision'),
                mean('recall'),
            )
        )
        rows.append(
            (
                *key,
                len(found),
                *(f1, median, precision, recall),
                *(f'{mean(name):.2%}' for name in ('flagged', 'conditional_flagged')),
                *(f'{mean(name):.1f}' for name in ('rules', 'conditional', 'seconds')),
            )
        )
    return markdown_table(_HEADS, rows) + '\n'


def _chosen(names: Sequence[str], known: dict[str, Any], what: str) -> list[str]:
    for name in names:
        if name not in known:
            raise ConfigurationError(f'there is no {what} {name!r}; allowed are {", ".join(known)}')
    return list(names or known)


def _key(task: Task) -> str:
    return ', '.join(map(str, task))


def _rounded(value: float) -> float:
    return round(float(value), 6)


def _document(lines: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {
        'lines': lines,
        'machine': machine(),
        'versions': versions(('numpy', 'scipy', 'scikit-learn')),
    }
