# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Training in one process: world, cost and learner in a plain loop."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import make_directory, replacing, set_aside
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.stream import EpisodeStream, StepBatch

if TYPE_CHECKING:
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
    from occ_constraints_pkg.agents.settings import TrainingMetrics

_SAVE_SECONDS = 30.0


class CostSource(Protocol):
    """Whatever says what the states just reached cost: any callable of this form will do."""

    def __call__(self, batch: StepBatch) -> np.ndarray:
        """Return the cost of each robot's state, (N,) finite, 0 or 1.

        Called once per step, in order, so that a source may keep what it needs of earlier steps.
        """


class TrueCost:
    """The world's own cost, which no learned rule sees: the baseline called *expert*."""

    def __call__(self, batch: StepBatch) -> np.ndarray:
        """Return ``batch.true_cost``."""
        return batch.true_cost


def train(
    world: World,
    learner: PPOLagrangian,
    cost_source: CostSource,
    *,
    seed: int,
    total_steps: int | None = None,
    seconds: float | None = None,
    progress: Callable[[TrainingMetrics], None] | None = None,
    directory: TrainingDirectory | None = None,
) -> list[TrainingMetrics]:
    """Train until the learner has seen ``total_steps``, or for ``seconds``, whichever is first.

    Args:
        world: starts new episodes at once; what the learner had half open is forgotten.
        learner: continues from where it is, so its steps count from its own beginning.
        cost_source: tells the cost of each state reached.
        seed: of the world's generators.
        total_steps: robot steps, summed over robots, since the learner was made.
        seconds: wall time of this call.
        progress: called after each update.
        directory: takes the metrics of each update, and policy and checkpoint from time to time.

    Returns:
        The metrics of each update made here.

    Raises:
        OccError: no end was given, or the learner belongs to another world.
    """
    if total_steps is None and seconds is None:
        raise OccError('training has no end: got neither total_steps nor seconds; give one')
    learner.policy().check_world(world.columns, world.action_columns)
    learner.interrupt()
    stream = EpisodeStream(world, seed=seed)
    batch = stream.reset()
    history: list[TrainingMetrics] = []
    end = math.inf if seconds is None else time.monotonic() + seconds
    limit = math.inf if total_steps is None else total_steps
    while learner.steps < limit and time.monotonic() < end:
        before = learner.updates
        action = learner.act(batch, cost_source(batch))
        if learner.updates > before:
            history.append(learner.metrics)
            if directory is not None:
                directory.add(learner)
            if progress is not None:
                progress(learner.metrics)
        batch = stream.step(action)
    return history


class TrainingDirectory:
    """Where a training leaves its metrics, policy, checkpoint and a summary.

    An earlier training in the same place is moved aside, not overwritten. Policy and checkpoint
    are saved every 30 s, so that a crash costs no more than that.

    Args:
        path: the directory; made if it is not there.

    Raises:
        OccError: it cannot be written to.
    """

    _METRICS = 'metrics.jsonl'

    def __init__(self, path: str | Path) -> None:
        self.path = make_directory(path)
        self._saved_at = time.monotonic()

    def begin(self) -> Path | None:
        """Make room for a new training; return where an earlier one has been moved, if any."""
        earlier = None
        if (self.path / self._METRICS).exists():
            earlier = set_aside(self.path)
            make_directory(self.path)
        return earlier

    def add(self, learner: PPOLagrangian) -> None:
        """Note the metrics of the update just made, and save when it is time to.

        Raises:
            OccError: a file cannot be written.
        """
        numbers = {
            name: value if math.isfinite(value) else None
            for name, value in learner.metrics.as_dict().items()
        }
        log = self.path / self._METRICS
        try:
            with log.open('a', encoding='utf-8') as file:
                file.write(json.dumps(numbers) + '\n')
        except OSError as error:
            raise OccError(f'cannot write {log}: {error.strerror}') from error
        if time.monotonic() - self._saved_at > _SAVE_SECONDS:
            self.save(learner)

    def save(self, learner: PPOLagrangian) -> None:
        """Save policy and checkpoint, unless nothing has been learned yet.

        Raises:
            OccError: a file cannot be written; the ones before stay.
        """
        if learner.updates:
            learner.policy().save(self.path / 'policy.npz')
            learner.save(self.path / 'checkpoint.pt')
            with replacing(self.path / 'summary.json') as draft:
                summary = {'steps': learner.steps, 'updates': learner.updates}
                draft.write_text(json.dumps(summary), encoding='utf-8')
            self._saved_at = time.monotonic()
