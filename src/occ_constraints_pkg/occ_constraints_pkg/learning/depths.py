# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of tree depths: the rules of every depth from one tree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.conditional.settings import resolved_conditions
from occ_constraints_pkg.learning.learn import grow, is_safe, learn_safe_set
from occ_constraints_pkg.learning.samples import divide_samples, families
from occ_constraints_pkg.learning.scoring import Score, score_rules
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.simplification import size
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace


@dataclass(frozen=True, eq=False)
class DepthResult:
    """The rules of one depth.

    Attributes:
        depth: levels of splits; 0 is the smallest and largest demonstrated values alone.
        rule_set: its rules, the same as learning with this depth limit gives.
        rules: number of rules.
        literals: number of their literals.
        training: share of the training samples inside the safe set.
        held_out: the same of the held-out episodes, None where there are none.
        score: on samples of known cost, None without such.
    """

    depth: int
    rule_set: RuleSet
    rules: int
    literals: int
    training: float
    held_out: float | None
    score: Score | None


def ablate_depth(
    values: np.ndarray,
    episodes: np.ndarray,
    space: FeatureSpace,
    settings: OCTreeSettings,
    *,
    rng: np.random.Generator,
    conditional: ConditionalSettings | None = None,
    independent: np.ndarray | None = None,
    truth: tuple[np.ndarray, np.ndarray] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[DepthResult]:
    """Grow the tree once and return the rules that it gives when cut at each level.

    Safe sets are nested, but for conditional rules: a deeper one lies within a shallower one.

    Args:
        values: (n, k) demonstrated samples.
        episodes: (n,) the episode each belongs to.
        space: the features.
        settings: of the tree; its depth limit is the largest depth.
        rng: chooses the held-out episodes, as in :func:`~occ_constraints_pkg.learning.learn.learn`.
        conditional: which conditional rules to look for within each depth's box, as there.
        independent: as there.
        truth: (m, k) samples and their (m,) true cost, to score the rules on.
        progress: called with (depths done, depths in all).

    Raises:
        DataError: there is no usable sample, or none has a true cost.
    """
    conditional = resolved_conditions(conditional, settings)
    samples = divide_samples(values, episodes, space, rng=rng)
    together = families(space, settings)
    labels = None if independent is None else independent[samples.positions]
    tree = grow(samples.training, space, settings)
    deepest = tree.levels(together)
    results = []
    for depth in range(deepest + 1):
        rule_set = learn_safe_set(
            samples,
            space,
            settings,
            conditional,
            tree=tree.cut(depth, together),
            independent=labels,
        ).formula.rule_set
        held_out = samples.held_out
        results.append(
            DepthResult(
                depth,
                rule_set,
                *size(rule_set),
                float(np.mean(is_safe(rule_set, samples.training))),
                float(np.mean(is_safe(rule_set, held_out))) if len(held_out) else None,
                None if truth is None else score_rules(rule_set, *truth).overall,
            )
        )
        if progress is not None:
            progress(depth + 1, deepest + 1)
    return results


def describe_depths(results: Sequence[DepthResult]) -> str:
    """Return one line of text for each depth."""
    scored = results[0].score is not None
    lines = [
        f'{"depth":>5} {"rules":>6} {"literals":>9} {"training":>9} {"held out":>9}'
        + (f' {"precision":>10} {"recall":>7} {"F1":>6}' if scored else '')
    ]
    for item in results:
        line = f'{item.depth:>5} {item.rules:>6} {item.literals:>9} {item.training:>9.4f}'
        line += f' {"none" if item.held_out is None else f"{item.held_out:.4f}":>9}'
        if item.score is not None:
            line += f' {_ratio(item.score.precision):>10} {_ratio(item.score.recall):>7}'
            line += f' {_ratio(item.score.f1):>6}'
        lines.append(line)
    return '\n'.join(lines)


def depths_document(results: Sequence[DepthResult]) -> list[dict[str, Any]]:
    """Return one mapping for each depth, ready for JSON."""
    return [
        {
            'depth': item.depth,
            'rules': item.rules,
            'literals': item.literals,
            'training': item.training,
            'held_out': item.held_out,
            **(
                {}
                if item.score is None
                else {
                    name: value if math.isfinite(value) else None
                    for name, value in item.score.ratios().items()
                }
            ),
        }
        for item in results
    ]


def _ratio(value: float) -> str:
    return f'{value:.3f}' if math.isfinite(value) else 'undef.'
