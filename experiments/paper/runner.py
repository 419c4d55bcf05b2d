# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Performs runs in parallel, one process each, and appends their results to the store."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from occ_constraints_pkg.files import DirectoryLock, make_directory
from occ_constraints_pkg.stopping import PARENT_VARIABLE

import occ_constraints_pkg
from benchmarks.conditions import machine, versions
from experiments.paper.jobs import Job, in_order
from experiments.paper.store import Store
from experiments.paper.work import STOPPED

_ROOT = Path(__file__).parents[2]
_POLL_SECONDS = 0.1
_STOP_SECONDS = 60.0
_PACKAGES = ('numpy', 'scipy', 'torch', 'mujoco', 'scikit-learn')
# One thread for each run: there are as many runs as cores.
_SINGLE = {f'{name}_NUM_THREADS': '1' for name in ('OMP', 'OPENBLAS', 'MKL')}


def run_jobs(
    wanted: Sequence[Job],
    store: Store,
    workspace: Path,
    *,
    workers: int = 0,
    command: str = '',
    progress: Callable[[int, int], None] = lambda *_: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> dict[str, str]:
    """Perform the runs whose results the store lacks, and those that they need.

    Whatever ends this function, a power cut included: called again, it goes on.

    Args:
        wanted: the runs, the most urgent first.
        store: gets a line for each run.
        workspace: for the files of runs.
        workers: runs at a time; 0: one per core.
        command: kept in the store.
        progress: called with (runs done, runs in all).
        is_stopped: asked now and then; ``True`` stops all runs, saved.

    Returns:
        Why a run failed, by its id; those that need it are not performed either.

    Raises:
        ConfigurationError: another process is working in the workspace.
        OccError: the store cannot be read or written.
    """
    # The processes of runs start in the root of the clone.
    workspace = make_directory(workspace).resolve()
    lock = DirectoryLock(workspace)
    waiting = in_order(wanted, store.lines(), workspace)
    total = len(waiting)
    running: dict[str, tuple[Job, subprocess.Popen[bytes], float]] = {}
    failed: dict[str, str] = {}
    common = {
        'command': command,
        'commit': _commit(),
        'package': occ_constraints_pkg.__version__,
        'versions': versions(_PACKAGES),
        'machine': machine(),
    }

    def finish(job: Job, seconds: float) -> None:
        result = job.result(workspace)
        store.append(
            job.kind,
            {
                'id': job.id,
                'kind': job.kind,
                'arguments': dict(job.arguments),
                'result': result,
                # A training that went on after a cut knows how long it took in all.
                'seconds': round(result.pop('seconds', seconds), 1),
                'finished': datetime.now(UTC).isoformat(timespec='seconds'),
                **common,
            },
        )

    with _ending(running):
        while (waiting or running) and not is_stopped():
            for job in _ready(waiting, running, failed, workspace):
                if job.is_complete(workspace):
                    finish(job, 0.0)
                elif len(running) < (workers or len(os.sched_getaffinity(0))):
                    running[job.id] = job, _start(job, workspace), time.monotonic()
                else:
                    break
                waiting.remove(job)
            for job, process, since in list(running.values()):
                if process.poll() is None:
                    continue
                del running[job.id]
                if process.returncode == 0:
                    finish(job, time.monotonic() - since)
                elif process.returncode != STOPPED or not is_stopped():
                    failed[job.id] = _last_words(job, workspace, process.returncode)
            waiting = [job for job in waiting if not _needs_any(job, failed)]
            progress(total - len(waiting) - len(running), total)
            time.sleep(_POLL_SECONDS)
    del lock
    return failed


def _ready(
    waiting: Sequence[Job], running: Mapping[str, Any], failed: Mapping[str, str], workspace: Path
) -> list[Job]:
    """Return the runs that could be started now, the most urgent first."""
    return [
        job
        for job in waiting
        if job.id not in running
        and job.id not in failed
        and all(need.is_complete(workspace) for need in job.needs.values())
    ]


def _needs_any(job: Job, failed: Mapping[str, str]) -> bool:
    return any(need.id in failed or _needs_any(need, failed) for need in job.needs.values())


def _start(job: Job, workspace: Path) -> subprocess.Popen[bytes]:
    log = _log(job, workspace)
    make_directory(log.parent)
    with log.open('wb') as file:
        return subprocess.Popen(
            [sys.executable, '-m', 'experiments.paper.work', job.as_text(), str(workspace)],
            cwd=_ROOT,
            stdout=file,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env={**os.environ, **_SINGLE, PARENT_VARIABLE: str(os.getpid())},
            # Ctrl-C goes to all processes of the terminal; these are stopped by this one.
            start_new_session=True,
        )


@contextmanager
def _ending(running: Mapping[str, tuple[Job, subprocess.Popen[bytes], float]]) -> Iterator[None]:
    """End the processes that still run after the block, whatever ended it."""
    try:
        yield
    finally:
        processes = [process for _, process, _ in running.values()]
        for process in processes:
            process.terminate()
        for process in processes:
            try:
                process.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _log(job: Job, workspace: Path) -> Path:
    return workspace / f'{job.folder}.log'


def _last_words(job: Job, workspace: Path, code: int) -> str:
    log = _log(job, workspace)
    lines = log.read_text(encoding='utf-8', errors='replace').strip().splitlines()
    words = lines[-1].removeprefix('error: ') if lines else f'it ended with code {code}'
    return f'{words} (all that it said is in {log})'


def _commit() -> str | None:
    """Return the commit of this clone, marked where files differ from it; None elsewhere."""
    try:
        done = subprocess.run(
            ['git', 'describe', '--always', '--abbrev=12', '--dirty=+', '--exclude=*'],
            cwd=_ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
