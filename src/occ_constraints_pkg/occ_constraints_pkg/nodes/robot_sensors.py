# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot as the messages that real robots send.

Units and axes are those of REP 103, frames those of REP 105 (``base_link`` in ``odom``), and a
beam that meets nothing is infinite, as in REP 117.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Quaternion, TransformStamped, Twist, Vector3
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, LaserScan
from visualization_msgs.msg import Marker, MarkerArray

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.ros.messages import message_class, to_time
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.qos import STEPS, overridable
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.view import RobotView, Thing

ODOM, BASE = 'odom', 'base_link'
# Variances along the diagonals of covariances: standard deviations of 1 mm, 1 mrad and the like,
# and of 0.01 m/s^2. The simulation is exact, but 0 means "unknown" of an Imu, and a filter that
# fuses odometry cannot invert a covariance of zeros.
_VARIANCE, _VARIANCE_OF_ACCELERATION = 1e-6, 1e-4
_SHAPES = {'cylinder': Marker.CYLINDER, 'box': Marker.CUBE}
_COLOURS = {
    'goal': (0.3, 0.7, 0.2, 0.4),
    'hazard': (0.5, 0.3, 0.8, 0.4),
    'pillar': (0.3, 0.3, 0.7, 1.0),
    'vase': (0.1, 0.6, 0.7, 1.0),
    'box': (0.9, 0.7, 0.1, 1.0),
    'robot': (0.8, 0.1, 0.1, 1.0),
}


class RobotSensors:
    """Publishes what robot 0 of a world senses, each topic while somebody subscribes to it.

    Topics are ``odom``, ``imu``, ``scan/<kind>`` for each lidar, ``scene``, and the transform from
    ``odom`` to ``base_link``: on ``/tf`` as everywhere in ROS, or, where its type is not installed
    (PyPI has no tf2_msgs), on ``transform``, which Foxglove and Lichtblick take as well. A world
    without such a view publishes none of them.

    Args:
        node: publishes.
        world: has been reset before :meth:`publish` is called.
    """

    def __init__(self, node: OccNode, world: World) -> None:
        self._world = world
        self._topics: list[tuple[Publisher, Callable[[RobotView, int], Any]]] = []
        if world.view_kinds is None:
            return
        kinds: list[tuple[type, str, Callable[[RobotView, int], Any]]] = [
            (Odometry, 'odom', odometry_message),
            (Imu, 'imu', imu_message),
            (MarkerArray, 'scene', scene_message),
        ]
        kinds += [
            (LaserScan, f'scan/{kind}', partial(scan_message, kind)) for kind in world.view_kinds
        ]
        try:
            tf_type = message_class('tf2_msgs/msg/TFMessage')
            kinds.append((tf_type, '/tf', partial(tf_message, tf_type)))
        except OccError:
            kinds.append((TransformStamped, 'transform', transform_message))
        for message_type, topic, make in kinds:
            publisher = node.create_publisher(
                message_type, topic, STEPS, qos_overriding_options=overridable()
            )
            self._topics.append((publisher, make))

    def publish(self, stamp_ns: int) -> None:
        """Publish the present state with this stamp."""
        wanted = [topic for topic in self._topics if topic[0].get_subscription_count()]
        if wanted:
            view = self._world.view(0)
            for publisher, make in wanted:
                publisher.publish(make(view, stamp_ns))


def odometry_message(view: RobotView, stamp_ns: int) -> Odometry:
    """Return pose in ``odom`` and velocity in ``base_link``."""
    message = Odometry(child_frame_id=BASE)
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), ODOM
    message.pose.pose.position = _point(view.position)
    message.pose.pose.orientation = _quaternion(view.quaternion)
    message.twist.twist.linear = _vector(view.linear_velocity)
    message.twist.twist.angular = _vector(view.angular_velocity)
    message.pose.covariance = message.twist.covariance = _diagonal(6, _VARIANCE)
    return message


def imu_message(view: RobotView, stamp_ns: int) -> Imu:
    """Return orientation, angular velocity and acceleration; gravity is in it (REP 145)."""
    message = Imu()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), BASE
    message.orientation = _quaternion(view.quaternion)
    message.angular_velocity = _vector(view.angular_velocity)
    message.linear_acceleration = _vector(view.acceleration)
    message.orientation_covariance = _diagonal(3, _VARIANCE)
    message.angular_velocity_covariance = _diagonal(3, _VARIANCE)
    message.linear_acceleration_covariance = _diagonal(3, _VARIANCE_OF_ACCELERATION)
    return message


def transform_message(view: RobotView, stamp_ns: int) -> TransformStamped:
    """Return where ``base_link`` is in ``odom``."""
    message = TransformStamped(child_frame_id=BASE)
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), ODOM
    message.transform.translation = _vector(view.position)
    message.transform.rotation = _quaternion(view.quaternion)
    return message


def tf_message(message_type: Any, view: RobotView, stamp_ns: int) -> Any:
    """Return the same as a message of tf2_msgs/msg/TFMessage, whose class is given."""
    return message_type(transforms=[transform_message(view, stamp_ns)])


def scan_message(kind: str, view: RobotView, stamp_ns: int) -> LaserScan:
    """Return one of the lidars, all of whose beams are read at once."""
    ranges = view.ranges[kind]
    message = LaserScan(
        angle_min=view.first_beam,
        angle_max=view.first_beam + (len(ranges) - 1) * view.beam_step,
        angle_increment=view.beam_step,
        range_max=view.range_max,
        ranges=ranges.tolist(),
    )
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), BASE
    return message


def scene_message(view: RobotView, stamp_ns: int) -> MarkerArray:
    """Return everything around the robot, and itself, as markers in ``odom``."""
    return MarkerArray(
        markers=[_marker(thing, number, stamp_ns) for number, thing in enumerate(view.things)]
    )


def twist_command(message: Twist) -> tuple[float, float]:
    """Return the speed ahead in m/s and the turning rate in rad/s that a Twist asks for.

    Raises:
        OccError: one of them is not finite.
    """
    speed, turning = message.linear.x, message.angular.z
    if not (isfinite(speed) and isfinite(turning)):
        raise ConfigurationError(
            f'a Twist asks for linear.x = {speed} and angular.z = {turning}; allowed are finite '
            'numbers'
        )
    return speed, turning


def _marker(thing: Thing, number: int, stamp_ns: int) -> Marker:
    marker = Marker(ns=thing.kind, id=number, type=_SHAPES[thing.shape], action=Marker.ADD)
    marker.header.stamp, marker.header.frame_id = to_time(stamp_ns), ODOM
    marker.pose.position = _point(thing.position)
    marker.pose.orientation = _quaternion(thing.quaternion)
    marker.scale = _vector(thing.size)
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = _COLOURS[thing.kind]
    return marker


def _diagonal(size: int, variance: float) -> np.ndarray:
    """Return a covariance row by row, (size * size,)."""
    return (np.eye(size) * variance).ravel()


def _point(values: np.ndarray) -> Point:
    x, y, z = values.tolist()
    return Point(x=x, y=y, z=z)


def _vector(values: np.ndarray) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: np.ndarray) -> Quaternion:
    w, x, y, z = values.tolist()
    return Quaternion(w=w, x=x, y=y, z=z)
