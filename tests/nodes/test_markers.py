# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What viewers are shown of a verdict."""

import math

import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules import Verdict

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

SCAN = {'topic': 'scan', 'field': 'ranges', 'reduce': 'min', 'unit': 'm', 'sectors': 4}
MAP = FeatureMap.from_document(
    {
        'schema_version': 1,
        'pace': 'scan',
        'max_age': 0.5,
        'features': [
            {'name': 'speed', 'topic': 'odom', 'field': 'twist.twist.linear.x'},
            {'name': 'gap', **SCAN},
        ],
    },
    '',
)


def shown(fired, frame='laser'):
    from occ_constraints_pkg.nodes.monitor.inputs import located_sectors
    from occ_constraints_pkg.nodes.monitor.markers import sector_markers, verdict_markers
    from sensor_msgs.msg import LaserScan
    from std_msgs.msg import Header

    newest = {} if frame is None else {'scan': LaserScan(header=Header(frame_id=frame))}
    sectors = sector_markers(located_sectors(MAP, newest), fired)
    clear, text, *outlines = verdict_markers(Verdict.VIOLATED, 'too near', 5, sectors).markers
    assert (clear.action, text.text) == (clear.DELETEALL, 'VIOLATED\ntoo near')
    assert text.header.frame_id == 'base_link'
    return outlines


def test_sectors_that_fired_are_outlined_to_what_was_measured():
    left, rear = shown({'speed': 2.0, 'gap_left': 0.5, 'gap_rear': math.nan})
    assert (left.header.frame_id, left.ns, left.header.stamp.nanosec) == ('laser', 'sectors', 5)
    assert left.id != rear.id
    assert (left.points[0].x, left.points[0].y) == (0.0, 0.0)
    assert left.points[0] == left.points[-1]
    # From 45 to 135 degrees.
    angles = [math.degrees(math.atan2(point.y, point.x)) for point in left.points[1:-1]]
    assert angles == pytest.approx([45.0 + 5.0 * step for step in range(19)])
    assert {round(math.hypot(point.x, point.y), 9) for point in left.points[1:-1]} == {0.5}
    # Nothing was measured to draw to.
    assert {round(math.hypot(point.x, point.y), 9) for point in rear.points[1:-1]} == {1.0}


def test_no_sector_is_outlined_that_did_not_fire_or_whose_frame_is_not_known():
    assert shown({'speed': 2.0}) == []
    assert shown({'gap_left': 0.5}, frame='') == []
    assert shown({'gap_left': 0.5}, frame=None) == []
