# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The driving experiment, with rules of the default learner (the paper's last figure)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.rules.constraints_file import load_constraints

from experiments.highway import (
    AGENTS,
    SETS,
    HighwaySettings,
    judge,
    rules_for,
    train_agent,
)
from experiments.highway_results import markdown, summary
from experiments.paper.demonstrations import RULES
from experiments.paper.jobs import Job
from experiments.paper.plan import Scale
from experiments.paper.stopping import StoppedError, is_stopped
from experiments.paper.tables import MISSING, Lines, results_of


def _rules_job(scenarios: str) -> Job:
    return Job('traffic_rules', {'scenarios': scenarios})


def driver_job(
    scale: Scale, scenarios: str, agent: str, seed: int, *, pruned: Job | None = None
) -> Job:
    """Return the training of one agent.

    Args:
        scale: the size.
        scenarios: key of :data:`experiments.highway.SETS`.
        agent: of :data:`experiments.highway.AGENTS`.
        seed: of the training.
        pruned: the run that has pruned the rules; None: all rules.
    """
    arguments = {'scenarios': scenarios, 'agent': agent, 'seed': seed}
    arguments |= {'steps': scale.highway_steps, 'robots': scale.highway_robots}
    # Rates below 1 % need more episodes than a mean return.
    arguments['episodes'] = 5 * scale.episodes
    needs = {}
    if agent == 'ours':
        needs['rules'] = _rules_job(scenarios) if pruned is None else pruned
        arguments['rules'] = 'all' if pruned is None else 'pruned'
    return Job('highway', arguments, needs, scale.highway_steps)


def jobs(scale: Scale) -> list[Job]:
    """Return the runs, the first seeds first."""
    return [
        driver_job(scale, scenarios, agent, seed)
        for seed in range(scale.highway_seeds)
        for scenarios in scale.sets
        for agent in AGENTS
    ]


def learn_traffic(folder: Path, needs: Mapping[str, Path], *, scenarios: str) -> dict[str, Any]:
    """Learn rules from the traffic of a set of scenarios.

    Args:
        folder: of the run; gets the rules.
        needs: nothing.
        scenarios: the set.

    Returns:
        The rules in words, and their coverage.
    """
    constraints = rules_for(folder, scenarios, None)
    constraints.save(folder / RULES)
    rule_set = constraints.rule_set
    words = [rule.words(rule_set.space) for rule in rule_set.rules]
    return {'rules': words, 'coverage': constraints.coverage}


def train_driver(
    folder: Path,
    needs: Mapping[str, Path],
    *,
    scenarios: str,
    agent: str,
    seed: int,
    steps: int,
    robots: int,
    episodes: int,
    **_: Any,
) -> dict[str, Any]:
    """Train one agent, or go on with its training, and count how its episodes end.

    Args:
        folder: of the run; its ``training`` is as after ``occ train``.
        needs: ``rules``, for the agent ``ours``.
        scenarios: the set.
        agent: which one.
        seed: of the training.
        steps: robot steps.
        robots: simulated at once.
        episodes: fresh episodes over which the policy is judged.
        **_: what else distinguishes the run.

    Returns:
        As a line of the experiment ``highway``.

    Raises:
        StoppedError: the run is to end; called again, it goes on.
    """
    training = folder / 'training'
    train_agent(
        training,
        HighwaySettings(steps=steps, robots=robots),
        SETS[scenarios],
        agent,
        seed,
        load_constraints(needs['rules'] / RULES) if agent == 'ours' else None,
        progress=lambda _: None,
        is_stopped=is_stopped,
    )
    if is_stopped():
        raise StoppedError
    return {
        **judge(training / 'policy.npz', SETS[scenarios], episodes),
        'curve': read_metrics(training / 'outcomes.jsonl'),
    }


def curves(lines: Lines, scale: Scale) -> list[dict[str, Any]]:
    """Return the lines of the trainings as the pictures of the experiment ``highway`` need them."""
    return [
        {**job.arguments, 'set': job.arguments['scenarios'], **lines[job.id]['result']}
        for job in jobs(scale)
        if job.id in lines
    ]


def summary_table(results: Mapping[str, list[dict[str, Any]]]) -> str:
    """Return rates and returns of several groups of trainings on the restricted set."""
    rows = [
        {**item, 'set': 'restricted', 'agent': name}
        for name, items in results.items()
        for item in items
    ]
    return markdown(summary(rows)).rstrip()


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the table of rates and returns, and the rules."""
    found = {'highway': markdown(summary(curves(lines, scale))).rstrip()}
    for name in SETS:
        rules = [rule for x in results_of(lines, [_rules_job(name)]) for rule in x['rules']]
        found[f'highway_rules_{name}'] = '\n'.join(f'- {rule}' for rule in rules) or MISSING
    return found
