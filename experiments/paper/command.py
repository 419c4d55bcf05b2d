# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``python -m experiments paper``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import make_directory
from occ_constraints_pkg.stopping import stop_request

from experiments.paper.experiments import (
    EXPERIMENTS,
    all_tables,
    progress_rows,
    wanted_jobs,
    write_page,
)
from experiments.paper.jobs import Job
from experiments.paper.pictures import draw
from experiments.paper.plan import QUICK, Scale
from experiments.paper.runner import run_jobs
from experiments.paper.store import Store
from experiments.results import markdown_table

_ROOT = Path(__file__).parents[2]
_PAGE = _ROOT / 'docs' / 'results.md'
_OUTPUT = _ROOT / 'docs' / 'results' / 'paper'
_WORKSPACE = _ROOT / 'runs' / 'paper'
_QUICK = _ROOT / 'runs' / 'paper_quick'
_REPORT_SECONDS = 60.0


def run_paper(
    names: Sequence[str],
    *,
    quick: bool = False,
    status: bool = False,
    tables: bool = False,
    workers: int = 0,
    seeds: int | None = None,
    trainings: bool = True,
    output: Path | None = None,
    workspace: Path | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run experiments of the paper, or tell how far they are.

    Args:
        names: of the experiments; all if empty.
        quick: everything small.
        status: run nothing, and tell how far they are.
        tables: run nothing, and make tables and pictures of the store.
        workers: runs at a time; 0: one per core.
        seeds: run only so many of the first seeds.
        trainings: run also what trains, or needs a training.
        output: folder of the store and of pictures.
        workspace: folder for the files of runs.
        report: called with sentences for the user.

    Returns:
        The table of progress as rows and as text, and why which run failed.

    Raises:
        ConfigurationError: there is no such experiment, or another process works there.
    """
    for name in names:
        if name not in EXPERIMENTS:
            hint = did_you_mean(name, list(EXPERIMENTS)) or ';'
            raise ConfigurationError(
                f'there is no experiment {name!r}{hint} allowed are {", ".join(EXPERIMENTS)}'
            )
    names = list(names) or list(EXPERIMENTS)
    scale = QUICK if quick else Scale()
    output = output or (_QUICK / 'results' if quick else _OUTPUT)
    workspace = workspace or (_QUICK / 'work' if quick else _WORKSPACE)
    store = Store(output)
    failed: dict[str, str] = {}
    command = ' '.join(['python -m experiments paper', *names, *(['--quick'] if quick else [])])
    if not status and not tables:
        jobs = wanted_jobs(names, scale, seeds, trainings=trainings)
        failed = _run(jobs, store, workspace, workers, command, report)
    lines = store.lines()
    if not status:
        # The page of the documentation shows the committed results.
        page = _PAGE if output.resolve() == _OUTPUT else output / 'results.md'
        make_directory(output)
        write_page(_PAGE, page, all_tables(lines, scale))
        draw(lines, scale, output)
    rows = progress_rows(names, scale, lines, workspace, workers)
    return {'progress': rows, 'failed': failed, 'text': _progress_text(rows)}


def _run(
    jobs: Sequence[Job],
    store: Store,
    workspace: Path,
    workers: int,
    command: str,
    report: Callable[[str], None],
) -> dict[str, str]:
    last, reported = time.monotonic(), -1

    def progress(done: int, total: int) -> None:
        nonlocal last, reported
        if done == reported or (time.monotonic() - last < _REPORT_SECONDS and done < total):
            return
        last, reported = time.monotonic(), done
        report(f'{done} of {total} runs done')

    failed = run_jobs(
        jobs,
        store,
        workspace,
        workers=workers,
        command=command,
        progress=progress,
        is_stopped=lambda: stop_request.made,
    )
    for job, why in failed.items():
        report(f'failed: {job}: {why}')
    return failed


def _progress_text(rows: Sequence[dict[str, Any]]) -> str:
    shown = [
        [
            *(row[name] for name in ('experiment', 'runs', 'done', 'to do with what they need')),
            f'{row["million steps left"]:.1f}',
            '-' if row['hours left'] is None else f'{row["hours left"]:.1f}',
        ]
        for row in rows
    ]
    return markdown_table(list(rows[0]), shown)
