# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Every input gets its verdict, and silence gets one as well."""

from __future__ import annotations

from dataclasses import dataclass

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.nodes.monitor.inputs import LiveFeatures
from occ_constraints_pkg.nodes.monitor.outputs import VerdictTopics
from occ_constraints_pkg.nodes.monitor.rules_in_force import RulesInForce
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.rules import Judgement, Verdict
from occ_constraints_pkg.rules.gating import SteadyVerdict

_NO_RULES = 'no rule set yet'
_INACTIVE = 'the monitor is not active'
_DISABLED = 'the monitor is disabled'


@dataclass(frozen=True, eq=False)
class _Answer:
    """What was published for the newest input, for when that is repeated."""

    rows: FeatureRows
    judgement: Judgement


class Judging:
    """Judges live features by the rules in force, and publishes the verdicts while active.

    Attributes:
        problem: why the newest input is not judged; empty while it is.
        is_enabled: whether inputs are judged; while not, each is answered by UNKNOWN.

    Args:
        node: subscribes to the features' topics.
        rules: what to judge by.
        topics: where verdicts go.
    """

    def __init__(self, node: OccNode, rules: RulesInForce, topics: VerdictTopics) -> None:
        self._node, self._rules, self._topics = node, rules, topics
        self._features: LiveFeatures | None = None
        self.is_enabled = True
        self.problem = _INACTIVE
        self._is_active = self._is_silent = False
        self._steady = SteadyVerdict(1, 1, 1)
        self._answer: _Answer | None = None
        self._stamp_ns = 0

    @property
    def state(self) -> Verdict:
        """What to tell people: the steady verdict, of several robots the worst one as it is."""
        if self.problem or self._answer is None:
            return Verdict.UNKNOWN
        verdicts = self._answer.judgement.verdict
        return self._steady.state if len(verdicts) == 1 else Verdict(verdicts.max())

    def debounce(self, trigger_count: int, trigger_window: int, release_count: int) -> None:
        """Set how verdicts are debounced for people; see :class:`SteadyVerdict`.

        Raises:
            OccError: the numbers do not fit together.
        """
        self._steady = SteadyVerdict(trigger_count, trigger_window, release_count)

    def listen(
        self, feature_map: FeatureMap, timeout: float, max_lead: float, max_lag: float
    ) -> None:
        """Take the features from these topics.

        Args:
            feature_map: names them; with an equal one no input is missed.
            timeout: seconds without new input until the verdict is UNKNOWN.
            max_lead: see :class:`LiveFeatures`, as for ``max_lag``.
            max_lag: likewise.

        Raises:
            OccError: a topic cannot be subscribed to; the topics before stay.
        """
        if self._features is None:
            self._features = LiveFeatures(
                self._node,
                feature_map,
                (timeout, max_lead, max_lag),
                self._on_rows,
                self._on_fault,
            )
        else:
            self._features.use(feature_map)

    def start(self) -> None:
        """Begin to judge."""
        self._is_active = True
        self.forget(_NO_RULES if self._features is None else 'no input yet')
        if self._features is not None:
            self._features.renew()

    def stop(self) -> None:
        """Say UNKNOWN once more, and then nothing."""
        self._unknown(_INACTIVE)
        self._is_active = False
        self.forget(_INACTIVE)

    def close(self) -> None:
        """Drop the topics of the features."""
        if self._features is not None:
            self._features.close()
            self._features = None
        self._stamp_ns = 0

    def enable(self, is_enabled: bool) -> None:
        """Judge, or answer each input by UNKNOWN from now on."""
        self.is_enabled = is_enabled
        if self._is_active and not is_enabled:
            # Nor may a repeat of the newest input be answered as that was.
            self._answer = None
            self._unknown(_DISABLED)

    def forget(self, problem: str) -> None:
        """Have no answer to the newest input, for this reason; the rules have changed."""
        self._answer, self._is_silent = None, False
        self.problem = problem if self._is_active else _INACTIVE

    def watch(self) -> None:
        """Turn to UNKNOWN when the input has fallen silent; for a timer on the steady clock."""
        if self._is_active and self._features is not None and not self._is_silent:
            silence = self._features.silence
            if silence:
                self._unknown(silence)
                self._is_silent = True

    def insist(self) -> None:
        """Say UNKNOWN again while the input is silent, for whoever has come since."""
        if self._is_silent:
            self._unknown(self._features.silence or self.problem)

    def _on_rows(self, rows: FeatureRows) -> None:
        if not self._is_active:
            return
        answer = self._answer
        if rows.repeat and answer is not None:
            # Nothing new: in lock-step somebody may wait for the answer, but a sensor that only
            # repeats itself must not pass for a live one.
            self._publish_costs(answer)
            if not self._is_silent:
                self._publish_verdict(answer)
            return
        self._features.renew()
        self._is_silent = False
        self._stamp_ns = rows.stamp_ns
        problem = self._problem()
        if problem:
            self._answer = None
            self._unknown(problem)
            return
        judgement = self._rules.rule_set.judge(rows.values)
        self._answer = answer = _Answer(rows, judgement)
        # Before anything else: in lock-step somebody waits for it.
        self._publish_costs(answer)
        self._rules.counts.add_stamped(judgement, rows.stamp_ns)
        self._steady.add(Verdict(judgement.verdict[0]))
        self._publish_verdict(answer)

    def _problem(self) -> str:
        """Say why inputs cannot be judged; empty while they can."""
        if not self.is_enabled:
            return _DISABLED
        return self._features.clock_problem or self._rules.rule_set.problem

    def _on_fault(self, reason: str, stamp_ns: int) -> None:
        if self._is_active:
            self._answer, self._is_silent = None, False
            self._stamp_ns = stamp_ns
            self._unknown(reason)

    def _publish_costs(self, answer: _Answer) -> None:
        self._topics.publish_costs(self._rules.rule_set, answer.judgement, answer.rows.stamp_ns)

    def _publish_verdict(self, answer: _Answer) -> None:
        self.problem = ''
        self._topics.publish_verdict(
            self._rules.rule_set, answer.rows, answer.judgement, self._steady.state, self._features
        )

    def _unknown(self, reason: str) -> None:
        self.problem = reason
        self._steady.add(Verdict.UNKNOWN)
        self._topics.publish_unknown(reason, self._rules.rule_set, self._stamp_ns)
