# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a run is: a function of plain arguments and of the files of other runs."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import RESULTS, DirectoryLock, make_directory, write_text

RESULT = 'result.json'
"""Name of the file in a run's folder that tells that it is complete."""

_LOCK_SECONDS = 300.0

FUNCTIONS = {
    'states': 'experiments.paper.demonstrations:drive_heedlessly',
    'rules': 'experiments.paper.demonstrations:learn_rules',
    'training': 'experiments.paper.trainings:train_policy',
    'baselines': 'experiments.paper.baseline_scores:score_baselines',
    'simple_nav': 'experiments.paper.simple_nav:follow_example',
    'depth': 'experiments.paper.depth:compare_depths',
    'pruning': 'experiments.paper.pruning:prune_counted',
    'traffic_rules': 'experiments.paper.highway:learn_traffic',
    'highway': 'experiments.paper.highway:train_driver',
}
"""The function of each kind of run: ``(folder, needs, **arguments)`` to plain values."""


@dataclass(frozen=True)
class Job:
    """One run. Whatever performs it needs its arguments, and the folders of the runs it needs.

    Attributes:
        kind: key of :data:`FUNCTIONS`.
        arguments: plain values that determine the result, with those of the runs that it needs.
        needs: runs whose files this one reads, by the name under which it gets their folders.
        size: how much work it is, in robot steps of training; 0: little.
    """

    kind: str
    arguments: Mapping[str, Any]
    needs: Mapping[str, Job] = field(default_factory=dict)
    size: int = 0

    @property
    def id(self) -> str:
        """The text that identifies it in the store."""
        return f'{self.kind} {", ".join(f"{k}={v}" for k, v in self.arguments.items())}'

    @property
    def seed(self) -> int:
        """The seed that it or a run that it needs has; the largest, if there are several."""
        own = self.arguments.get('seed', 0)
        return max([own, *(need.seed for need in self.needs.values())])

    @property
    def trains(self) -> bool:
        """Whether it or a run that it needs is a training."""
        return self.size > 0 or any(need.trains for need in self.needs.values())

    @property
    def folder(self) -> str:
        """The path of its folder in a workspace."""
        words = '_'.join(str(value) for value in self.arguments.values())
        return f'{self.kind}/{re.sub(r"[^A-Za-z0-9_.-]+", "-", words)}'

    def is_complete(self, workspace: Path) -> bool:
        """Tell whether a workspace holds its result and its files."""
        return (workspace / self.folder / RESULT).exists()

    def result(self, workspace: Path) -> dict[str, Any]:
        """Return the result that a workspace holds."""
        return read_json_object(workspace / self.folder / RESULT)

    def as_text(self) -> str:
        """Return all that :func:`perform` needs, as JSON."""
        return json.dumps(
            {
                'kind': self.kind,
                'arguments': dict(self.arguments),
                'folder': self.folder,
                'needs': {name: job.folder for name, job in self.needs.items()},
            }
        )


def in_order(wanted: Iterable[Job], done: Iterable[str], workspace: Path) -> list[Job]:
    """Return the runs that are to be performed, each after those that it needs.

    A run that is done but whose files the workspace lacks is performed again if a run that is not
    done needs it: results travel with the repository, trained policies do not.

    Args:
        wanted: the runs whose results are wanted, the most urgent first.
        done: ids of runs whose results are there.
        workspace: holds the files of runs.
    """
    done, order = set(done), {}

    def add(job: Job) -> None:
        if job.id in order:
            return
        for need in job.needs.values():
            if not need.is_complete(workspace):
                add(need)
        order[job.id] = job

    for job in wanted:
        if job.id not in done:
            add(job)
    return list(order.values())


def perform(text: str, workspace: Path) -> dict[str, Any]:
    """Perform a run, unless its folder holds its result, and return the result.

    Everything that an executor has to call: it reads nothing but the text and files of the
    workspace, and writes nothing but the run's folder. One that was cut goes on.

    Args:
        text: from :meth:`Job.as_text`.
        workspace: where the folders of runs are.
    """
    job = json.loads(text)
    folder = make_directory(workspace / job['folder'])
    lock = _locked(folder)
    if not (folder / RESULT).exists():
        module, _, name = FUNCTIONS[job['kind']].partition(':')
        function: Callable[..., dict[str, Any]] = getattr(import_module(module), name)
        needs = {name: workspace / path for name, path in job['needs'].items()}
        result = function(folder, needs, **job['arguments'])
        write_text(folder / RESULT, RESULTS, json.dumps(result, allow_nan=False))
    del lock
    return read_json_object(folder / RESULT)


def _locked(folder: Path) -> DirectoryLock:
    """Wait until nobody performs this run: a process whose runner was killed needs time to end."""
    end = time.monotonic() + _LOCK_SECONDS
    while True:
        try:
            return DirectoryLock(folder)
        except ConfigurationError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)
