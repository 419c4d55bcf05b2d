# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Return and true cost during training on the four tasks (the paper's third figure)."""

from __future__ import annotations

from experiments.baselines import HULL, STATIC
from experiments.paper.demonstrations import TRAINED
from experiments.paper.jobs import Job
from experiments.paper.plan import (
    Scale,
    expert_job,
    own_rules_job,
    rules_job,
    states_job,
    training_job,
)
from experiments.paper.printed import COST, REWARD
from experiments.paper.tables import Lines, acted, interval, results_of
from experiments.results import markdown_table

MCE = 'MCE-ICRL-style'
METHODS = ('expert', MCE, 'ours')


def method_job(scale: Scale, task: str, method: str, seed: int) -> Job:
    """Return the training by one method in one task."""
    if method == 'expert':
        return expert_job(scale, task, seed)
    if method == 'ours':
        return own_rules_job(scale, task, seed)
    return training_job(scale, task, method, seed, rules=rules_job(scale, task, TRAINED, seed))


def _score_job(scale: Scale, task: str, seed: int) -> Job:
    """Return the run that scores the baselines on demonstrations of the shipped expert."""
    rules = rules_job(scale, task, 'expert', seed)
    arguments = {'rules': rules.folder.partition('/')[2], 'world': task}
    return Job('baselines', arguments, {'rules': rules, 'states': states_job(scale, task)})


def jobs(scale: Scale) -> list[Job]:
    """Return the runs, those of the first seeds and of the tasks of the Goal first."""
    tasks = sorted(scale.tasks, key=lambda task: 'Push' in task)
    scores = [_score_job(scale, task, n) for n in range(scale.small_seeds) for task in tasks]
    return scores + [
        method_job(scale, task, method, seed)
        for seed in range(scale.diagonal_seeds)
        for task in tasks
        for method in ('expert', 'ours', MCE)
    ]


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the tables, by name."""
    rows = []
    for number, task in enumerate(scale.tasks):
        for method in METHODS:
            results = results_of(
                lines,
                [method_job(scale, task, method, n) for n in range(scale.diagonal_seeds)],
            )
            printed = '-'
            if method == 'ours':
                printed = f'{REWARD[task][number]}, {COST[task][number]}'
            rows.append(
                (
                    *(task, method, len(results), printed),
                    *(
                        acted(results, acting, name)
                        for acting in ('sampled', 'mean')
                        for name in ('return', 'cost')
                    ),
                )
            )
    heads = ('task', 'trained by', 'seeds', 'the paper: return, cost', 'return', 'true cost')
    heads += ('return, mean actions', 'true cost, mean actions')
    found = {'safety_gym': markdown_table(heads, rows)}
    scored = {
        task: results_of(
            lines, [_score_job(scale, task, seed) for seed in range(scale.small_seeds)]
        )
        for task in scale.tasks
    }
    names = ('ours', *STATIC, HULL)
    found['baselines'] = markdown_table(
        ('task', *names),
        [
            (task, *(interval([item[name]['f1'] for item in items], 2) for name in names))
            for task, items in scored.items()
        ],
    )
    return found
