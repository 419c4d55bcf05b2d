# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Training in one process: world, cost and learner in a plain loop."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.archives import describe
from occ_constraints_pkg.errors import ConfigurationError, DataError, OccError
from occ_constraints_pkg.files import (
    ARCHIVE,
    CONSTRAINTS,
    RESULTS,
    DirectoryLock,
    check_outputs,
    make_directory,
    read_bytes,
    set_aside,
    write_text,
)
from occ_constraints_pkg.rules.constraints_file import save_derived
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.stream import EpisodeStream, StepBatch

if TYPE_CHECKING:
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
    from occ_constraints_pkg.agents.settings import TrainingMetrics

_SAVE_SECONDS = 10.0
# Limit of the metrics file, which has a line of some 300 bytes for each update.
_METRICS_BYTES = 64 << 20


class CostSource(Protocol):
    """A callable that returns the cost of the states just reached."""

    def __call__(self, batch: StepBatch) -> np.ndarray:
        """Return the cost of each robot's state, (N,) finite, 0 or 1.

        Called once per step, in order, so a source may depend on earlier steps.
        """


class TrueCost:
    """The cost of the world, not of learned rules: the baseline called *expert*."""

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
    resumed: Mapping[str, Any] | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> list[TrainingMetrics]:
    """Train until the learner has seen ``total_steps``, or for ``seconds``, whichever is first.

    Args:
        world: starts new episodes; an open transition of the learner is dropped.
        learner: continues from its present state; its steps count from its creation.
        cost_source: returns the cost of each state reached.
        seed: of the world's generators.
        total_steps: robot steps, summed over robots, since the learner was made.
        seconds: wall time of this call.
        progress: called after each update.
        directory: receives the metrics of each update, and policy and checkpoint periodically and
            at the end.
        resumed: the companions from :meth:`TrainingDirectory.resume`: the world and the rule
            counters continue from there, and no transition is dropped.
        is_stopped: called before each step; ``True`` ends the training.

    Returns:
        The metrics of each update made here.

    Raises:
        ConfigurationError: no end was given, or the learner belongs to another world.
        DataError: the checkpoint that was resumed is damaged.
    """
    if total_steps is None and seconds is None:
        raise ConfigurationError(
            'training has no end: got neither total_steps nor seconds; give one'
        )
    learner.policy().check_world(world.columns, world.action_columns)
    stream = EpisodeStream(world, seed=seed)
    if resumed is None:
        learner.interrupt()
        batch = stream.reset()
    else:
        try:
            batch = stream.restore(resumed['stream'])
            if isinstance(cost_source, RuleCost):
                cost_source.counts.evaluated[:] = resumed['counts']['evaluated']
                cost_source.counts.violated[:] = resumed['counts']['violated']
        except OccError:
            raise
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise DataError(
                f'the checkpoint is damaged: what it says of the world cannot be used '
                f'({type(error).__name__}: {describe(error)}); allowed is what a training has saved'
            ) from error
    history: list[TrainingMetrics] = []
    end = math.inf if seconds is None else time.monotonic() + seconds
    limit = math.inf if total_steps is None else total_steps
    while learner.steps < limit and (now := time.monotonic()) < end and not is_stopped():
        if seconds is not None:
            learner.time_share = 1.0 - (end - now) / seconds
        before = learner.updates
        action = learner.act(batch, cost_source(batch))
        updated = learner.updates > before
        batch = stream.step(action)
        if updated:
            assert learner.metrics is not None
            history.append(learner.metrics)
            if directory is not None:
                directory.add(learner)
                if directory.is_due:
                    directory.save(learner, stream, cost_source)
            if progress is not None:
                progress(learner.metrics)
    if directory is not None:
        directory.save(learner, stream, cost_source)
    return history


