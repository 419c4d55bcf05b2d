# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The topics on which verdicts go out; of those for people, only what somebody listens to."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from visualization_msgs.msg import MarkerArray

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.nodes.monitor.costs import costs_message
from occ_constraints_pkg.nodes.monitor.early_warning import EarlyWarning
from occ_constraints_pkg.nodes.monitor.inputs import LiveFeatures
from occ_constraints_pkg.nodes.monitor.markers import sector_markers, verdict_markers
from occ_constraints_pkg.nodes.monitor.state_log import StateLog
from occ_constraints_pkg.ros.diagnostics import (
    foreseen_values,
    unknown_message,
    violation_message,
)
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.qos import VERDICTS, overridable
from occ_constraints_pkg.rules import Judgement, RuleSet, Verdict


class VerdictTopics:
    """Publishes judgements on several topics, each while somebody subscribes to it.

    Changes are told in the log as well, for whoever has nothing but the node's terminal.

    Attributes:
        warning: estimates the time to a violation.

    Args:
        node: publishes.
    """

    def __init__(self, node: OccNode) -> None:
        def publisher(kind: Any, topic: str) -> Publisher:
            return node.create_publisher(
                kind, topic, VERDICTS, qos_overriding_options=overridable()
            )

        self.warning = EarlyWarning()
        self._log = StateLog(node)
        self._costs = publisher(PointCloud2, 'costs')
        self._cost = publisher(Float64, 'cost')
        self._margin = publisher(Float64, 'margin')
        self._time = publisher(Float64, 'time_to_violation')
        self._violation = publisher(DiagnosticArray, 'violation')
        self._markers = publisher(MarkerArray, 'markers')

    @property
    def subscribers(self) -> int:
        """The smaller one of the numbers of subscribers of ``costs`` and ``violation``."""
        topics = (self._costs, self._violation)
        return min(publisher.get_subscription_count() for publisher in topics)

    def publish_costs(self, rule_set: RuleSet, judgement: Judgement, stamp_ns: int) -> None:
        """Answer an input with one row per robot, in the name of the rule set that judged."""
        if self._costs.get_subscription_count():
            self._costs.publish(costs_message(judgement, stamp_ns, rule_set.fingerprint))

    def publish_verdict(
        self,
        rule_set: RuleSet,
        rows: FeatureRows,
        judgement: Judgement,
        state: Verdict,
        features: LiveFeatures,
    ) -> None:
        """Publish all but ``costs``.

        Args:
            rule_set: the rules that judged.
            rows: what they judged.
            judgement: of these rows.
            state: the steady verdict on robot 0, for people.
            features: where the rows come from.
        """
        stamp, verdict = rows.stamp_ns, Verdict(judgement.verdict[0])
        if self._cost.get_subscription_count():
            self._cost.publish(Float64(data=0.0 if verdict is Verdict.SAFE else 1.0))
        if self._margin.get_subscription_count():
            self._margin.publish(Float64(data=float(judgement.margin[0])))
        is_time_wanted = self._time.get_subscription_count()
        is_told = self._violation.get_subscription_count()
        if is_time_wanted or is_told:
            forecast = self.warning.look(rule_set, rows, judgement)
            if is_time_wanted:
                self._time.publish(Float64(data=forecast.seconds))
            if is_told:
                more = {
                    **({'reason': rows.note} if rows.note else {}),
                    'state': state.name,
                    **foreseen_values(rule_set, forecast, self.warning.horizon),
                }
                self._violation.publish(
                    violation_message(rule_set, rows.values, judgement, stamp, more)
                )
        if self._markers.get_subscription_count():
            self._markers.publish(_markers(rule_set, rows, state, features))
        self._log.judged(rule_set, rows, judgement, state)

    def publish_unknown(self, reason: str, rule_set: RuleSet | None, stamp_ns: int) -> None:
        """Say that nothing can be judged, and why; ``stamp_ns`` is that of the last input."""
        self._cost.publish(Float64(data=1.0))
        self._margin.publish(Float64(data=math.nan))
        self._time.publish(Float64(data=math.nan))
        self._violation.publish(unknown_message(reason, rule_set, stamp_ns))
        if self._markers.get_subscription_count():
            self._markers.publish(verdict_markers(Verdict.UNKNOWN, reason, stamp_ns))
        self._log.unknown(reason)


def _markers(
    rule_set: RuleSet, rows: FeatureRows, state: Verdict, features: LiveFeatures
) -> MarkerArray:
    """Return the markers of robot 0; rules and sectors are those violated now."""
    sample, names = rows.values[0], rule_set.space.names
    violated = [rule_set.rules[place] for place in rule_set.violated_rules(sample)]
    fired = {
        names[literal.feature]: float(sample[literal.feature])
        for rule in violated
        for literal in rule.literals
    }
    words = '\n'.join(rule.words(rule_set.space) for rule in violated)
    sectors = sector_markers(features.feature_map, fired, features.frame)
    return verdict_markers(state, words, rows.stamp_ns, sectors)
