# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts as markers for RViz and Foxglove: the state in words, and the sectors that fired."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from occ_constraints_pkg.features.sources import FeatureSource
from occ_constraints_pkg.ros.messages import to_time
from occ_constraints_pkg.rules.verdict import Verdict

_COLOURS = {
    Verdict.SAFE: (0.1, 0.7, 0.2),
    Verdict.VIOLATED: (0.9, 0.1, 0.1),
    Verdict.UNKNOWN: (0.6, 0.6, 0.6),
}
_TEXT_METRES = 0.15
_LINE_METRES = 0.03
# Of a sector whose feature is no distance.
_RADIUS_METRES = 1.0
_ARC_DEGREES = 5.0


class Sector(NamedTuple):
    """A feature that is a sector of a scan.

    Attributes:
        number: the feature's number.
        feature: knows where the sector lies.
        frame: of the scan.
    """

    number: int
    feature: FeatureSource
    frame: str


def verdict_markers(
    state: Verdict, words: str, stamp_ns: int, sectors: Iterable[Marker] = ()
) -> MarkerArray:
    """Return markers that replace all those before: a text above ``base_link``, and sectors.

    Args:
        state: chooses the colour.
        words: the text's second line; may be empty.
        stamp_ns: stamp of all markers.
        sectors: what :func:`sector_markers` yields.
    """
    text = Marker(ns='monitor', id=0, type=Marker.TEXT_VIEW_FACING, action=Marker.ADD)
    text.header.frame_id = 'base_link'
    text.pose.position.z = 0.5
    text.scale.z = _TEXT_METRES
    text.text = f'{state.name}\n{words}' if words else state.name
    _paint(text, state)
    markers = [Marker(action=Marker.DELETEALL), text, *sectors]
    for marker in markers:
        marker.header.stamp = to_time(stamp_ns)
    return MarkerArray(markers=markers)


def sector_markers(sectors: Iterable[Sector], fired: dict[str, float]) -> Iterator[Marker]:
    """Yield an outline for each sector whose feature has fired.

    Args:
        sectors: those that can be drawn.
        fired: name and value of the features that violated rules are about.
    """
    for number, feature, frame_id in sectors:
        if feature.name in fired:
            marker = _outline(feature, fired[feature.name])
            marker.id, marker.header.frame_id = number, frame_id
            yield marker


def _outline(feature: FeatureSource, value: float) -> Marker:
    """Draw a sector out to the value that was measured in it."""
    radius = value if feature.unit == 'm' and 0.0 < value < math.inf else _RADIUS_METRES
    first, last = feature.degrees
    steps = max(1, math.ceil((last - first) / _ARC_DEGREES))
    angles = [math.radians(first + (last - first) * step / steps) for step in range(steps + 1)]
    arc = [Point(x=radius * math.cos(angle), y=radius * math.sin(angle)) for angle in angles]
    marker = Marker(ns='sectors', type=Marker.LINE_STRIP, action=Marker.ADD)
    marker.scale.x = _LINE_METRES
    marker.points = [Point(), *arc, Point()]
    _paint(marker, Verdict.VIOLATED)
    return marker


def _paint(marker: Marker, state: Verdict) -> None:
    marker.color.r, marker.color.g, marker.color.b = _COLOURS[state]
    marker.color.a = 1.0
