# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The verdicts in the monitor's own log: a line for each change, few lines where it flickers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.ros.diagnostics import why_unknown
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rules import Judgement, RuleSet, Verdict
from occ_constraints_pkg.wording import without_numbers

# So many changes are logged at once; then one line in so many seconds sums up.
_BURST, _SECONDS = 5, 5.0
_CHECK_SECONDS = 0.5
# A doubt that was gone for so many looks is logged anew.
_FORGOTTEN = 60


class StateLog:
    """Logs each change between SAFE, VIOLATED by a rule, and UNKNOWN for a reason.

    Args:
        node: logs.
    """

    def __init__(self, node: OccNode) -> None:
        self._node = node
        # The present state, and its line.
        self._state: tuple[Verdict, object] | None = None
        self._words = ''
        # Changes that were not logged, and the newest of these that was not to SAFE.
        self._unlogged, self._worst = 0, ''
        # Doubts that were logged, and for how many more looks they are remembered.
        self._doubted: dict[str, int] = {}
        self._lines, self._counted = float(_BURST), node.steady_seconds()
        node.steady_timer(_CHECK_SECONDS, self._log_if_due)

    def log_judgement(
        self, rule_set: RuleSet, rows: FeatureRows, judgement: Judgement, state: Verdict
    ) -> None:
        """Log a judgement if it is a change.

        Args:
            rule_set: the rules that judged.
            rows: what they judged.
            judgement: of these rows.
            state: the steady verdict, of a single robot; of several the worst one is logged.
        """
        robot, robots = 0, len(judgement.verdict)
        if robots > 1:
            robot = int(np.argmax(judgement.verdict))
            state = Verdict(judgement.verdict[robot])
        sample = rows.values[robot]
        if state is Verdict.UNKNOWN:
            self._change_to_unknown(rows.note or why_unknown(rule_set, sample), robot, robots)
            return
        rule = int(judgement.rule[robot]) if state is Verdict.VIOLATED else -1
        if self._state == (state, rule):
            return
        if state is Verdict.VIOLATED and rule < 0:
            # Steady still, though this input is safe.
            return
        if state is Verdict.SAFE:
            words = f'SAFE, margin {judgement.margin[robot]:.3g}'
        else:
            words = f'VIOLATED: {_violated(rule_set, sample, rule)}'
        self._change(state, rule, words + _which(robot, robots))

    def log_unknown(self, reason: str) -> None:
        """Log that nothing can be judged, if that is a change."""
        self._change_to_unknown(reason, 0, 1)

    def log_doubts(self, doubts: Sequence[str]) -> None:
        """Log each doubt about a sensor that is new, or was gone for a while."""
        doubted = {doubt: looks - 1 for doubt, looks in self._doubted.items() if looks > 1}
        for sentence in doubts:
            doubt = without_numbers(sentence)
            if doubt not in doubted:
                self._node.get_logger().warning(sentence)
            doubted[doubt] = _FORGOTTEN
        self._doubted = doubted

    def _change_to_unknown(self, reason: str, robot: int, robots: int) -> None:
        # The same reason with other numbers is no news.
        kind = without_numbers(reason)
        if self._state != (Verdict.UNKNOWN, kind):
            self._change(Verdict.UNKNOWN, kind, f'UNKNOWN: {reason}{_which(robot, robots)}')

    def _change(self, state: Verdict, kind: object, words: str) -> None:
        self._state, self._words = (state, kind), words
        self._unlogged += 1
        if state is not Verdict.SAFE:
            self._worst = words
        self._log_if_due()

    def _log_if_due(self) -> None:
        """Log the present state, unless that has been done or there were too many lines."""
        if not self._unlogged:
            return
        now = self._node.steady_seconds()
        self._lines = min(self._lines + (now - self._counted) / _SECONDS, _BURST)
        self._counted = now
        if self._lines < 1.0:
            return
        self._lines -= 1.0
        words, log = self._words, self._node.get_logger()
        if self._unlogged > 1:
            before = f'; before: {self._worst}' if self._state[0] is Verdict.SAFE else ''
            words += f' ({self._unlogged} changes since the last line{before})'
        # What was worse than SAFE is logged as such, though it may be over.
        if self._worst:
            log.warning(words)
        else:
            log.info(words)
        self._unlogged, self._worst = 0, ''


def _violated(rule_set: RuleSet, sample: np.ndarray, index: int) -> str:
    """Return which rule is violated, by which values, and how many others are."""
    rule, space = rule_set.rules[index], rule_set.space
    values = ', '.join(
        f'{space.names[feature]} = {sample[feature]:.4g}' for feature in rule.deciding(sample)
    )
    others = len(rule_set.violated_rules(sample)) - 1
    return f'{rule.id}: {rule.words(space)} ({values})' + (
        f', and {others} other rule{"s" if others > 1 else ""}' if others else ''
    )


def _which(robot: int, robots: int) -> str:
    return f' (robot {robot} of {robots})' if robots > 1 else ''
