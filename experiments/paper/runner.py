# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Performs runs in parallel, in processes of their own, and appends their results to the store."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from occ_constraints_pkg.files import DirectoryLock, make_directory
from occ_constraints_pkg.stopping import PARENT_VARIABLE

import occ_constraints_pkg
from benchmarks.conditions import machine, versions
from experiments.paper.jobs import Job, in_order
from experiments.paper.store import Store

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
    # The processes start in the root of the clone.
    workspace = make_directory(workspace).resolve()
    lock = DirectoryLock(workspace)
    waiting = in_order(wanted, store.lines(), workspace)
    total = len(waiting)
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
        # A training that went on after a cut knows how long it took in all.
        seconds = result.pop('seconds', seconds)
        line = {'id': job.id, 'kind': job.kind, 'arguments': dict(job.arguments), 'result': result}
        line |= {'seconds': round(seconds, 1), **common}
        line['finished'] = datetime.now(UTC).isoformat(timespec='seconds')
        store.append(job.kind, line)

    count = workers or len(os.sched_getaffinity(0))
    processes = [_Process(workspace, number) for number in range(min(count, total))]
    with ThreadPoolExecutor(max(1, len(processes))) as threads, _ending(processes):
        idle = list(processes)
        running: dict[str, tuple[Job, _Process, Future[dict[str, str]], float]] = {}
        while (waiting or running) and not is_stopped():
            for job in _ready(waiting, workspace):
                if job.is_complete(workspace):
                    finish(job, 0.0)
                elif idle:
                    process = idle.pop()
                    future = threads.submit(process.perform, job)
                    running[job.id] = job, process, future, time.monotonic()
                else:
                    break
                waiting.remove(job)
            for job, process, future, since in list(running.values()):
                if not future.done():
                    continue
                del running[job.id]
                idle.append(process)
                answer = future.result()
                if answer:
                    failed[job.id] = answer.get('error', 'it was stopped by somebody else')
                else:
                    finish(job, time.monotonic() - since)
            waiting = [job for job in waiting if not _needs_any(job, failed)]
            progress(total - len(waiting) - len(running), total)
            time.sleep(_POLL_SECONDS)
    del lock
    return failed


def _ready(waiting: Sequence[Job], workspace: Path) -> list[Job]:
    """Return the runs that could be started now, the most urgent first."""
    return [
        job for job in waiting if all(need.is_complete(workspace) for need in job.needs.values())
    ]


def _needs_any(job: Job, failed: Mapping[str, str]) -> bool:
    return any(need.id in failed or _needs_any(need, failed) for need in job.needs.values())


class _Process:
    """A process of :mod:`~experiments.paper.work`, started when it is first needed.

    Args:
        workspace: where it works.
        number: of the process; names its log.
    """

    def __init__(self, workspace: Path, number: int) -> None:
        self._workspace, self._log = workspace, workspace / f'process_{number}.log'
        self._process: subprocess.Popen[str] | None = None

    def perform(self, job: Job) -> dict[str, str]:
        """Perform a run; return nothing if it is done, else why it is not."""
        if self._process is None:
            self._process = self._start()
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            print(job.as_text(), file=process.stdin, flush=True)
            answer = process.stdout.readline()
        except BrokenPipeError:
            answer = ''
        if not answer:
            self._process = None
            code = process.wait()
            return {'error': f'its process ended with code {code}; what it said is in {self._log}'}
        return json.loads(answer)

    def _start(self) -> subprocess.Popen[str]:
        with self._log.open('ab') as log:
            return subprocess.Popen(
                [sys.executable, '-m', 'experiments.paper.work', str(self._workspace)],
                cwd=_ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                env={**os.environ, **_SINGLE, PARENT_VARIABLE: str(os.getpid())},
                # Ctrl-C goes to all processes of the terminal; these are stopped by this one.
                start_new_session=True,
            )

    def end(self) -> None:
        """Ask it to end, saved; end it if it does not."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        process.terminate()
        try:
            process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def _ending(processes: Sequence[_Process]) -> Iterator[None]:
    """End the processes after the block, whatever ended it."""
    try:
        yield
    finally:
        with ThreadPoolExecutor(max(1, len(processes))) as threads:
            list(threads.map(_Process.end, processes))


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
