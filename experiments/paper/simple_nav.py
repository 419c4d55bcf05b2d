# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's two-dimensional example, and every baseline on it (figures 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.rules.ruleset import RuleCounts, RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

import occ_constraints_pkg as occ
from experiments.baselines import HULL, STATIC
from experiments.inverse_learning import LEARNERS
from experiments.paper.demonstrations import TREES, ratios
from experiments.paper.jobs import Job
from experiments.paper.plan import Scale, rules_job, states_job, training_job
from experiments.paper.printed import SIMPLE_NAV, SIMPLE_NAV_PRUNED
from experiments.paper.tables import MISSING, Lines, interval, results_of
from experiments.results import markdown_table

WORLD = 'simple_nav'
THRESHOLD = 0.001
_BAGS = Path(__file__).parents[2] / 'bags'
_DRAWN = 3
# The tree of the article with the paper's limit of depth; rules as the paper writes them.
_PAPER = {'clip': 'density', 'alpha': 0.5, 'full_conditions': True}
METHODS = ('RL', 'expert', 'ours', *LEARNERS, *STATIC, HULL)


def jobs(scale: Scale) -> list[Job]:
    """Return the runs: the example, and a training under every cost."""
    rules = {seed: rules_job(scale, WORLD, 'expert', seed) for seed in range(scale.small_seeds)}
    trainings = [
        training_job(
            scale,
            WORLD,
            method,
            seed,
            **({'limit': 0.0} if method == 'expert' else {}),
            **({} if method in ('RL', 'expert') else {'rules': rules[seed]}),
        )
        for seed in rules
        for method in METHODS
    ]
    scores = [
        Job(
            'baselines',
            {'rules': rules[seed].folder.partition('/')[2], 'world': WORLD},
            {'rules': rules[seed], 'states': states_job(scale, WORLD)},
        )
        for seed in rules
    ]
    return [Job('simple_nav', {'depth': 2}), *rules.values(), *scores, *trainings]


def follow_example(folder: Path, needs: Mapping[str, Path], *, depth: int) -> dict[str, Any]:
    """Learn from the shipped recordings as the paper does, prune, and judge.

    Args:
        folder: of the run.
        needs: nothing.
        depth: of the tree.

    Returns:
        The tree, and for it and the default learner the rules in words before and after pruning,
        with precision, recall and F1 on the driver that heads straight for the goal; and some
        trajectories.
    """
    feature_map = load_feature_map(WORLD)
    straight = extract([_BAGS / 'simple_nav_straight'], feature_map)
    expert = extract([_BAGS / 'simple_nav_expert'], feature_map)
    result: dict[str, Any] = {'tree': None}
    for name, settings in (
        ('paper', {**_PAPER, 'max_depth': depth}),
        ('default', TREES['default']),
    ):
        learned = occ.learn(_BAGS / 'simple_nav_expert', feature_map, **settings)
        result['tree'] = result['tree'] or learned.tree
        rule_set = learned.rule_set
        counts = RuleCounts(rule_set)
        counts.add(rule_set.judge(straight.values))
        pruned = prune(rule_set.with_counts(counts), THRESHOLD).rule_set
        costly = straight.true_cost > 0
        result[name] = {
            'rules': _words(rule_set),
            'pruned': _words(pruned),
            'scores': ratios(rule_set.verdicts(straight.values) != Verdict.SAFE, costly),
            'pruned_scores': ratios(pruned.verdicts(straight.values) != Verdict.SAFE, costly),
        }
    result['trajectories'] = {
        driver: [
            np.round(data.values[data.episodes == episode], 4).tolist()
            for episode in np.unique(data.episodes)[:_DRAWN]
        ]
        for driver, data in (('expert', expert), ('straight', straight))
    }
    return result


def _words(rule_set: RuleSet) -> list[str]:
    return [rule_set.rules[index].words(rule_set.space) for index in rule_set.order]


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return the tables, by name."""
    (example,) = results_of(lines, jobs(scale)[:1]) or [None]
    rows = [_method_row(lines, scale, method) for method in METHODS]
    heads = ('cost', 'seeds', 'return', 'true cost', 'return, mean actions')
    heads += ('true cost, mean actions', 'F1 of its flags')
    return {
        'simple_nav_rules': MISSING if example is None else _rules_table(example),
        'simple_nav_methods': markdown_table(heads, filter(None, rows)),
    }


def _rules_table(example: Mapping[str, Any]) -> str:
    columns: list[tuple[str, Sequence[str], Mapping[str, Any] | None]] = [
        ('the paper', SIMPLE_NAV, None),
        ('the paper, pruned', SIMPLE_NAV_PRUNED, None),
    ]
    for name, title in (('paper', "the paper's tree"), ('default', 'the default learner')):
        part = example[name]
        columns.append((title, part['rules'], part['scores']))
        columns.append((f'{title}, pruned', part['pruned'], part['pruned_scores']))
    rows = [
        (title, len(rules), '<br>'.join(rules), '-' if scores is None else f'{scores["f1"]:.3f}')
        for title, rules, scores in columns
    ]
    return markdown_table(('formula', 'rules', 'a violation is', 'F1'), rows)


def _method_row(lines: Lines, scale: Scale, method: str) -> tuple[object, ...] | None:
    all_jobs = jobs(scale)
    results = results_of(lines, [job for job in all_jobs if job.arguments.get('method') == method])
    if not results:
        return None
    numbers = [
        interval([item[acting][name] for item in results])
        for acting in ('sampled', 'mean')
        for name in ('return', 'cost')
    ]
    scored = results_of(lines, [job for job in all_jobs if job.kind == 'baselines'])
    scores = [item[method]['f1'] for item in scored if method in item]
    return (method, len(results), *numbers, interval(scores, 3) if scores else '-')
