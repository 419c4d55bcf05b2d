# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rule set: a formula in disjunctive normal form that judges samples."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.evaluation import (
    Columns,
    Disjunction,
    RuleTable,
    ShortCircuit,
    factor,
)
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

# Samples per block: keeps the (literals, samples) intermediates in the cache.
_BLOCK = 1024
# Up to this many literals times samples, one table of all is faster than columns.
_FEW_LITERALS = 10_000
# Up to this many literals, the margin of one sample is faster without NumPy.
_FEW_IN_PYTHON = 250
# NumPy compares with a plain number much faster than with an enum member.
_SAFE, _VIOLATED, _UNKNOWN = (int(item) for item in Verdict)


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
        ConfigurationError: a duplicate id, an invalid demonstrated range, a literal on a feature
            or family that does not exist, or an enabled rule that can never be true, which is a
            mistake in a safety rule.

    Example:
        >>> space = occ.FeatureSpace((occ.Feature('speed', 'm/s'),))
        >>> fast = occ.Rule('fast', (occ.Literal(0, '>', 1.5),))
        >>> rule_set = occ.RuleSet(space, (fast,), np.array([[0.0, 1.0]]))
        >>> rule_set.judge(np.array([[1.0], [2.0]])).margin
        array([ 0.5, -0.5])
    """

    space: FeatureSpace
    rules: tuple[Rule, ...]
    demonstrated: np.ndarray

    def __post_init__(self) -> None:
        shape = np.shape(self.demonstrated)
        if shape != (len(self.space), 2):
            raise ConfigurationError(
                f'demonstrated ranges must be of shape ({len(self.space)}, 2), got {shape}'
            )
        ids = [rule.id for rule in self.rules]
        if len(set(ids)) != len(ids):
            twice = next(item for item in ids if ids.count(item) > 1)
            raise ConfigurationError(f'rule id {twice!r} is used twice; ids must be unique')
        for name, (low, high) in zip(self.space.names, self.demonstrated, strict=True):
            if not -np.inf < low <= high < np.inf:
                raise ConfigurationError(
                    f'feature {name!r} has the demonstrated range [{low}, {high}]; allowed are '
                    'two finite numbers, the smaller first'
                )
        for rule in self.rules:
            for literal in rule.literals:
                self._check_subject(rule, literal)
            if rule.enabled and rule.is_contradictory:
                raise ConfigurationError(
                    f'rule {rule.id!r} can never be true: {rule.formula(self.space)}; allowed '
                    'are literals that hold together, or the rule disabled'
                )

    def _check_subject(self, rule: Rule, literal: Literal) -> None:
        space, families = self.space, self.space.families
        if not isinstance(literal.feature, tuple):
            if not 0 <= literal.feature < len(space):
                raise ConfigurationError(
                    f'rule {rule.id!r} speaks of feature {literal.feature}; allowed are 0 to '
                    f'{len(space) - 1}'
                )
        elif literal.feature not in families:
            allowed = 'all members of one family of features: ' + ', '.join(map(str, families))
            raise ConfigurationError(
                f'rule {rule.id!r} speaks of any of the features {literal.feature}; allowed are '
                + (allowed if families else 'single features, as there is no family of several')
            )
        elif literal.name(space) in space.names:
            name = literal.name(space)
            raise ConfigurationError(
                f'rule {rule.id!r} speaks of {name}, a family, but a feature has the name {name!r} '
                'too; allowed is another name for one of them'
            )

    def __getstate__(self) -> dict[str, Any]:
        # Pickles and copies derive the rest again.
        return {name: self.__dict__[name] for name in ('space', 'rules', 'demonstrated')}

    @cached_property
    def scale(self) -> np.ndarray:
        """(k,) the range of each feature in the demonstrations, 1 where it was constant.

        Members of a family have the range of them all, so that it does not depend on the member
        how far a value is from a bound that they share.
        """
        low, high = np.array(self.demonstrated, dtype=np.float64).T
        for members in map(list, self.space.families):
            low[members], high[members] = low[members].min(), high[members].max()
        with np.errstate(over='ignore'):
            extent = high - low
        return np.where((extent > 0) & np.isfinite(extent), extent, 1.0)

    @cached_property
    def order(self) -> np.ndarray:
        """Positions of the enabled rules in order of evaluation: fewest literals first."""
        enabled = [index for index, rule in enumerate(self.rules) if rule.enabled]
        return np.array(
            sorted(enabled, key=lambda index: len(self.rules[index].literals)), dtype=np.int64
        )

    @property
    def problem(self) -> str:
        """Why these rules cannot prove safety; empty if they can.

        Without rules nothing is violated, so :meth:`judge` returns SAFE for all samples; whoever
        reports verdicts must report UNKNOWN instead.
        """
        return '' if len(self.order) else 'no rule is enabled'

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hex digits that identify the formula: features, bounds, enabled rules in order."""
        digest = hashlib.sha256()
        for feature in self.space.features:
            digest.update(
                f'{feature.name}|{float(feature.low)!r}|{float(feature.high)!r}\n'.encode()
            )
        for index in self.order:
            digest.update(f'{self.rules[index].formula(self.space)}\n'.encode())
        return digest.hexdigest()[:12]

    @cached_property
    def _enabled(self) -> tuple[Rule, ...]:
        """The enabled rules in order of evaluation."""
        return tuple(self.rules[index] for index in self.order)

    @cached_property
    def _size(self) -> int:
        return sum(len(rule.literals) for rule in self._enabled)

    @cached_property
    def _formula(self) -> Disjunction:
        return factor(self._enabled)

    @cached_property
    def _columns(self) -> Columns:
        return Columns(self.space, self._formula, self.scale)

    @cached_property
    def table(self) -> RuleTable:
        """The enabled rules as arrays, in order of evaluation."""
        return RuleTable(self._enabled, self.scale)

    @cached_property
    def _short_circuit(self) -> ShortCircuit:
        return ShortCircuit(self.space, self._formula, self.scale)

    def judge(self, values: np.ndarray) -> Judgement:
        """Judge samples.

        A sample is UNKNOWN when any feature is not finite or lies outside its physical bounds,
        VIOLATED when any enabled rule is true, else SAFE.

        The margin is the robustness of the formula in the maximum norm: for each rule the
        largest of its literals' distances from becoming true, over all rules the smallest. On a
        safe sample that is exactly the distance to the nearest violation (at most that, if a rule
        speaks of a family and of one of its members); on a violation its absolute value is a lower
        bound of the distance back to safety.

        Args:
            values: (n, k) numbers in the units of the feature space.

        Returns:
            A :class:`Judgement` of n samples.

        Raises:
            ConfigurationError: the array has another shape.
        """
        rows = self.space.check_rows(values)
        if len(rows) == 1:
            return self._judge_one(rows)
        if len(rows) * self._size <= _FEW_LITERALS:
            known = self.space.knows(rows)
            margin = (
                self.table.margins(rows).min(axis=0)
                if len(self.order)
                else np.full(len(rows), np.inf)
            )
        else:
            known, margin = self._columns.margins(rows)
        verdict = np.where(known, _SAFE, _UNKNOWN).astype(np.int8)
        rule = np.full(len(rows), -1, dtype=np.int64)
        margin[~known] = np.nan
        # The sign of a distance is that of its comparison; at 0, strictness decides.
        near = np.flatnonzero(margin <= 0.0)
        for start in range(0, len(near), _BLOCK):
            block = near[start : start + _BLOCK]
            truth = self.table.truth(rows[block])
            violated = truth.any(axis=0)
            rule[block[violated]] = self.order[truth.argmax(axis=0)[violated]]
        verdict[rule >= 0] = Verdict.VIOLATED
        return Judgement(verdict, rule, margin)

    def verdicts(self, values: np.ndarray) -> np.ndarray:
        """Return the verdicts of :meth:`judge` only, which takes a fraction of its time.

        Args:
            values: (n, k) numbers in the units of the feature space.

        Returns:
            (n,) int8, values of :class:`Verdict`.

        Raises:
            ConfigurationError: the array has another shape.
        """
        rows = self.space.check_rows(values)
        verdict = np.full(len(rows), Verdict.SAFE, dtype=np.int8)
        failed = np.flatnonzero(~self._columns.passed(rows))
        for start in range(0, len(failed), _BLOCK):
            block = failed[start : start + _BLOCK]
            known = self.space.knows(rows[block])
            verdict[block] = np.where(known, Verdict.VIOLATED, Verdict.UNKNOWN)
        return verdict

    def verdict(self, sample: np.ndarray) -> Verdict:
        """Return the verdict on one sample, the fastest way for a single one.

        Args:
            sample: (k,) numbers in the units of the feature space.

        Raises:
            ConfigurationError: the array has another shape.
        """
        row = np.asarray(sample, dtype=np.float64)
        if row.shape != (len(self.space),):
            self.space.check_rows(row[None])
        return self._short_circuit.verdict(row.tolist())

    def _judge_one(self, rows: np.ndarray) -> Judgement:
        row, verdict, rule = rows[0].tolist(), _SAFE, -1
        if not self._short_circuit.is_known(row):
            return Judgement(np.array([_UNKNOWN], np.int8), np.array([-1]), np.array([np.nan]))
        if self._size <= _FEW_IN_PYTHON:
            margin = self._short_circuit.margin(row)
        else:
            margin = self.table.margins(rows).min()
        # Where a distance is 0, strictness decides.
        if margin <= 0.0:
            truth = self.table.truth(rows)[:, 0]
            if truth.any():
                verdict, rule = _VIOLATED, self.order[truth.argmax()]
        return Judgement(np.array([verdict], np.int8), np.array([rule]), np.array([margin]))

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
            margins[self.order] = self.table.margins(row)[:, 0]
        return margins

    def violated_rules(self, sample: np.ndarray) -> np.ndarray:
        """Return the positions of all enabled rules that are true on one sample (k,)."""
        row = self.space.check_rows(np.asarray(sample, dtype=np.float64)[None])
        if not len(self.order):
            return self.order
        return self.order[self.table.truth(row)[:, 0]]

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

    Rules are evaluated in the order of :attr:`RuleSet.order` up to the first true one, so a rule is
    *evaluated* on a sample if no rule before it was true. UNKNOWN samples are not counted.
    """

    def __init__(self, rule_set: RuleSet) -> None:
        self._evaluated = np.zeros(len(rule_set.rules), dtype=np.int64)
        self._violated = np.zeros(len(rule_set.rules), dtype=np.int64)
        # Samples added one by one and not yet counted above, by the rule that was true; the last
        # entry (index -1) counts those where none was.
        self._single = [0] * (len(rule_set.rules) + 1)
        self._order = rule_set.order
        self._place = np.full(len(rule_set.rules), -1, dtype=np.int64)
        self._place[self._order] = np.arange(len(self._order))

    def add(self, judgement: Judgement) -> None:
        """Count the samples of one judgement by the same rule set."""
        if not len(self._order):
            return
        if len(judgement.verdict) == 1:
            # The general code takes ten times as long.
            if judgement.verdict[0] != _UNKNOWN:
                self._single[judgement.rule[0]] += 1
            return
        rule = judgement.rule[judgement.verdict != _UNKNOWN]
        stopped_at = self._place[rule[rule >= 0]]
        hits = np.bincount(stopped_at, minlength=len(self._order))
        self._count(hits, int(np.count_nonzero(rule < 0)))

    def _count(self, hits: np.ndarray, passed: int) -> None:
        """Count samples: for each enabled rule, how many it was first on; how many had none."""
        self._violated[self._order] += hits
        self._evaluated[self._order] += passed + np.cumsum(hits[::-1])[::-1]

    def _settle(self) -> None:
        if any(self._single):
            *stopped, passed = self._single
            self._single = [0] * len(self._single)
            self._count(np.array(stopped, dtype=np.int64)[self._order], passed)

    @property
    def evaluated(self) -> np.ndarray:
        """(rules,) int64."""
        self._settle()
        return self._evaluated

    @property
    def violated(self) -> np.ndarray:
        """(rules,) int64."""
        self._settle()
        return self._violated

    def reset(self) -> None:
        """Set all counters to zero."""
        self.evaluated[:] = 0
        self.violated[:] = 0


def rule_ids(space: FeatureSpace, literal_sets: Iterable[tuple[Literal, ...]]) -> list[str]:
    """Return an id for each conjunction that does not depend on its bounds.

    The id is a digest of the features, families and operators only, so re-learning from similar
    demonstrations gives the same rule the same id; conjunctions alike but for their bounds are
    numbered in order.
    """
    seen: dict[str, int] = {}
    ids = []
    for literals in literal_sets:
        shape = ' and '.join(f'{item.name(space)} {item.operator}' for item in literals)
        base = 'R' + hashlib.sha256(shape.encode()).hexdigest()[:5]
        seen[base] = seen.get(base, 0) + 1
        ids.append(base if seen[base] == 1 else f'{base}-{seen[base]}')
    return ids
