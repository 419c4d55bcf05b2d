# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The rule set that a monitor judges by, its counters, and the topic that tells it."""

from __future__ import annotations

import json

from std_msgs.msg import String

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.pruning import prune
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.qos import LATCHED, overridable
from occ_constraints_pkg.rules import RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.kept_counts import KeptCounts
from occ_constraints_pkg.rules.listing import rules_document


class RulesInForce:
    """Holds one rule set at a time and publishes each on the latched topic ``rules``.

    Attributes:
        counts: of the rules in force; None without rules.
        counts_file: where counters outlive a restart; empty for nowhere.

    Args:
        node: publishes.
    """

    def __init__(self, node: OccNode) -> None:
        self._node = node
        self._constraints: Constraints | None = None
        self.counts: KeptCounts | None = None
        self.counts_file = ''
        self._topic = node.create_publisher(
            String, 'rules', LATCHED, qos_overriding_options=overridable()
        )

    @property
    def rule_set(self) -> RuleSet | None:
        """The rules in force; None before any."""
        return None if self._constraints is None else self._constraints.rule_set

    def use(self, constraints: Constraints, where: str) -> None:
        """Judge by these rules from now on.

        Args:
            constraints: where the rules stand.
            where: what to call their origin.

        Raises:
            OccError: the file of counters cannot be read; the rules before stay.
        """
        counts = KeptCounts(constraints.rule_set, self.counts_file)
        self._constraints, self.counts = constraints, counts
        rule_set, log = constraints.rule_set, self._node.get_logger()
        log.info(
            f'{len(rule_set.order)} enabled rules from {where}, rule set {rule_set.fingerprint}'
            + (f'; counters go on from {self.counts_file}' if counts.resumed else '')
        )
        if not len(rule_set.order):
            log.warning(f'{where} enables no rule, so nothing will be a violation')
        self._topic.publish(String(data=json.dumps(rules_document(rule_set))))

    def prune(self, threshold: float, path: str) -> str:
        """Disable rules by the counters, and say in words what was done.

        Args:
            threshold: ratio of violations to evaluations under which a rule is disabled.
            path: where to write the constraints file; empty for nowhere.

        Raises:
            OccError: there are no rules or counts, or the file cannot be written; the rules stay.
        """
        if self._constraints is None:
            raise OccError('there is no rule set yet')
        result = prune(self._constraints.rule_set.with_counts(self.counts), threshold)
        pruned, words = self._constraints.with_rule_set(result.rule_set), result.words
        if path:
            pruned.save(path)
            words += f'; written to {path}'
        self.use(pruned, 'pruning')
        return words

    def keep(self) -> None:
        """Write the file of counters.

        Raises:
            OccError: it cannot be written.
        """
        if self.counts is not None:
            self.counts.keep()

    def drop(self) -> None:
        """Have no rules any more, once the counters are kept."""
        self.keep()
        self._constraints = self.counts = None
