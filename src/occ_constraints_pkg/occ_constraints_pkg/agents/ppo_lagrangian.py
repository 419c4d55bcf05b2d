# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""PPO with a Lagrange multiplier on the cost of an episode, fed one step of many robots at a time.

The objective is to maximise the expected return subject to an expected cost per episode of at most
``cost_limit`` (Ray, Achiam and Amodei 2019, section 5.1; PPO: Schulman et al. 2017; advantages:
Schulman et al. 2016). The learner neither steps a world nor asks for a cost: it is told both by
its caller, so that the same class serves a plain loop and a ROS node.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from occ_constraints_pkg.agents.checkpoint import read_checkpoint, with_arrays, write_checkpoint
from occ_constraints_pkg.agents.improvement import TrainingData, improve
from occ_constraints_pkg.agents.multiplier import Multiplier
from occ_constraints_pkg.agents.networks import (
    mlp,
    numbers,
    torch_device,
)
from occ_constraints_pkg.agents.policy import GaussianPolicy, column_names
from occ_constraints_pkg.agents.rollout import (
    Episodes,
    Normaliser,
    Rollout,
    advantages,
    checked_cost,
)
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig, TrainingMetrics
from occ_constraints_pkg.archives import describe
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.worlds.base import Column
from occ_constraints_pkg.worlds.stream import StepBatch

# Share of the first step size that is left at the end of its decay, and after it.
_LEAST_STEP_SIZE = 0.1


