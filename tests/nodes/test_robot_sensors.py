# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The transform of the simulated robot, with tf2_msgs and without, which PyPI does not have."""

from types import SimpleNamespace

import numpy as np
import pytest
from occ_constraints_pkg.errors import InputError

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

VIEW = SimpleNamespace(
    position=np.array([1.0, 2.0, 0.1]), quaternion=np.array([0.6, 0.0, 0.0, 0.8])
)


class Node:
    """Keeps what is published, by topic, in place of a node of ROS."""

    def __init__(self):
        self.published = {}

    def create_publisher(self, kind, topic, *_, **__):
        sent = self.published.setdefault(topic, [])
        return SimpleNamespace(publish=sent.append, get_subscription_count=lambda: 1)


class TFMessage:
    """As that of tf2_msgs."""

    def __init__(self, *, transforms):
        self.transforms = transforms


@pytest.mark.parametrize('is_installed', [True, False])
def test_the_transform_is_where_its_readers_look(monkeypatch, is_installed):
    from occ_constraints_pkg.nodes import robot_sensors

    def message_class(name):
        assert name == 'tf2_msgs/msg/TFMessage'
        if not is_installed:
            raise InputError('not installed')
        return TFMessage

    monkeypatch.setattr(robot_sensors, 'message_class', message_class)
    for kind in ('odometry', 'imu', 'scene'):
        monkeypatch.setattr(robot_sensors, f'{kind}_message', lambda *_: None)
    node = Node()
    world = SimpleNamespace(view_kinds=(), view=lambda robot: VIEW)
    robot_sensors.RobotSensors(node, world).publish(1_500_000_000)
    assert ('/tf' in node.published) == is_installed
    assert ('transform' in node.published) != is_installed
    (sent,) = node.published['/tf' if is_installed else 'transform']
    (transform,) = sent.transforms if is_installed else [sent]
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (1, 500_000_000)
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 0.1)
    assert (turn.w, turn.z) == (0.6, 0.8)
