# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules before and after pruning at 0.001, and policies trained under both (the appendix)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.learning.simplification import size
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.rules.ruleset import RuleSet

from experiments.paper import highway
from experiments.paper.demonstrations import RULES, rule_scores
from experiments.paper.jobs import Job
from experiments.paper.plan import Scale, rules_job, states_job, training_job
from experiments.paper.printed import HIGHWAY, POINT_GOAL
from experiments.paper.tables import MISSING, Lines, acted, interval, results_of
from experiments.results import markdown_table

WORLD = 'PointGoal1'
THRESHOLD = 0.001
_SET = 'restricted'


def _counted_job(scale: Scale, seed: int) -> Job:
    rules = rules_job(scale, WORLD, 'expert', seed)
    return training_job(scale, WORLD, 'ours', seed, rules=rules, steps=scale.short_steps)


def _pruning_job(scale: Scale, seed: int) -> Job:
    counted = _counted_job(scale, seed)
    needs = {'training': counted, 'states': states_job(scale, WORLD)}
    return Job('pruning', {'counted': counted.folder.partition('/')[2]}, needs)


def _pruned_job(scale: Scale, seed: int) -> Job:
    return training_job(
        scale, WORLD, 'ours', seed, rules=_pruning_job(scale, seed), steps=scale.short_steps
    )


def _highway_pruning_job(scale: Scale, seed: int) -> Job:
    counted = highway.driver_job(scale, _SET, 'ours', seed)
    return Job('pruning', {'counted': counted.folder.partition('/')[2]}, {'training': counted})


def _highway_pruned_job(scale: Scale, seed: int) -> Job:
    return highway.driver_job(scale, _SET, 'ours', seed, pruned=_highway_pruning_job(scale, seed))


def jobs(scale: Scale) -> list[Job]:
    """Return the runs: count in training, prune, and train again, in PointGoal1 and driving."""
    return [
        make(scale, seed)
        for seed in range(scale.small_seeds)
        for make in (
            *(_counted_job, _pruning_job, _pruned_job),
            *(_highway_pruning_job, _highway_pruned_job),
        )
    ]


def prune_counted(folder: Path, needs: Mapping[str, Path], *, counted: str) -> dict[str, Any]:
    """Prune the rules that a training has counted.

    Args:
        folder: of the run; gets the pruned rules.
        needs: ``training``, and ``states`` to judge on, if there is a truth.
        counted: what distinguishes the training.

    Returns:
        The rules in words with their counters, before and after; and scores of both.
    """
    constraints = load_constraints(needs['training'] / 'training' / RULES_COUNTED)
    before = constraints.rule_set
    after = prune(before, THRESHOLD).rule_set
    constraints.with_rule_set(after).save(folder / RULES)
    result: dict[str, Any] = {'before': _words(before), 'after': _words(after)}
    result['literals'] = [size(before)[1], size(after)[1]]
    if 'states' in needs:
        result['scores'] = [rule_scores(rules, needs['states']) for rules in (before, after)]
    return result


RULES_COUNTED = 'constraints.yaml'
"""Name of the file with counted rules in the directory of a training."""


def _words(rule_set: RuleSet) -> list[list[Any]]:
    rules = [rule_set.rules[index] for index in rule_set.order]
    return [[rule.words(rule_set.space), rule.violated, rule.evaluated] for rule in rules]


def tables(lines: Lines, scale: Scale) -> dict[str, str]:
    """Return numbers before and after, and the rule lists beside the appendix."""
    seeds = range(scale.small_seeds)
    found = {}
    cut = results_of(lines, [_pruning_job(scale, seed) for seed in seeds])
    rows = []
    for place, (name, trained) in enumerate(
        (
            ('before', results_of(lines, [_counted_job(scale, seed) for seed in seeds])),
            ('after', results_of(lines, [_pruned_job(scale, seed) for seed in seeds])),
        )
    ):
        sizes = [
            interval([len(item[name]) for item in cut]),
            interval([item['literals'][place] for item in cut]),
        ]
        scores = [
            interval([item['scores'][place][ratio] for item in cut], 3)
            for ratio in ('precision', 'recall', 'f1')
        ]
        numbers = [
            acted(trained, acting, ratio)
            for acting in ('sampled', 'mean')
            for ratio in ('return', 'cost')
        ]
        rows.append((name, len(trained), *sizes, *scores, *numbers))
    heads = ('pruning', 'seeds', 'rules', 'literals', 'precision', 'recall', 'F1', 'return')
    heads += ('true cost', 'return, mean actions', 'true cost, mean actions')
    found['pruning'] = markdown_table(heads, rows)
    found['pruning_rules'] = _rule_lists(cut, POINT_GOAL)
    driving = results_of(lines, [_highway_pruning_job(scale, seed) for seed in seeds])
    found['pruning_highway_rules'] = _rule_lists(driving, HIGHWAY)
    found['pruning_highway'] = highway.summary_table(
        {
            'all rules': results_of(
                lines, [highway.driver_job(scale, _SET, 'ours', seed) for seed in seeds]
            ),
            'pruned rules': results_of(lines, [_highway_pruned_job(scale, seed) for seed in seeds]),
        }
    )
    return found


def _rule_lists(cut: list[dict[str, Any]], printed: tuple[str, ...]) -> str:
    """Return the rules of the first run beside those that the paper prints."""
    columns = [('the paper, after pruning', list(printed))]
    if cut:
        before, after = cut[0]['before'], cut[0]['after']
        kept = {words for words, _, _ in after}
        columns += [
            (
                f'here: {len(after)} kept of {len(before)}',
                [f'{words} [{violated} of {evaluated}]' for words, violated, evaluated in after],
            ),
            (
                'pruned here',
                [
                    f'{words} [{violated} of {evaluated}]'
                    for words, violated, evaluated in before
                    if words not in kept
                ],
            ),
        ]
    else:
        columns.append(('here', [MISSING]))
    return markdown_table(
        [title for title, _ in columns], [['<br>'.join(rules) or '-' for _, rules in columns]]
    )
