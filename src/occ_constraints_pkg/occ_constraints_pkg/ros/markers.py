# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts as a marker for RViz and Foxglove."""

from __future__ import annotations

from visualization_msgs.msg import Marker, MarkerArray

from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

_COLOURS = {
    Verdict.SAFE: (0.1, 0.7, 0.2),
    Verdict.VIOLATED: (0.9, 0.1, 0.1),
    Verdict.UNKNOWN: (0.6, 0.6, 0.6),
}
_TEXT_METRES = 0.15


def verdict_marker(rule_set: RuleSet, judgement: Judgement, stamp_ns: int) -> MarkerArray:
    """Write robot 0's verdict, and the first rule it violates, above its ``base_link``."""
    verdict = Verdict(judgement.verdict[0])
    marker = Marker(ns='monitor', id=0, type=Marker.TEXT_VIEW_FACING, action=Marker.ADD)
    marker.header.stamp = to_time(stamp_ns)
    marker.header.frame_id = 'base_link'
    marker.pose.position.z = 0.5
    marker.scale.z = _TEXT_METRES
    marker.color.r, marker.color.g, marker.color.b = _COLOURS[verdict]
    marker.color.a = 1.0
    marker.text = verdict.name
    if judgement.rule[0] >= 0:
        marker.text += f'\n{rule_set.rules[judgement.rule[0]].words(rule_set.space)}'
    return MarkerArray(markers=[marker])
