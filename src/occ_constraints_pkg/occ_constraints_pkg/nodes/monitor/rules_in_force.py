# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rule set that a monitor judges by, its counters, and the topic that shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from std_msgs.msg import String

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import LATCHED, overridable
from occ_constraints_pkg.rules import RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints, save_derived
from occ_constraints_pkg.rules.edits import RuleEdits
from occ_constraints_pkg.rules.listing import rules_in_force_text
from occ_constraints_pkg.rules.persistent_counts import PersistentCounts
from occ_constraints_pkg.wording import count_of

# How long a disk that stays full is not reported again.
_SILENT_SECONDS = 60.0


@dataclass(frozen=True, eq=False)
class PreparedRules:
    """Rules that are ready to come into force.

    Attributes:
        base: as they were given.
        edited: with the edits.
        counts: of the latter.
        left_out: whether some of the edits are of rules that are not there.
        where: what to call their origin.
        pruned: ids of the rules that pruning has disabled, which no edit brings back.
    """

    base: Constraints
    edited: Constraints
    counts: PersistentCounts
    left_out: bool
    where: str
    pruned: frozenset[str] = frozenset()


class RulesInForce:
    """Holds one rule set at a time and publishes each on the latched topic ``rules``.

    What is in force changes as a whole, between two inputs.

    Attributes:
        counts_file: where counters outlive a restart; empty for nowhere.
        edits: what a person has changed by parameters.

    Args:
        node: publishes.
    """

    def __init__(self, node: OccNode) -> None:
        self._node = node
        self._now: PreparedRules | None = None
        self.counts_file = ''
        # Whether it is reported that counters are not kept, and when it may be reported again.
        self._is_reported, self._silent_until = False, -math.inf
        self.edits = RuleEdits()
        self._topic = node.create_publisher(
            String, 'rules', LATCHED, qos_overriding_options=overridable()
        )

    @property
    def rule_set(self) -> RuleSet | None:
        """The rules in force; None before any."""
        return None if self._now is None else self._now.edited.rule_set

    @property
    def counts(self) -> PersistentCounts | None:
        """The counters of the rules in force; None without rules."""
        return None if self._now is None else self._now.counts

    def prepare(
        self,
        constraints: Constraints,
        where: str,
        *,
        strict: bool,
        pruned: frozenset[str] = frozenset(),
    ) -> PreparedRules:
        """Edit rules and find their counters, without any effect yet.

        Args:
            constraints: with the rules.
            where: what to call their origin.
            strict: whether edits of rules that are not there are an error; else they are left out.
            pruned: ids of rules that stay disabled.

        Raises:
            OccError: the rules cannot be edited so.
        """
        edits = self.edits if strict else self.edits.within(constraints.rule_set)
        left_out = edits != self.edits
        edits = replace(edits, enabled=tuple(name for name in edits.enabled if name not in pruned))
        edited = constraints.with_rule_set(edits.apply(constraints.rule_set))
        counts = PersistentCounts(edited.rule_set, self.counts_file)
        return PreparedRules(constraints, edited, counts, left_out, where, pruned)

    def use(self, rules: PreparedRules) -> None:
        """Judge by these rules from now on."""
        self.save_counts()
        self._now = rules
        rule_set, log = rules.edited.rule_set, self._node.get_logger()
        log.info(
            f'{count_of(len(rule_set.order), "enabled rule")} from {rules.where}, rule set '
            f'{rule_set.fingerprint}'
            + (f'; counters go on from {self.counts_file}' if rules.counts.resumed else '')
        )
        if rules.counts.problem:
            log.warning(
                f'{rules.counts.problem}; counters begin at 0, and that file is kept beside'
            )
        if rules.left_out:
            log.warning(f'some of the edits by parameter are of no rule of {rules.where}')
        if not len(rule_set.order):
            log.warning(f'{rules.where} enables no rule, so every verdict will be UNKNOWN')
        self._topic.publish(String(data=rules_in_force_text(rule_set)))

    def check(self, edits: RuleEdits) -> None:
        """Check that these edits can be made.

        Raises:
            OccError: they cannot.
        """
        if self._now is None:
            return
        edits.apply(self._now.base.rule_set)
        # What is still listed from before the pruning stays without effect.
        back = self._now.pruned & (set(edits.enabled) - set(self.edits.enabled))
        if back:
            raise ConfigurationError(
                f'rule {min(back)!r} is to be enabled, but was pruned; allowed is that once '
                'constraints are loaded anew'
            )

    def edit(self, edits: RuleEdits) -> None:
        """Make these edits instead of those before; :meth:`check` has allowed them."""
        self.edits = edits
        if self._now is not None:
            now = self._now
            self.use(self.prepare(now.base, 'parameters', strict=True, pruned=now.pruned))

    def prune(self, threshold: float, path: str) -> str:
        """Disable rules by the counters, and return in words what was done.

        Args:
            threshold: ratio of violations to evaluations under which a rule is disabled.
            path: where to write the constraints file; empty for nowhere.

        Raises:
            OccError: there are no rules or counts, or the file cannot be written; the rules stay.
        """
        if self._now is None:
            raise ConfigurationError('there is no rule set yet')
        before = self._now
        result = prune(before.edited.rule_set.with_counts(before.counts), threshold)
        words = result.words
        if path:
            save_derived(before.edited.with_rule_set(result.rule_set), path)
            words += f'; written to {path}'
        base = before.base.rule_set
        rules = tuple(
            replace(rule, enabled=False, note=pruned.note) if rule.id in result.pruned else rule
            for rule, pruned in zip(base.rules, result.rule_set.rules, strict=True)
        )
        base = before.base.with_rule_set(replace(base, rules=rules))
        # Edits stay, but none may bring back what was pruned.
        pruned = before.pruned.union(result.pruned)
        self.use(self.prepare(base, 'pruning', strict=False, pruned=pruned))
        return words

    def save_counts(self) -> None:
        """Write the file of counters; where that fails, report it and go on without.

        Counters are a statistic, for which no robot is to stop.
        """
        if self.counts is None:
            return
        log = self._node.get_logger()
        try:
            self.counts.keep()
        except OccError as error:
            now = self._node.steady_seconds()
            if now >= self._silent_until:
                log.warning(f'counters are not kept: {error}')
                self._silent_until, self._is_reported = now + _SILENT_SECONDS, True
        else:
            if self._is_reported:
                log.info(f'counters are kept again in {self.counts_file}')
            self._is_reported = False

    def clear(self) -> None:
        """Have no rules any more, once the counters are kept."""
        self.save_counts()
        self._now = None
