# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's driving experiment: rules learned from traffic, and agents trained under them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.highway_film import draw_drives, drive_through
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.rule_cost import RuleCost
from occ_constraints_pkg.agents.run import cost_limit
from occ_constraints_pkg.agents.settings import TrainingMetrics, learner_settings
from occ_constraints_pkg.agents.training import (
    CostSource,
    TrainingDirectory,
    TrueCost,
    read_metrics,
    train,
)
from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.files import RESULTS, make_directory, write_text
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.worlds.highway_scenarios import FULL, RESTRICTED

from benchmarks.conditions import machine, versions
from experiments.highway_agents import OUTCOMES, CountedHighway, LastingRuleCost
from experiments.highway_demonstrations import traffic_episodes
from experiments.highway_fidelity import drive_both
from experiments.highway_results import draw_curves, markdown, summary
from experiments.results import write_results

SETS = {'restricted': RESTRICTED, 'full': FULL}
AGENTS = ('RL', 'RL with engineered reward', 'ours')
_EVALUATION_SEED = 10_000
_DEMONSTRATED = 52

# A small network learns this as well as the default one, in a third of the time.
LEARNER = {
    'hidden': (32, 32),
    'passes': 4,
    'rollout_steps': 64,
    'minibatch': 4096,
    'log_std_init': -1.0,
    'log_std_end': -1.0,
    'multiplier_rate': 0.03,
    'multiplier_gain': 0.25,
}


@dataclass(frozen=True)
class HighwaySettings:
    """What is trained and how it is judged.

    Attributes:
        sets: of scenarios, of :data:`SETS`.
        agents: of :data:`AGENTS`.
        seeds: trainings of each agent on each set.
        steps: robot steps of each training.
        robots: robots simulated at once.
        cost_limit: for ``ours``: a number or ``demonstrations``.
        lasting: a violation that ends an episode counts to the end of its 40 s, not once.
        episodes: fresh episodes over which each policy is judged.
        in_highway_env: scenarios that the policies of the first seed drive in highway-env as well.
        drawn: the scenario whose trajectories are drawn; ``None``: none are.
        rules: a constraints file for ``ours``; ``None``: rules are learned from the traffic.
        learner: settings of the learner.
    """

    sets: tuple[str, ...] = tuple(SETS)
    agents: tuple[str, ...] = AGENTS
    seeds: int = 3
    steps: int = 600_000
    robots: int = 256
    cost_limit: float | str = 'demonstrations'
    lasting: bool = True
    episodes: int = 1000
    in_highway_env: int = 5
    drawn: int | None = 1
    rules: str | None = None
    learner: Mapping[str, Any] = field(default_factory=lambda: LEARNER)


