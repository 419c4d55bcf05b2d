# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From input to verdict: every input is judged, and silence is UNKNOWN. See `Pipeline.process`."""

from __future__ import annotations

from typing import Any

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.nodes.monitor.inputs import Inputs, TimeLimits
from occ_constraints_pkg.nodes.monitor.outputs import Answer, Outputs
from occ_constraints_pkg.nodes.monitor.rules_in_force import RulesInForce
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rules import RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import HORIZON_SECONDS, WINDOW_SECONDS, Forecast, Forecaster
from occ_constraints_pkg.rules.gating import SteadyVerdict

_NO_RULES = 'no rule set yet'
_INACTIVE = 'the monitor is not active'
_DISABLED = 'the monitor is disabled'


class Pipeline:
    """Judges live inputs by the rules in force, and publishes the verdicts while active.

    Attributes:
        problem: why the newest input is not judged; empty while it is.
        is_enabled: whether inputs are judged; while not, each is answered by UNKNOWN.

    Args:
        node: subscribes to the topics of the feature map.
        rules: what to judge by.
        outputs: where verdicts go.
    """

    def __init__(self, node: OccNode, rules: RulesInForce, outputs: Outputs) -> None:
        self._node, self._rules, self._outputs = node, rules, outputs
        self._inputs: Inputs | None = None
        self.is_enabled = True
        self.problem = _INACTIVE
        self._is_active = self._has_timed_out = False
        self._steady = SteadyVerdict(1, 1, 1)
        self._warning = EarlyWarning()
        # The answer to the newest input, for when that is repeated; None while it is UNKNOWN for
        # another reason than the values of its features.
        self._answer: Answer | None = None
        self._stamp_ns = 0

    def process(self, topic: str, message: Any, published_ns: int) -> None:
        """Judge one input, from the message to what is published of it.

        Args:
            topic: as the feature map writes it.
            message: of the topic's type, or the :class:`TableMessage` of a table.
            published_ns: when it was published by the publisher's clock, 0 if that is not known.
        """
        inputs, rules, outputs = self._inputs, self._rules, self._outputs

        # Message to rows of features. Most only become the latest value of their topic.
        try:
            rows = inputs.rows(topic, message, published_ns)
        except OccError as error:
            inputs.refresh()
            self._node.get_logger().error(f'input refused: {error}', throttle_duration_sec=1.0)
            if self._is_active:
                self._answer, self._has_timed_out = None, False
                self._stamp_ns = inputs.stamp_ns(message)
                self._publish_unknown(str(error))
            return
        if rows is None or not self._is_active:
            return

        # A repeat has the answer that it had. In lock-step somebody may wait for it, but a sensor
        # that only repeats itself must not pass for a live one, so silence goes on.
        if rows.repeat and self._answer is not None:
            outputs.publish_costs(self._answer)
            if not self._has_timed_out:
                self._publish_verdict()
            return
        inputs.refresh()
        self._has_timed_out = False
        self._answer, self._stamp_ns = None, rows.stamp_ns

        # Rows to a verdict, unless there is none: no time, no rules, or nobody wants it.
        rule_set = rules.rule_set
        problem = _DISABLED if not self.is_enabled else inputs.check_clock() or rule_set.problem
        if problem:
            self._publish_unknown(problem)
            return
        judgement = rule_set.judge(rows.values)
        self._answer = Answer(rule_set, rows, judgement)

        # Verdict to outputs: costs before anything else, for in lock-step somebody waits for them.
        outputs.publish_costs(self._answer)
        rules.counts.add_stamped(judgement, rows.stamp_ns)
        self._steady.add(self._answer.verdict)
        self._publish_verdict()

    def _publish_verdict(self) -> None:
        """Publish all but ``costs`` of the answer, with a forecast if somebody wants it."""
        self.problem = ''
        foreseen = self._warning.update(self._answer) if self._outputs.wants_forecast else {}
        self._outputs.publish_verdict(self._answer, self._steady.state, foreseen)
        if self._outputs.wants_markers:
            self._outputs.publish_markers(self._answer, self._steady.state, self._inputs.sectors())

    def _publish_unknown(self, reason: str) -> None:
        self.problem = reason
        self._steady.add(Verdict.UNKNOWN)
        self._outputs.publish_unknown(reason, self._rules.rule_set, self._stamp_ns)

    def check_timeout(self) -> None:
        """Turn to UNKNOWN when no new input has come; for a timer on the steady clock."""
        if self._is_active and self._inputs is not None and not self._has_timed_out:
            reason = self._inputs.check_timeout()
            if reason:
                self._publish_unknown(reason)
                self._has_timed_out = True

    def republish_timeout(self) -> None:
        """Publish UNKNOWN again while no input comes, for whoever has subscribed since."""
        if self._has_timed_out:
            self._publish_unknown(self._inputs.check_timeout() or self.problem)

    def doubts(self) -> list[str]:
        """Return what about the sensors is likely not so; to be called once a second."""
        if not self._is_active or self._inputs is None or self._has_timed_out:
            return []
        return self._inputs.doubts()

    @property
    def state(self) -> Verdict:
        """What people are shown: the steady verdict, of several robots the worst one as it is."""
        if self.problem or self._answer is None:
            return Verdict.UNKNOWN
        verdicts = self._answer.judgement.verdict
        return self._steady.state if len(verdicts) == 1 else Verdict(verdicts.max())

    def configure(self, steady: SteadyVerdict, warning: EarlyWarning, *, is_enabled: bool) -> None:
        """Set how verdicts are shown to people, and whether inputs are judged from the start."""
        self._steady, self._warning, self.is_enabled = steady, warning, is_enabled

    def subscribe(self, feature_map: FeatureMap, limits: TimeLimits) -> None:
        """Compute the features from their topics; with an equal map no input is missed.

        Args:
            feature_map: names the topics.
            limits: how late and how early inputs may be; those of the first call hold until
                :meth:`unsubscribe`.

        Raises:
            OccError: a topic cannot be subscribed to; the topics before stay.
        """
        if self._inputs is None:
            self._inputs = Inputs(self._node, feature_map, limits, self.process)
        else:
            self._inputs.use(feature_map)

    def unsubscribe(self) -> None:
        """Drop the topics of the features."""
        if self._inputs is not None:
            self._inputs.close()
            self._inputs = None
        self._stamp_ns = 0

    def activate(self) -> None:
        """Begin to judge."""
        self._is_active = True
        self.reset(_NO_RULES if self._inputs is None else 'no input yet')
        if self._inputs is not None:
            self._inputs.refresh()

    def deactivate(self) -> None:
        """Publish UNKNOWN once more, and then nothing."""
        self._publish_unknown(_INACTIVE)
        self._is_active = False
        self.reset(_INACTIVE)

    def enable(self, is_enabled: bool) -> None:
        """Judge, or answer each input by UNKNOWN from now on."""
        self.is_enabled = is_enabled
        if self._is_active and not is_enabled:
            # Nor may a repeat of the newest input be answered as that was.
            self._answer = None
            self._publish_unknown(_DISABLED)

    def reset(self, problem: str) -> None:
        """Drop the answer to the newest input, for this reason: the rules have changed."""
        self._answer, self._has_timed_out = None, False
        self.problem = problem if self._is_active else _INACTIVE


