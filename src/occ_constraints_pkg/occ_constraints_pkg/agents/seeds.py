# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The same training with several seeds, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg.agents.evaluation import over_policies
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import make_directory
from occ_constraints_pkg.stopping import PARENT_VARIABLE, stop_request

_POLL_SECONDS = 0.5
_STOP_SECONDS = 30.0


def train_seeds(
    arguments: Sequence[str],
    seeds: Sequence[int],
    output: Path,
    *,
    progress: Callable[[dict[int, dict[str, Any]]], None] = lambda latest: None,
) -> list[Path]:
    """Run ``occ train`` once for each seed, as many at a time as there are cores.

    Args:
        arguments: of ``occ train``, but for seed, output and processes.
        seeds: the seeds.
        output: each training goes to ``seed_N`` in it.
        progress: called from time to time with the newest metrics of each seed that has any.

    Returns:
        The directories, in the order of the seeds.

    Raises:
        ConfigurationError: a training has ended with an error; the others are stopped, saved.
    """
    make_directory(output)
    found = sorted(item.name for item in output.iterdir())
    if found and not any(name.startswith('seed_') for name in found):
        raise ConfigurationError(
            f'{output} is not empty and holds no trainings (there is {found[0]!r}); allowed is a '
            'new directory, an empty one, or that of earlier seeds'
        )
    directories = {seed: output / f'seed_{seed}' for seed in seeds}
    waiting = list(seeds)
    running: dict[int, subprocess.Popen[bytes]] = {}
    # One core each: more processes per world would only compete.
    cores = len(os.sched_getaffinity(0))
    try:
        with stop_request.listening():
            while (waiting or running) and not stop_request.made:
                while waiting and len(running) < cores:
                    seed = waiting.pop(0)
                    running[seed] = _start(arguments, seed, directories[seed])
                for seed, process in list(running.items()):
                    if process.poll() is None:
                        continue
                    del running[seed]
                    if process.returncode:
                        raise ConfigurationError(f'seed {seed}: {_last_words(directories[seed])}')
                progress(_latest(directories))
                time.sleep(_POLL_SECONDS)
    finally:
        _stop(running.values())
    return list(directories.values())


def seeds_summary(
    directories: Sequence[Path],
) -> tuple[dict[str, Any], list[list[dict[str, Any]]]]:
    """Sum up trainings by their last metrics, and return all metrics as well.

    Args:
        directories: of the trainings; those without any metrics are left out.

    Returns:
        Per training and as a mean with its 95 % interval over trainings, the mean ``return`` and
        ``cost`` of the last finished episodes; and the metrics of each training.
    """
    histories = {path: read_metrics(path / 'metrics.jsonl') for path in directories}
    lines = [
        {
            'directory': str(path),
            'steps': history[-1]['steps'],
            'return': history[-1]['mean_return'],
            'cost': history[-1]['mean_cost'],
        }
        for path, history in histories.items()
        if history and history[-1]['mean_return'] is not None
    ]
    summary = {'seeds': lines, **(over_policies(lines) if lines else {})}
    return summary, [history for history in histories.values() if history]


def _start(arguments: Sequence[str], seed: int, directory: Path) -> subprocess.Popen[bytes]:
    make_directory(directory.parent)
    line = ['train', *arguments, '--seed', str(seed), '-o', str(directory), '--processes', '1']
    with _log(directory).open('wb') as log:
        return subprocess.Popen(
            [sys.executable, '-m', 'occ_constraints_pkg', *line],
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env={**os.environ, PARENT_VARIABLE: str(os.getpid()), 'OPENBLAS_NUM_THREADS': '1'},
            # Ctrl-C goes to all processes of the terminal; these are stopped by this one.
            start_new_session=True,
        )


def _stop(processes: Any) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _latest(directories: dict[int, Path]) -> dict[int, dict[str, Any]]:
    """Return the last line of metrics of each seed."""
    lines = {seed: read_metrics(path / 'metrics.jsonl') for seed, path in directories.items()}
    return {seed: history[-1] for seed, history in lines.items() if history}


def _log(directory: Path) -> Path:
    # Next to the directory, because a new training moves that aside.
    return directory.with_name(f'{directory.name}.log')


def _last_words(directory: Path) -> str:
    lines = _log(directory).read_text(encoding='utf-8', errors='replace').strip().splitlines()
    return lines[-1].removeprefix('error: ') if lines else 'the training ended without a word'
