# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Planted problems: how well known rules are found, and how often rules that are not there.

Run it as ``python -m occ_constraints_pkg.experiments.planted --help``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.experiments.conditions import machine, versions
from occ_constraints_pkg.experiments.planted_methods import METHODS
from occ_constraints_pkg.experiments.planted_problems import MADE_UP, SIZES, Problem
from occ_constraints_pkg.experiments.planted_simulated import SIMULATED
from occ_constraints_pkg.files import make_directory, replacing
from occ_constraints_pkg.learning.scoring import score_flags

PROBLEMS: dict[str, Callable[[str, int], Problem]] = dict(sorted((MADE_UP | SIMULATED).items()))
"""Every problem by its name: (size, seed) to the problem."""

SEEDS = (1, 2, 3, 4, 5)
"""Seeds that results are reported on; nothing was tuned on them."""

_QUICK = {'problems': ('A3', 'A6', 'B1'), 'sizes': ('1e4',), 'seeds': (1,)}
Task = tuple[str, str, int, str]


def run_planted(
    output: Path,
    *,
    problems: Sequence[str] = (),
    sizes: Sequence[str] = (),
    seeds: Sequence[int] = SEEDS,
    methods: Sequence[str] = (),
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Run what ``output/planted.json`` lacks yet; write that file and ``planted.md``.

    The files are brought up to date after each line, so a stopped run can be continued.

    Args:
        output: directory of the results.
        problems: names; all if empty.
        sizes: keys of :data:`~occ_constraints_pkg.experiments.planted_problems.SIZES`; all if
            empty.
        seeds: one line each.
        methods: names; all if empty.
        processes: that work at once.
        progress: called with (lines done, lines in all).

    Raises:
        OccError: a name is not known.
    """
    chosen = [
        _chosen(names, known, what)
        for names, known, what in (
            (problems, PROBLEMS, 'problem'),
            (sizes, SIZES, 'size'),
            (methods, METHODS, 'method'),
        )
    ]
    make_directory(output)
    file = output / 'planted.json'
    lines = json.loads(file.read_text(encoding='utf-8'))['lines'] if file.exists() else {}
    wanted = [
        (problem, size, seed, method)
        for problem in chosen[0]
        for size in chosen[1]
        for seed in seeds
        for method in chosen[2]
    ]
    todo = [task for task in wanted if _key(task) not in lines]
    done = len(wanted) - len(todo)

    def finish(task: Task, line: dict[str, Any]) -> None:
        nonlocal done
        lines[_key(task)] = line
        _write(output, lines)
        done += 1
        if progress is not None:
            progress(done, len(wanted))

    if processes <= 1:
        for task in todo:
            finish(task, run_one(*task))
    else:
        with ProcessPoolExecutor(processes) as pool:
            running = {pool.submit(run_one, *task): task for task in todo}
            for future in as_completed(running):
                finish(running[future], future.result())
    return lines


def run_one(problem: str, size: str, seed: int, method: str) -> dict[str, Any]:
    """Learn one problem with one method and judge the result.

    Args:
        problem: its name.
        size: key of :data:`~occ_constraints_pkg.experiments.planted_problems.SIZES`.
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
        line = {name: _rounded(getattr(score, name)) for name in line}
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
    rows = [
        '| problem | samples | method | seeds | F1 | median | precision | recall | fresh flagged | '
        'by conditions | rules | conditional | seconds |',
        '|---|---|---|---|---|---|---|---|---|---|---|---|---|',
    ]
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
            f'| {key[0]} | {key[1]} | {key[2]} | {len(found)} | {f1} | {median} | {precision} | '
            f'{recall} | {mean("flagged"):.2%} | {mean("conditional_flagged"):.2%} | '
            f'{mean("rules"):.1f} | {mean("conditional"):.1f} | {mean("seconds"):.1f} |'
        )
    return '\n'.join(rows) + '\n'


def _chosen(names: Sequence[str], known: dict[str, Any], what: str) -> list[str]:
    for name in names:
        if name not in known:
            raise OccError(f'there is no {what} {name!r}; allowed are {", ".join(known)}')
    return list(names or known)


def _key(task: Task) -> str:
    return ', '.join(map(str, task))


def _rounded(value: float) -> float:
    return round(float(value), 6)


def _write(output: Path, lines: dict[str, dict[str, Any]]) -> None:
    result = {
        'lines': lines,
        'machine': machine(),
        'versions': versions(('numpy', 'scipy', 'scikit-learn')),
    }
    with replacing(output / 'planted.json') as part:
        part.write_text(json.dumps(result, indent=1) + '\n', encoding='utf-8')
    with replacing(output / 'planted.md') as part:
        part.write_text(table(lines), encoding='utf-8')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog='planted', description='How well planted rules are found, beside other learners.'
    )
    parser.add_argument('-o', '--output', type=Path, default=Path('planted_results'))
    parser.add_argument('--problems', nargs='*', default=(), help=f'of {", ".join(PROBLEMS)}')
    parser.add_argument('--sizes', nargs='*', default=(), help=f'of {", ".join(SIZES)}')
    parser.add_argument('--seeds', nargs='*', type=int, default=SEEDS)
    parser.add_argument('--methods', nargs='*', default=(), help=f'of {", ".join(METHODS)}')
    parser.add_argument('--processes', type=int, default=1)
    parser.add_argument('--quick', action='store_true', help='three problems, one size, one seed')
    parser.add_argument('--json', action='store_true', help='print the results as JSON')
    given = vars(parser.parse_args(arguments))
    as_json, quick = given.pop('json'), given.pop('quick')
    if quick:
        given |= _QUICK
    try:
        lines = run_planted(given.pop('output'), **given)
    except OccError as error:
        print(f'planted: {error}', file=sys.stderr)
        return 2
    print(json.dumps(lines, indent=1) if as_json else table(lines), end='')
    return 0


if __name__ == '__main__':
    sys.exit(main())