class EarlyWarning:
    """Estimates the time to a violation of robot 0, anew with other rules and with each episode.

    Args:
        horizon: seconds within which an estimated violation is warned of.
        window: seconds over which rates of change are estimated.
    """

    def __init__(self, horizon: float = HORIZON_SECONDS, window: float = WINDOW_SECONDS) -> None:
        self._horizon, self._window = horizon, window
        self._rules: RuleSet | None = None
        self._forecaster: Forecaster | None = None
        self._episode: float | None = None

    def update(self, answer: Answer) -> dict[str, object]:
        """Take one more row; return for people what is expected after it, see `foreseen_values`."""
        rule_set, rows = answer.rule_set, answer.rows
        if rule_set is not self._rules:
            self._rules, self._forecaster = rule_set, Forecaster(rule_set, self._window)
        table, episode = rows.table, None
        if table is not None and 'episode' in table.names:
            episode = float(table.column('episode')[0])
        if episode != self._episode:
            self._episode = episode
            self._forecaster.reset()
        self._forecaster.add(rows.stamp_ns, rows.values[0])
        forecast = self._forecaster.forecast(answer.verdict, int(answer.judgement.rule[0]))
        return foreseen_values(rule_set, forecast, self._horizon)


def foreseen_values(rule_set: RuleSet, forecast: Forecast, horizon: float) -> dict[str, object]:
    """Return what a forecast says, for people.

    Args:
        rule_set: the rules it is about.
        forecast: of one robot.
        horizon: seconds within which ``warning`` puts it in words, if the robot is safe still.

    Returns:
        ``time_to_violation`` in s; where a rule is next, ``next_rule``, ``deciding_feature`` and
        perhaps ``warning``.
    """
    values: dict[str, object] = {'time_to_violation': forecast.seconds}
    if forecast.rule >= 0:
        rule, feature = rule_set.rules[forecast.rule], rule_set.space.names[forecast.feature]
        values |= {'next_rule': rule.id, 'deciding_feature': feature}
        if 0.0 < forecast.seconds <= horizon:
            values['warning'] = (
                f'estimate: {rule.words(rule_set.space)} in {forecast.seconds:.2g} s, decided by '
                f'{feature}'
            )
    return values
