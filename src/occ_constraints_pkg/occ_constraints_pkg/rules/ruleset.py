# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rule set: a formula in disjunctive normal form that judges samples."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.rule import Rule
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

# Rows judged at a time: keeps the (rows, literals) intermediates in the cache.
_BLOCK = 2048


@dataclass(frozen=True, eq=False)
class RuleSet:
    """Rules over a feature space; a sample is a violation when any enabled rule is true.

    Attributes:
        space: the features the rules speak of.
        rules: all rules, disabled ones included; positions here are what ``costs`` and
            ``rule_stats`` report.
        demonstrated: (k, 2) smallest and largest demonstrated value of each feature; their
            difference is the scale of margins (1 for a feature that was constant).

    Raises:
        OccError: an id is used twice, a demonstrated range is none, or an enabled rule can never
            be true, which in a safety rule is a slip and no wish.
    """

    space: FeatureSpace
    rules: tuple[Rule, ...]
    demonstrated: np.ndarray

    def __post_init__(self) -> None:
        shape = np.shape(self.demonstrated)
        if shape != (len(self.space), 2):
            raise OccError(
                f'demonstrated ranges must be of shape ({len(self.space)}, 2), got {shape}'
            )
        ids = [rule.id for rule in self.rules]
        if len(set(ids)) != len(ids):
            twice = next(item for item in ids if ids.count(item) > 1)
            raise OccError(f'rule id {twice!r} is used twice; ids must be unique')
        for name, (low, high) in zip(self.space.names, self.demonstrated, strict=True):
            if not -np.inf < low <= high < np.inf:
                raise OccError(
                    f'feature {name!r} has the demonstrated range [{low}, {high}]; allowed are '
                    'two finite numbers, the smaller first'
                )
        for rule in self.rules:
            if rule.enabled and rule.is_contradictory:
                raise OccError(
                    f'rule {rule.id!r} can never be true: {rule.formula(self.space)}; allowed '
                    'are literals that hold together, or the rule disabled'
                )

    @cached_property
    def scale(self) -> np.ndarray:
        """(k,) the range of each feature in the demonstrations, 1 where it was constant."""
        with np.errstate(over='ignore'):
            extent = self.demonstrated[:, 1] - self.demonstrated[:, 0]
        return np.where((extent > 0) & np.isfinite(extent), extent, 1.0)

    @cached_property
    def order(self) -> np.ndarray:
        """Positions of the enabled rules in the order they are tried: fewest literals first."""
        enabled = [index for index, rule in enumerate(self.rules) if rule.enabled]
        return np.array(
            sorted(enabled, key=lambda index: len(self.rules[index].literals)), dtype=np.int64
        )

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hex digits that name the formula: features, bounds, enabled rules in order."""
        digest = hashlib.sha256()
        for feature in self.space.features:
            digest.update(
                f'{feature.name}|{float(feature.low)!r}|{float(feature.high)!r}\n'.encode()
            )
        for index in self.order:
            digest.update(f'{self.rules[index].formula(self.space)}\n'.encode())
        return digest.hexdigest()[:12]

    @cached_property
    def _compiled(self) -> _Compiled:
        return _Compiled(self)

    def judge(self, values: np.ndarray) -> Judgement:
        """Judge samples.

        A sample is UNKNOWN when any feature is not finite or lies outside its physical bounds,
        VIOLATED when any enabled rule is true, else SAFE.

        The margin is the robustness of the formula in the maximum norm: for each rule the
        largest of its literals' distances from becoming true, over all rules the smallest. On a
        safe sample that is exactly the distance to the nearest violation; on a violation its
        absolute value is a lower bound of the distance back to safety.

        Args:
            values: (n, k) numbers in the units of the feature space.

        Returns:
            A :class:`Judgement` of n samples.

        Raises:
            OccError: the array has another shape.
        """
        rows = self.space.check_rows(values)
        n = len(rows)
        judgement = Judgement(np.empty(n, dtype=np.int8), np.empty(n, dtype=np.int64), np.empty(n))
        for start in range(0, n, _BLOCK):
            block = slice(start, start + _BLOCK)
            self._compiled.judge_block(
                rows[block],
                judgement.verdict[block],
                judgement.rule[block],
                judgement.margin[block],
            )
        return judgement

    def rule_margins(self, sample: np.ndarray) -> np.ndarray:
        """Return each rule's own margin on one sample.

        Args:
            sample: (k,) numbers in the units of the feature space.

        Returns:
            (rules,) float64, at most 0 where the rule is true; NaN for disabled rules.
        """
        row = self.space.check_rows(np.asarray(sample, dtype=np.float64)[None])
        margins = np.full(len(self.rules), np.nan)
        if len(self.order):
            margins[self.order] = self._compiled.margins(row)[0]
        return margins

    def violated_rules(self, sample: np.ndarray) -> np.ndarray:
        """Return the positions of all enabled rules that are true on one sample (k,)."""
        row = self.space.check_rows(np.asarray(sample, dtype=np.float64)[None])
        if not len(self.order):
            return self.order
        return self.order[self._compiled.truth(row)[0]]

    def with_counts(self, counts: RuleCounts) -> RuleSet:
        """Return the same rules carrying these counters."""
        rules = tuple(
            replace(rule, evaluated=int(evaluated), violated=int(violated))
            for rule, evaluated, violated in zip(
                self.rules, counts.evaluated, counts.violated, strict=True
            )
        )
        return replace(self, rules=rules)


class RuleCounts:
    """How often each rule was evaluated and violated.

    Rules are tried in the order of :attr:`RuleSet.order` and the search stops at the first true
    one, so a rule is *evaluated* on a sample when no rule before it was true. Samples whose
    verdict is UNKNOWN count nowhere.

    Attributes:
        evaluated: (rules,) int64.
        violated: (rules,) int64.
    """

    def __init__(self, rule_set: RuleSet) -> None:
        self.evaluated = np.zeros(len(rule_set.rules), dtype=np.int64)
        self.violated = np.zeros(len(rule_set.rules), dtype=np.int64)
        self._order = rule_set.order
        self._place = np.full(len(rule_set.rules), -1, dtype=np.int64)
        self._place[self._order] = np.arange(len(self._order))

    def add(self, judgement: Judgement) -> None:
        """Count the samples of one judgement by the same rule set."""
        if not len(self._order):
            return
        rule = judgement.rule[judgement.verdict != Verdict.UNKNOWN]
        stopped_at = self._place[rule[rule >= 0]]
        hits = np.bincount(stopped_at, minlength=len(self._order))
        went_through = np.count_nonzero(rule < 0)
        reached = went_through + np.cumsum(hits[::-1])[::-1]
        self.violated[self._order] += hits
        self.evaluated[self._order] += reached

    def reset(self) -> None:
        """Set all counters to zero."""
        self.evaluated[:] = 0
        self.violated[:] = 0


class _Compiled:
    """The enabled rules as arrays.

    Every literal becomes ``sign * x > threshold``: a lower-or-equal comparison with b is a strict
    one with the next float above b, and a comparison from below is one of the negated numbers.
    Both steps are exact.
    """

    def __init__(self, rule_set: RuleSet) -> None:
        space = rule_set.space
        self.order = rule_set.order
        # Replacing infinite bounds by the largest floats makes one test find NaN and Inf too.
        largest = np.finfo(np.float64).max
        self.lows, self.highs = space.lows.clip(-largest), space.highs.clip(max=largest)
        literals = [item for index in self.order for item in rule_set.rules[index].literals]
        unique = list(dict.fromkeys(literals))
        place = {literal: index for index, literal in enumerate(unique)}
        self.members = np.array([place[literal] for literal in literals], dtype=np.int64)
        lengths = [len(rule_set.rules[index].literals) for index in self.order]
        self.starts = np.cumsum([0, *lengths[:-1]]).astype(np.int64)
        self.feature = np.array([literal.feature for literal in unique], dtype=np.int64)
        bound = np.array([literal.bound for literal in unique], dtype=np.float64)
        self.sign = np.array([-1.0 if literal.is_upper else 1.0 for literal in unique])
        strict = np.array([literal.operator in ('<', '>') for literal in unique], dtype=bool)
        self.signed_bound = self.sign * bound
        with np.errstate(over='ignore'):
            below = np.nextafter(self.signed_bound, -np.inf)
        self.threshold = np.where(strict, self.signed_bound, below)
        # Not its reciprocal, which a very small range does not have.
        self.scale = rule_set.scale[self.feature]

    def judge_block(
        self, rows: np.ndarray, verdict: np.ndarray, rule: np.ndarray, margin: np.ndarray
    ) -> None:
        known = ((rows >= self.lows) & (rows <= self.highs)).all(axis=1)
        rule[:] = -1
        margin[:] = np.inf
        if len(self.order):
            signed = self.sign * rows[:, self.feature]
            truth = self._rule_truth(signed)
            first = truth.argmax(axis=1)
            violated = truth[np.arange(len(rows)), first]
            rule[violated] = self.order[first[violated]]
            margin[:] = self._rule_margins(signed).min(axis=1)
        verdict[:] = np.where(rule >= 0, Verdict.VIOLATED, Verdict.SAFE)
        verdict[~known] = Verdict.UNKNOWN
        rule[~known] = -1
        margin[~known] = np.nan

    def truth(self, rows: np.ndarray) -> np.ndarray:
        """(n, enabled rules) bool."""
        return self._rule_truth(self.sign * rows[:, self.feature])

    def margins(self, rows: np.ndarray) -> np.ndarray:
        """(n, enabled rules) float64."""
        return self._rule_margins(self.sign * rows[:, self.feature])

    def _rule_truth(self, signed: np.ndarray) -> np.ndarray:
        holds = signed > self.threshold
        return np.logical_and.reduceat(holds[:, self.members], self.starts, axis=1)

    def _rule_margins(self, signed: np.ndarray) -> np.ndarray:
        with np.errstate(invalid='ignore', over='ignore'):
            short_of = (self.signed_bound - signed) / self.scale
        return np.maximum.reduceat(short_of[:, self.members], self.starts, axis=1)


def rule_ids(space: FeatureSpace, literal_sets: Sequence[tuple]) -> list[str]:
    """Return an id for each conjunction that survives a small change of its bounds.

    The id is a digest of the features and operators only, so re-learning from similar
    demonstrations gives the same rule the same id; conjunctions alike but for their bounds are
    numbered in order.
    """
    seen: dict[str, int] = {}
    ids = []
    for literals in literal_sets:
        shape = ' and '.join(f'{space.names[item.feature]} {item.operator}' for item in literals)
        base = 'R' + hashlib.sha256(shape.encode()).hexdigest()[:5]
        seen[base] = seen.get(base, 0) + 1
        ids.append(base if seen[base] == 1 else f'{base}-{seen[base]}')
    return ids
