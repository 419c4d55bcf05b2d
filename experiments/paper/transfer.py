# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of one robot and task, obeyed by another (tables 1 and 2)."""

from __future__ import annotations

from experiments.paper.demonstrations import TRAINED
from experiments.paper.jobs import Job
from experiments.paper.plan import Scale, rules_job, transfer_job
from experiments.paper.printed import COST, REWARD
from experiments.paper.tables import MISSING, Lines, acted, interval, results_of
from experiments.results import markdown_table


def _seeds(scale: Scale, source: str, target: str) -> range:
    return range(scale.diagonal_seeds if source == target else scale.other_seeds)


def jobs(scale: Scale) -> list[Job]:
    """Return the runs, the diagonal and the first seeds first."""
    pairs = [(source, target) for source in scale.tasks for target in scale.tasks]
    pairs.sort(key=lambda pair: pair[0] != pair[1])
    return [
        transfer_job(scale, source, target, seed)
        for seed in range(scale.diagonal_seeds)
        for source, target in pairs
        if seed in _seeds(scale, source, target)
    ]


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the two matrices, the paper's number above ours, and that of F1."""
    found = {}
    for name, printed in (('return', REWARD), ('cost', COST)):
        rows = []
        for source in scale.tasks:
            rows.append((source, 'the paper', *printed[source]))
            ours = [
                acted(
                    results_of(
                        lines,
                        [
                            transfer_job(scale, source, target, seed)
                            for seed in _seeds(scale, source, target)
                        ],
                    ),
                    'sampled',
                    name,
                )
                for target in scale.tasks
            ]
            rows.append((source, 'ours', *ours))
        heads = ('rules of', '', *scale.tasks)
        found[f'transfer_{name}'] = markdown_table(heads, rows)
    rows = []
    for source in scale.tasks:
        for driver in (TRAINED, 'expert'):
            learned = results_of(
                lines,
                [rules_job(scale, source, driver, n) for n in range(scale.diagonal_seeds)],
            )
            scores = [
                interval([item['scores'][target]['f1'] for item in learned], 2)
                if learned
                else MISSING
                for target in scale.tasks
            ]
            who = 'expert trained here' if driver == TRAINED else 'shipped expert'
            rows.append((source, who, len(learned), *scores))
    found['transfer_f1'] = markdown_table(('rules of', 'from', 'seeds', *scale.tasks), rows)
    return found
