# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Every experiment by name, what is left to do, and the page of results."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.files import TABLE, write_text

from experiments.paper import depth, highway, pruning, safety_gym, simple_nav, transfer
from experiments.paper.jobs import RESULT, Job, in_order
from experiments.paper.plan import Scale
from experiments.paper.tables import Lines

EXPERIMENTS: dict[str, Any] = {
    'simple_nav': simple_nav,
    'safety_gym': safety_gym,
    'transfer': transfer,
    'depth': depth,
    'highway': highway,
    'pruning': pruning,
}
"""Modules with ``jobs(scale)`` and ``tables(lines, scale)``, by name."""

_BLOCK = re.compile(r'(<!-- table (\w+) -->\n).*?(\n?<!-- end -->)', re.DOTALL)


def wanted_jobs(
    names: Sequence[str], scale: Scale, seeds: int | None = None, *, trainings: bool = True
) -> list[Job]:
    """Return the runs of some experiments, each once, those without training first.

    Args:
        names: of the experiments.
        scale: the runs.
        seeds: only so many of the first seeds; None: all.
        trainings: also those that train, or need a training.
    """
    jobs = {job.id: job for name in names for job in EXPERIMENTS[name].jobs(scale)}
    chosen = [job for job in jobs.values() if seeds is None or job.seed < seeds]
    return sorted((job for job in chosen if trainings or not job.trains), key=lambda x: x.trains)


def all_tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the tables of all experiments, by name, from the store alone."""
    found: dict[str, str] = {}
    for module in EXPERIMENTS.values():
        found |= module.tables(lines, scale)
    return found


def with_tables(page: str, tables: Mapping[str, str]) -> str:
    """Return a page with the newest tables.

    Args:
        page: text with places for tables, from ``<!-- table NAME -->`` to ``<!-- end -->``.
        tables: by name.
    """

    def block(match: re.Match[str]) -> str:
        return f'{match[1]}{tables[match[2]]}\n<!-- end -->'

    return _BLOCK.sub(block, page)


def write_page(template: Path, path: Path, tables: Mapping[str, str]) -> None:
    """Write a page with the newest tables.

    Args:
        template: page whose tables may be old.
        path: where to write it, possibly the same.
        tables: by name.

    Raises:
        OccError: it cannot be written.
    """
    write_text(path, TABLE, with_tables(template.read_text(encoding='utf-8'), tables))


def progress_rows(
    names: Sequence[str], scale: Scale, lines: Lines, workspace: Path, workers: int
) -> list[dict[str, Any]]:
    """Return how far each experiment is.

    The time that is left is estimated from the seconds that runs of the same kind took for each
    robot step, in the same world if there were any.

    Args:
        names: of the experiments.
        scale: the runs.
        lines: of the store.
        workspace: holds the files of runs.
        workers: how many run at a time; 0: one per core.
    """
    workers = workers or len(os.sched_getaffinity(0))
    rows = []
    for name in names:
        jobs = wanted_jobs([name], scale)
        left = in_order(jobs, lines, workspace)
        made = {job.id: _steps_made(job, workspace) for job in left}
        seconds = [_seconds_left(job, made[job.id], lines) for job in left]
        known = [value for value in seconds if value is not None]
        rows.append(
            {
                'experiment': name,
                'runs': len(jobs),
                'done': sum(job.id in lines for job in jobs),
                'to do with what they need': len(left),
                'million steps left': sum(job.size - made[job.id] for job in left) / 1e6,
                'hours left': sum(known) / workers / 3600 if len(known) == len(left) else None,
            }
        )
    return rows


def _steps_made(job: Job, workspace: Path) -> int:
    folder = workspace / job.folder
    if (folder / RESULT).exists():
        return job.size
    if not job.size or not (folder / 'training' / 'metrics.jsonl').exists():
        return 0
    metrics = read_metrics(folder / 'training' / 'metrics.jsonl')
    return min(job.size, metrics[-1]['steps']) if metrics else 0


def _seconds_left(job: Job, made: int, lines: Lines) -> float | None:
    """Return the seconds that a run will take; None if nothing like it was ever run."""
    if made and made == job.size:
        return 0.0
    world = job.arguments.get('target')
    taken: dict[bool, list[tuple[float, float]]] = defaultdict(list)
    for line in lines.values():
        if line['kind'] == job.kind:
            size = line['arguments'].get('steps', 1) if job.size else 1
            taken[line['arguments'].get('target') == world].append((line['seconds'], size))
    pairs = taken[True] or taken[False]
    if not pairs:
        return None
    rate = sum(seconds for seconds, _ in pairs) / sum(size for _, size in pairs)
    return rate * ((job.size - made) if job.size else 1)