def run_highway(
    output: Path,
    settings: HighwaySettings,
    *,
    progress: Callable[[int, int], None] = lambda *_: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Learn rules from the traffic, train all agents one after another, and compare them.

    A stopped run goes on where it was, and so does one that is given more steps or seeds: rules
    that are there are not learned again, trainings are resumed, and those that are complete are
    not judged again.

    Args:
        output: directory for rules and trainings, ``highway.json``, ``highway.md``, the curves in
            ``highway.png`` and trajectories in ``highway_drives.png`` and ``highway_drives.gif``.
        settings: what to run.
        progress: called with the robot steps made and to make.
        is_stopped: asked now and then; ``True`` ends the run there, saved.

    Returns:
        The document that ``highway.json`` holds; if no training was completed, nothing is written.

    Raises:
        OccError: a setting is wrong, or a training cannot be resumed with these settings.
    """
    _check(settings)
    make_directory(output)
    lines = []
    # Seeds outermost: a run that is stopped early has something of everything.
    jobs = [
        (name, agent, seed)
        for seed in range(settings.seeds)
        for name in settings.sets
        for agent in settings.agents
    ]
    for number, (name, agent, seed) in enumerate(jobs):
        done = number * settings.steps
        folder = output / name / agent.replace(' ', '_') / f'seed_{seed}'
        rules = rules_for(output, name, settings.rules) if agent == 'ours' else None
        train_agent(
            folder,
            settings,
            SETS[name],
            agent,
            seed,
            rules,
            progress=lambda steps, done=done: progress(done + steps, len(jobs) * settings.steps),
            is_stopped=is_stopped,
        )
        if is_stopped():
            break
        lines.append(
            {
                'set': name,
                'agent': agent,
                'seed': seed,
                **_judged(folder, settings, SETS[name], seed),
                'curve': read_metrics(folder / 'outcomes.jsonl'),
            }
        )
    document = {
        'settings': {**asdict(settings), 'learner': dict(settings.learner)},
        'lines': lines,
        'summary': summary(lines),
        'machine': machine(),
        'versions': versions(('numpy', 'torch')),
    }
    if not lines:
        # Stopped in the first training: nothing to report, nor to replace an earlier result by.
        return document
    write_results(output, 'highway', document, markdown(document['summary']))
    draw_curves(output / 'highway.png', lines)
    if settings.drawn is not None:
        _draw_drives(output, settings)
    return document


def _check(settings: HighwaySettings) -> None:
    """Refuse settings of any agent that are wrong before the first of them is trained."""
    learner_settings(settings.learner).check_steps('steps', settings.steps, settings.robots)
    limit = settings.cost_limit
    if settings.rules is not None:
        rules = load_constraints(settings.rules)
        RuleCost(rules, CountedHighway)
        limit = cost_limit(limit, rules)
    if not isinstance(limit, str):
        learner_settings({**settings.learner, 'cost_limit': limit})


def rules_for(output: Path, name: str, given: str | None) -> Constraints:
    """Return the rules for ``ours``; learned from the traffic of the set where none are given.

    Raises:
        OccError: the file given cannot be read.
    """
    path = Path(given) if given else output / f'rules_{name}.yaml'
    if not path.exists() and not given:
        numbers = np.linspace(0, SETS[name] - 1, _DEMONSTRATED).astype(int)
        values, episodes = traffic_episodes(numbers.tolist())
        feature_map = load_feature_map('highway')
        learn(
            values.astype(np.float64),
            episodes,
            feature_map.space,
            rng=np.random.default_rng(0),
            feature_map=feature_map.to_document(),
        ).save(path)
    return load_constraints(path)


def train_agent(
    folder: Path,
    settings: HighwaySettings,
    scenarios: int,
    agent: str,
    seed: int,
    rules: Constraints | None,
    *,
    progress: Callable[[int], None],
    is_stopped: Callable[[], bool],
) -> None:
    """Train one agent, or go on with its training, until it has made its steps.

    Beside the files of a training, ``outcomes.jsonl`` tells after each update how many episodes
    have ended in which way since the beginning.

    Raises:
        OccError: the training there was made with other settings, or has gone on for longer.
    """
    world = CountedHighway(
        settings.robots, scenarios=scenarios, engineered=agent == 'RL with engineered reward'
    )
    limit = 0.0 if rules is None else cost_limit(settings.cost_limit, rules)
    config = learner_settings(
        {
            **settings.learner,
            'lagrangian': rules is not None,
            'cost_limit': limit,
            'decay_steps': settings.steps,
        }
    )
    source: CostSource = TrueCost()
    if rules is not None:
        source = (LastingRuleCost if settings.lasting else RuleCost)(rules, world)
    fixed = {'agent': agent, 'scenarios': scenarios, 'seed': seed, 'cost_limit': limit}
    fixed['lasting'] = settings.lasting
    fixed['rules'] = None if rules is None else rules.rule_set.fingerprint
    directory = TrainingDirectory(folder, fixed)
    log = folder / 'outcomes.jsonl'
    resumed = None
    if directory.has_checkpoint:
        learner, resumed = directory.resume(decay_steps=settings.steps)
        # A training ends within one step of all robots.
        if learner.steps >= settings.steps + settings.robots:
            raise OccError(
                f'the training in {folder} has made {learner.steps} steps; allowed are so many or '
                f'more, got {settings.steps}'
            )
        kept = [line for line in read_metrics(log) if line['updates'] <= learner.updates]
        write_text(log, RESULTS, ''.join(json.dumps(line) + '\n' for line in kept))
    else:
        learner = PPOLagrangian(config, world.columns, world.action_columns, world.name, seed)
        directory.begin()
        log.unlink(missing_ok=True)

    def note(metrics: TrainingMetrics) -> None:
        line = {'steps': metrics.steps, 'updates': metrics.updates}
        line |= dict(zip(OUTCOMES, world.totals.tolist(), strict=True))
        with log.open('a', encoding='utf-8') as file:
            file.write(json.dumps(line) + '\n')
        progress(metrics.steps)

    train(
        world,
        learner,
        source,
        seed=seed,
        total_steps=settings.steps,
        progress=note,
        directory=directory,
        resumed=resumed,
        is_stopped=is_stopped,
    )


def _draw_drives(output: Path, settings: HighwaySettings) -> None:
    """Draw what the agents of the first seed do in the same scenario, as a strip and as a film."""
    name = settings.sets[0]
    policies = {
        agent: output / name / agent.replace(' ', '_') / 'seed_0' / 'policy.npz'
        for agent in settings.agents
    }
    drives = {
        agent: drive_through(GaussianPolicy.load(path).act, settings.drawn)
        for agent, path in policies.items()
        if path.exists()
    }
    if drives:
        rules = rules_for(output, name, settings.rules)
        for suffix in ('png', 'gif'):
            draw_drives(output / f'highway_drives.{suffix}', drives, rules)


def _judged(
    folder: Path, settings: HighwaySettings, scenarios: int, seed: int
) -> dict[str, dict[str, float]]:
    """Return how a trained policy does; what a file tells of it, if it was trained as long."""
    file = folder / 'judged.json'
    if file.exists():
        found = read_json_object(file)
        if found.pop('steps', None) == settings.steps:
            return found
    result: dict[str, Any] = judge(folder / 'policy.npz', scenarios, settings.episodes)
    if seed == 0:
        policy = GaussianPolicy.load(folder / 'policy.npz')
        numbers = range(settings.in_highway_env)
        result['in_highway_env'] = asdict(drive_both(policy, numbers))
    text = json.dumps({'steps': settings.steps, **result}, indent=1)
    write_text(file, RESULTS, text + '\n')
    return result


def judge(policy: Path, scenarios: int, episodes: int) -> dict[str, dict[str, float]]:
    """Count how fresh episodes of a policy end, with actions sampled as in training and without.

    Args:
        policy: the policy file.
        scenarios: how many scenarios there are to draw from.
        episodes: number of episodes.

    Returns:
        By ``sampled`` and ``mean``: :data:`OUTCOMES`, the return as a mean.
    """
    loaded = GaussianPolicy.load(policy)
    results = {}
    for name in ('sampled', 'mean'):
        rng = np.random.default_rng(_EVALUATION_SEED) if name == 'sampled' else None
        # One episode of each robot: were they let go on, those of short ones would be more.
        world = CountedHighway(episodes, scenarios=scenarios)
        observation, _ = world.reset(seed=_EVALUATION_SEED)
        while world.totals[0] < episodes:
            observation, *_ = world.step(loaded.act(observation, rng))
        outcome = dict(zip(OUTCOMES, world.totals.tolist(), strict=True))
        results[name] = {**outcome, 'return': outcome['return'] / episodes}
    return results