class TrainingDirectory:
    """The directory of a training: metrics, policy, checkpoint and a summary.

    An earlier training there is moved aside, not overwritten. Policy and checkpoint are saved after
    the first update and then every 10 s, so that a crash costs no more than that. :meth:`begin` and
    :meth:`resume` lock the directory against other trainings.

    Args:
        path: the directory; created if it does not exist.
        settings: the settings of world and learner; stored in the checkpoint.

    Raises:
        OccError: it cannot be written to.
    """

    _METRICS = 'metrics.jsonl'
    _CHECKPOINT = 'checkpoint.pt'
    _RULES = 'constraints.yaml'

    def __init__(self, path: str | Path, settings: Mapping[str, Any] | None = None) -> None:
        self.path = make_directory(path)
        self._settings = dict(settings or {})
        self._saved_at = -math.inf
        self._lock: DirectoryLock | None = None

    def begin(self) -> Path | None:
        """Make room for a new training; return where an earlier one has been moved, if any.

        Raises:
            ConfigurationError: another training is writing there, or the directory holds something
                else.
        """
        self._claim()
        self.check_begin()
        earlier = None
        if (self.path / self._METRICS).exists():
            earlier = set_aside(self.path)
            make_directory(self.path)
            self._claim()
        return earlier

    def check_begin(self) -> None:
        """Refuse to begin among files that are not a training's.

        Raises:
            ConfigurationError: there are some and no training is there.
        """
        found = sorted(item.name for item in self.path.iterdir())
        if found and self._METRICS not in found:
            raise ConfigurationError(
                f'{self.path} is not empty and holds no training (there is {found[0]!r}); allowed '
                'is a new directory, an empty one, or that of an earlier training'
            )

    def keep_apart(self, inputs: Iterable[str | Path]) -> None:
        """Refuse to write any of its files over one that is read.

        Raises:
            ConfigurationError: one of the inputs is in this directory, by whatever name or link.
        """
        kinds = {
            self._RULES: CONSTRAINTS,
            self._METRICS: RESULTS,
            self._CHECKPOINT: ARCHIVE,
            'policy.npz': ARCHIVE,
            'summary.json': RESULTS,
        }
        check_outputs(((self.path / name, kind) for name, kind in kinds.items()), inputs)

    def check_world(self, learner: PPOLagrangian, world: str) -> None:
        """Refuse to go on in another world than the one that was trained in.

        Raises:
            ConfigurationError: the learner belongs to another world (possibly with equal columns).
        """
        if learner.world_name != world:
            raise ConfigurationError(
                f'the training in {self.path} is one of {learner.world_name}, and '
                f'the simulation is {world}; allowed is that of the training'
            )

    def _claim(self) -> None:
        # Released first, because it may be the same directory.
        self._lock = None
        self._lock = DirectoryLock(self.path)

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to resume."""
        return (self.path / self._CHECKPOINT).exists()

    def resume(self, **changes: Any) -> tuple[PPOLagrangian, dict[str, Any]]:
        """Read the checkpoint, and truncate the metrics to it.

        Updates between the checkpoint and a crash are repeated, so their lines are removed.

        Args:
            **changes: settings of the learner that replace those of the checkpoint.

        Returns:
            The learner, and what else :func:`train` needs to go on: ``stream``, ``counts``, and
            the ``settings``.

        Raises:
            OccError: there is no checkpoint, it is damaged, it was saved with other settings, or
                another training is writing there.
        """
        from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

        self._claim()
        learner, companions = PPOLagrangian.load_all(self.path / self._CHECKPOINT, **changes)
        settings = companions.get('settings') if isinstance(companions, dict) else None
        if not isinstance(settings, dict):
            raise DataError(
                f'{self.path / self._CHECKPOINT} is damaged: it tells no settings; allowed is what '
                'a training has saved'
            )
        for name, value in settings.items():
            if name in self._settings and self._settings[name] != value:
                raise ConfigurationError(
                    f'the training in {self.path} has {name} {value!r}; it cannot be resumed with '
                    f'{self._settings[name]!r}'
                )
        lines = self.history()
        kept = [json.dumps(line) for line in lines if line['updates'] <= learner.updates]
        write_text(self.path / self._METRICS, RESULTS, ''.join(f'{line}\n' for line in kept))
        return learner, companions

    def history(self) -> list[dict[str, Any]]:
        """Return the metrics of all updates; a line truncated by a crash is left out.

        Raises:
            DataError: the file cannot be read.
        """
        return read_metrics(self.path / self._METRICS)

    def add(self, learner: PPOLagrangian) -> None:
        """Append the metrics of the latest update.

        Raises:
            OccError: the file cannot be written.
        """
        assert learner.metrics is not None
        line = {
            name: value if math.isfinite(value) else None
            for name, value in learner.metrics.as_dict().items()
        }
        log = self.path / self._METRICS
        try:
            with log.open('a', encoding='utf-8') as file:
                file.write(json.dumps(line) + '\n')
        except OSError as error:
            raise OccError(f'cannot write {log}: {error.strerror}') from error

    @property
    def is_due(self) -> bool:
        """Whether the last save was long enough ago."""
        return time.monotonic() - self._saved_at > _SAVE_SECONDS

    def save(
        self,
        learner: PPOLagrangian,
        stream: EpisodeStream | None = None,
        cost_source: CostSource | None = None,
    ) -> None:
        """Save policy, checkpoint and counted rules, unless nothing has been learned yet.

        Args:
            learner: what to save.
            stream: the state of its world; the learner has all but the last batch. ``None`` if the
                world is in another process.
            cost_source: the source of the costs.

        Raises:
            OccError: a file cannot be written; the previous ones stay.
        """
        if not learner.updates:
            return
        companions: dict[str, Any] = {'settings': self._settings}
        if stream is not None:
            companions['stream'] = stream.state()
        if isinstance(cost_source, RuleCost):
            counts = cost_source.counts
            companions['counts'] = {'evaluated': counts.evaluated, 'violated': counts.violated}
            # A copy of a file that was edited meanwhile is kept.
            save_derived(cost_source.counted(), self.path / self._RULES, overwrite=True)
        learner.policy().save(self.path / 'policy.npz')
        learner.save(self.path / self._CHECKPOINT, **companions)
        summary = {
            'steps': learner.steps,
            'updates': learner.updates,
            'settings': self._settings,
        }
        write_text(self.path / 'summary.json', RESULTS, json.dumps(summary))
        self._saved_at = time.monotonic()


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a metrics file; one truncated by a crash is left out.

    Raises:
        DataError: the file cannot be read, or is damaged elsewhere.
    """
    # Whatever follows the last newline is incomplete.
    complete = read_bytes(path, _METRICS_BYTES).split(b'\n')[:-1] if path.exists() else []
    lines = []
    for number, text in enumerate(complete, start=1):
        if not text:
            continue
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            line = None
        if not (isinstance(line, dict) and type(line.get('updates')) is int):
            raise DataError(
                f'{path} is damaged: allowed is one JSON object for each update, with the number '
                f'"updates", but line {number} is {_shortened(text)}'
            )
        lines.append(line)
    return lines


def _shortened(line: bytes) -> str:
    text = line.decode('utf-8', errors='replace')
    return repr(text if len(text) <= 60 else f'{text[:57]}...')
