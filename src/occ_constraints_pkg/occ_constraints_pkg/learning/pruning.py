# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pruning of rules that are rarely violated when they are evaluated (paper, "Refining")."""

from __future__ import annotations

from dataclasses import dataclass, replace

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.wording import count_of


@dataclass(frozen=True)
class Pruning:
    """The result of pruning.

    Attributes:
        rule_set: the same rules, the pruned ones disabled with the reason in their note.
        pruned: ids of the rules now disabled.
        not_evaluated: ids of enabled rules that were never evaluated; there is no evidence against
            them, so they stay.
    """

    rule_set: RuleSet
    pruned: tuple[str, ...]
    not_evaluated: tuple[str, ...]

    @property
    def words(self) -> str:
        """How many rules were pruned and kept, in words."""
        text = f'pruned {count_of(len(self.pruned), "rule")}, kept {len(self.rule_set.order)}'
        return text + (
            f', {len(self.not_evaluated)} of them never evaluated' if self.not_evaluated else ''
        )


def prune(rule_set: RuleSet, threshold: float) -> Pruning:
    """Disable the rules whose share of violations among evaluations is below ``threshold``.

    Uses the counters of the rules. They come from a learner that maximises reward, so a rule that
    is never violated guards a region that is not worth visiting.

    Raises:
        ConfigurationError: the threshold is not within 0 to 1, no rule was ever evaluated, or none
            would remain: an empty formula calls everything safe.
    """
    if not 0.0 <= threshold <= 1.0:
        raise ConfigurationError(f'the pruning threshold is {threshold}; allowed is 0 to 1')
    if not any(rule.evaluated for rule in rule_set.rules if rule.enabled):
        raise ConfigurationError(
            'no enabled rule has been evaluated yet, so there is nothing to prune by; count '
            'first, with occ check --count, the monitor or the learner'
        )
    rules, pruned, not_evaluated = [], [], []
    for rule in rule_set.rules:
        if rule.enabled and not rule.evaluated:
            not_evaluated.append(rule.id)
        elif rule.enabled and rule.violated / rule.evaluated < threshold:
            reason = (
                f'pruned: violated {rule.violated} of {rule.evaluated} times, below {threshold:g}'
            )
            note = f'{rule.note}; {reason}' if rule.note else reason
            rule = replace(rule, enabled=False, note=note)
            pruned.append(rule.id)
        rules.append(rule)
    if not any(rule.enabled for rule in rules):
        raise ConfigurationError(
            f'a pruning threshold of {threshold:g} would disable every rule, and a formula without '
            'rules calls everything safe; choose a smaller one'
        )
    return Pruning(replace(rule_set, rules=tuple(rules)), tuple(pruned), tuple(not_evaluated))