class PPOLagrangian:
    """The learner: tell it each step of a stream, and it answers with the next action.

    Attributes:
        config: its settings.
        columns: names of the observation columns.
        action_columns: names of the action columns.
        world_name: the world that its policies are made for.
        steps: transitions learned from or collected, summed over robots.
        updates: updates made.
        metrics: of the last update; ``None`` before the first.
    """

    def __init__(
        self,
        config: PPOLagrangianConfig,
        columns: Sequence[Column | str],
        action_columns: Sequence[Column | str],
        world_name: str,
        seed: int,
    ) -> None:
        """Make a learner with fresh networks.

        Args:
            config: the settings.
            columns: the observation's columns.
            action_columns: the action's columns.
            world_name: stored in policy files.
            seed: of the networks' first weights, of exploration and of minibatches.

        Raises:
            OccError: the device is not there.
        """
        self.config = config
        self.columns = column_names(columns)
        self.action_columns = column_names(action_columns)
        self.world_name = world_name
        self.steps = 0
        self.updates = 0
        self.metrics: TrainingMetrics | None = None
        # All chance comes from this one generator, so that a checkpoint need hold no other state
        # and CPU and GPU draw alike.
        self._rng = np.random.default_rng(seed)
        self._device = torch_device(config.device)
        torch.set_num_threads(config.threads)
        k, a = len(self.columns), len(self.action_columns)
        self._actor = mlp((k, *config.hidden, a), 0.01, self._rng)
        self._critic = mlp((k, *config.hidden, 1), 1.0, self._rng)
        self._cost_critic = mlp((k, *config.hidden, 1), 1.0, self._rng)
        self._actor.register_parameter(
            'log_std', nn.Parameter(torch.full((a,), float(config.log_std_init)))
        )
        self._networks = nn.ModuleDict(
            {'actor': self._actor, 'critic': self._critic, 'cost_critic': self._cost_critic}
        ).to(self._device)
        critics = [*self._critic.parameters(), *self._cost_critic.parameters()]
        self._optimiser = torch.optim.Adam(
            [
                {'params': list(self._actor.parameters()), 'lr': config.actor_lr},
                {'params': critics, 'lr': config.critic_lr},
            ],
            fused=True,
        )
        self._multiplier = Multiplier(config)
        self._normaliser = Normaliser(k)
        self._policy = self.policy()
        self._rollout: Rollout | None = None
        self._episodes: Episodes | None = None
        self._open, self._begins_whole = False, True
        self._last_done: np.ndarray | None = None
        self._chosen: tuple[StepBatch, np.ndarray] | None = None
        self._clock, self._steps_then = time.perf_counter(), 0

    def choose(self, batch: StepBatch) -> None:
        """Choose the next action while the cost of ``batch`` is still under way.

        Nothing happens where an update comes first. :meth:`act` gives the same answers as without.
        """
        rollout = self._rollout
        if rollout is not None and rollout.filled + self._open < self.config.rollout_steps:
            self._chosen = batch, self._policy.act(batch.observation, self._rng)

    def act(self, batch: StepBatch, cost: np.ndarray) -> np.ndarray:
        """Learn what the last action led to, and choose the next.

        Updates the policy first when the rollout is full. A call that raises changes nothing.

        Args:
            batch: the states just reached, the successors of those of the call before unless
                :meth:`interrupt` came between.
            cost: (N,) cost of those states, 0 or 1 (ignored where a state is the first of its
                episode, which no step led to).

        Returns:
            (N, a) float32 actions.

        Raises:
            OccError: another number of robots or columns than before, or a number that is not
                finite: a missing cost is never taken for 0.
        """
        robots = None if self._rollout is None else self._rollout.reward.shape[1]
        cost = checked_cost(batch, cost, robots, len(self.columns))
        if self._rollout is None:
            self._allocate(len(cost))
        if self._open:
            self._close(batch, cost)
        if self._rollout.filled == self.config.rollout_steps:
            self._rollout.observation[-1] = batch.observation
            self._update()
        t = self._rollout.filled
        (seen, action), self._chosen = self._chosen or (None, None), None
        if seen is not batch:
            action = self._policy.act(batch.observation, self._rng)
        self._rollout.observation[t] = batch.observation
        self._rollout.action[t] = action
        self._last_done = batch.done
        self._open = True
        return action

    def interrupt(self, *, new_episodes: bool = True) -> None:
        """Forget the transition that is half open: its successor will not come.

        Args:
            new_episodes: the next batch shows first states of episodes (the simulator started
                anew). ``False``: it shows later states of running episodes, some steps having been
                missed; these episodes are learned from but left out of the means.
        """
        if self._open:
            # The state stays in the rollout, as the successor of the transition before.
            self._rollout.valid[self._rollout.filled] = False
            self._rollout.filled += 1
            self._open = False
        self._begins_whole = new_episodes
        if self._episodes is not None:
            self._episodes.sums[:] = 0.0
            self._episodes.whole[:] = new_episodes

    def policy(self) -> GaussianPolicy:
        """Return the policy as it now acts, as plain numbers."""
        layers = [layer for layer in self._actor if isinstance(layer, nn.Linear)]
        return GaussianPolicy(
            world=self.world_name,
            columns=self.columns,
            action_columns=self.action_columns,
            observation_mean=self._normaliser.mean.astype(np.float32),
            observation_variance=self._normaliser.floored_variance.astype(np.float32),
            observation_clip=self.config.observation_clip,
            weights=tuple(numbers(layer.weight.T) for layer in layers),
            biases=tuple(numbers(layer.bias) for layer in layers),
            log_std=numbers(self._actor.log_std),
        )

    @property
    def multiplier(self) -> float:
        """The Lagrange multiplier, 0 or more."""
        return self._multiplier.value

    def _allocate(self, robots: int) -> None:
        k, a = len(self.columns), len(self.action_columns)
        self._rollout = Rollout(self.config.rollout_steps, robots, k, a)
        self._episodes = Episodes(robots, self.config.window)
        self._episodes.whole[:] = self._begins_whole

    def _close(self, batch: StepBatch, cost: np.ndarray) -> None:
        rollout, t = self._rollout, self._rollout.filled
        valid = ~self._last_done
        rollout.reward[t] = batch.reward
        rollout.cost[t] = cost
        rollout.terminated[t] = batch.terminated
        rollout.valid[t] = valid
        rollout.filled += 1
        self.steps += int(valid.sum())
        self._episodes.add(batch.reward, cost, valid, batch.done)
        self._open = False

    def _update(self) -> None:
        """Learn from the full rollout and empty it."""
        self._chosen = None
        config, rollout = self.config, self._rollout
        if not rollout.valid.any():
            rollout.filled = 0
            return
        started = time.perf_counter()
        mean_return, mean_cost, mean_length = self._episodes.means()
        if config.lagrangian:
            self._multiplier.update(mean_cost)
        # The statistics change between rollouts, never within one. The first rollout was acted
        # without any; its own are used at once, which hardly matters to a policy whose mean is
        # still about 0 everywhere.
        first = self._normaliser.count == 0
        if first:
            self._normaliser.fold(rollout.observation[:-1])
            self._policy = self.policy()
        if config.decay_steps:
            left = max(_LEAST_STEP_SIZE, 1.0 - self.steps / config.decay_steps)
            actor, critics = self._optimiser.param_groups
            actor['lr'], critics['lr'] = left * config.actor_lr, left * config.critic_lr
        losses = improve(self._networks, self._optimiser, self._training_data(), config, self._rng)
        if not first:
            self._normaliser.fold(rollout.observation[:-1])
        self._policy = self.policy()
        rollout.filled = 0
        self.updates += 1
        now = time.perf_counter()
        self.metrics = TrainingMetrics(
            steps=self.steps,
            updates=self.updates,
            episodes=self._episodes.finished,
            mean_return=mean_return,
            mean_cost=mean_cost,
            mean_length=mean_length,
            cost_rate=float(rollout.cost.mean(where=rollout.valid)),
            multiplier=self.multiplier if config.lagrangian else 0.0,
            steps_per_s=(self.steps - self._steps_then) / (now - self._clock),
            update_s=now - started,
            **losses,
        )
        self._clock, self._steps_then = now, self.steps

    def _training_data(self) -> TrainingData:
        """Return what the valid transitions teach."""
        config, rollout = self.config, self._rollout
        shape = rollout.observation.shape[:2]
        observation = self._normalised(rollout.observation).to(self._device)
        with torch.no_grad():
            values = numbers(self._critic(observation)).reshape(shape)
            cost_values = numbers(self._cost_critic(observation)).reshape(shape)
        valid = rollout.valid
        ends = (rollout.terminated, valid, config.gamma, config.lam)
        estimate = advantages(rollout.reward, values, *ends)[valid]
        cost_estimate = advantages(rollout.cost, cost_values, *ends)[valid]
        advantage = (estimate - estimate.mean()) / (estimate.std() + 1e-8)
        if config.lagrangian:
            # The cost's advantage keeps its scale: a rare cost must not be blown up to the size
            # of the reward.
            penalty = cost_estimate - cost_estimate.mean()
            advantage = (advantage - self.multiplier * penalty) / (1.0 + self.multiplier)
        action = torch.from_numpy(rollout.action[valid])
        targets = estimate + values[:-1][valid], cost_estimate + cost_values[:-1][valid]
        return TrainingData(
            observation.reshape(*shape, -1)[:-1][torch.from_numpy(valid).to(self._device)],
            action.to(self._device),
            *(
                torch.from_numpy(x.astype(np.float32)).to(self._device)
                for x in (advantage, *targets)
            ),
        )

    def _normalised(self, observation: np.ndarray) -> torch.Tensor:
        """Return the rows (..., k) as the networks see them, (rows, k)."""
        policy = self._policy
        x = (observation - policy.observation_mean) / np.sqrt(policy.observation_variance)
        np.clip(x, -policy.observation_clip, policy.observation_clip, out=x)
        return torch.from_numpy(x.reshape(-1, x.shape[-1]))

    def save(self, path: Path | str, **companions: Any) -> None:
        """Write all that an exact continuation needs, replacing the file in a single move.

        Args:
            path: the file.
            **companions: what the caller needs besides to continue, such as the state of its
                world: nested mappings and lists of numbers, texts and arrays.

        Raises:
            OccError: it cannot be written; the file before stays.
        """
        write_checkpoint(path, {'learner': self._state(), 'companions': companions})

    @classmethod
    def load(cls, path: Path | str, **changes: Any) -> PPOLagrangian:
        """Read a checkpoint; nothing in it is executed.

        The learner expects the batch that follows the last one it was given. Call
        :meth:`interrupt` first when another one will come.

        Args:
            path: a file written by :meth:`save`.
            **changes: settings that replace those of the checkpoint, such as ``device``.

        Raises:
            OccError: no such file, or not a checkpoint.
        """
        return cls.load_all(path, **changes)[0]

    @classmethod
    def load_all(cls, path: Path | str, **changes: Any) -> tuple[PPOLagrangian, dict[str, Any]]:
        """Read a checkpoint as :meth:`load` does; return the learner and the companions."""
        document = read_checkpoint(path)
        try:
            state = document['learner']
            settings = {**state['config'], **changes}
            settings['hidden'] = tuple(settings['hidden'])
            _check_sizes(settings['hidden'], state)
            learner = cls(
                PPOLagrangianConfig(**settings),
                state['columns'],
                state['action_columns'],
                state['world_name'],
                seed=0,
            )
            learner._restore(state)
            return learner, with_arrays(document['companions'])
        except (ArithmeticError, AttributeError, LookupError, MemoryError) as err:
            raise _damaged(path, err) from err
        except (TypeError, ValueError, RuntimeError) as err:
            raise _damaged(path, err) from err

    def _state(self) -> dict[str, Any]:
        """Return everything as nested plain values, arrays and tensors."""
        rollout, episodes = self._rollout, self._episodes
        state: dict[str, Any] = {
            'config': asdict(self.config),
            'columns': list(self.columns),
            'action_columns': list(self.action_columns),
            'world_name': self.world_name,
            'steps': self.steps,
            'updates': self.updates,
            'metrics': None if self.metrics is None else self.metrics.as_dict(),
            'rng': json.dumps(self._rng.bit_generator.state),
            'networks': self._networks.state_dict(),
            'optimiser': self._optimiser.state_dict(),
            'multiplier': [self._multiplier.integral, self._multiplier.value],
            'normaliser': vars(self._normaliser),
            'stream': None,
        }
        if rollout is not None:
            state['stream'] = {
                'robots': len(episodes.whole),
                # Right after an update this is next to nothing.
                'rollout': rollout.state(rollout.filled + self._open),
                'episodes': episodes.state(),
                'open': self._open,
                'last_done': self._last_done,
            }
        return state

    def _restore(self, state: dict[str, Any]) -> None:
        """Take over everything but the settings from a checkpoint's content."""
        self.steps, self.updates = state['steps'], state['updates']
        self._steps_then = self.steps
        if state['metrics'] is not None:
            self.metrics = TrainingMetrics(**state['metrics'])
        self._rng.bit_generator.state = json.loads(state['rng'])
        self._networks.load_state_dict(state['networks'])
        self._optimiser.load_state_dict(state['optimiser'])
        self._multiplier.integral, self._multiplier.value = state['multiplier']
        vars(self._normaliser).update(with_arrays(state['normaliser']))
        self._policy = self.policy()
        stream = with_arrays(state['stream'])
        if stream is None:
            return
        self._allocate(stream['robots'])
        self._rollout.restore(stream['rollout'])
        self._episodes.restore(stream['episodes'])
        self._open, self._last_done = stream['open'], stream['last_done']


def _check_sizes(hidden: Sequence[int], state: dict[str, Any]) -> None:
    """Refuse hidden layers of which the checkpoint does not hold the weights.

    Raises:
        ValueError: a few bytes ask for networks that would fill the memory.
    """
    k, a = len(state['columns']), len(state['action_columns'])
    widths = (k, *hidden, a)
    asked = sum(n * m for n, m in zip(widths[:-1], widths[1:], strict=True))
    held = sum(tensor.untyped_storage().nbytes() for tensor in state['networks'].values())
    if 4 * asked > held:
        raise ValueError(f'hidden layers {hidden} take {4 * asked} bytes, and it holds {held}')


def _damaged(path: Path | str, error: Exception) -> OccError:
    return ConfigurationError(
        f'checkpoint {path} is damaged ({type(error).__name__}: {describe(error)}); allowed is '
        'what a training has saved'
    )
