# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robot 0 of a simulation as the messages of a real robot, and driven as one."""

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table

pytest.importorskip('mujoco')

KINDS = ('goal', 'hazards', 'vases')


@pytest.fixture
def heard(observer):
    """Return by topic what the observer hears, each by its stamp."""
    from nav_msgs.msg import Odometry
    from occ_constraints_pkg.ros.messages import to_nanoseconds
    from occ_constraints_pkg.ros.qos import STEPS
    from sensor_msgs.msg import Imu, LaserScan, PointCloud2
    from visualization_msgs.msg import MarkerArray

    topics = {'observation': PointCloud2, 'odom': Odometry, 'imu': Imu, 'scene': MarkerArray}
    topics |= {f'scan/{kind}': LaserScan for kind in KINDS}
    heard = {topic: {} for topic in topics}
    for topic, kind in topics.items():

        def keep(message, topic=topic):
            header = message.markers[0].header if topic == 'scene' else message.header
            heard[topic][to_nanoseconds(header.stamp)] = message

        observer.node.create_subscription(kind, topic, keep, STEPS)
    return heard


def _matched(observer, heard):
    return lambda: all(observer.node.count_publishers(topic) for topic in heard)


def test_typed_sensors_say_what_the_observation_says(nodes, observer, heard):
    from rosgraph_msgs.msg import Clock

    clock = []
    observer.node.create_subscription(Clock, '/clock', clock.append, 10)
    nodes.start('policy', policy='expert')
    # The observer listens twice to observation.
    # At a rate that the observer, with seven topics, can keep pace with.
    options = {'world': 'CarGoal1', 'num_robots': 2, 'publish_clock': True, 'rate': 30.0}
    nodes.start('sim', **options, wait_for_subscribers=3)
    observer.spin_until(_matched(observer, heard))

    def common():
        return sorted(set.intersection(*(set(messages) for messages in heard.values())))

    observer.spin_until(lambda: len(common()) >= 30 and len(clock) >= 30)
    assert clock[0].clock.sec > 1_700_000_000
    for stamp in common():
        table = Table.from_message(heard['observation'][stamp])

        def seen(column, table=table):
            return table.column(column)[0]

        odom, imu = heard['odom'][stamp], heard['imu'][stamp]
        assert (odom.header.frame_id, odom.child_frame_id) == ('odom', 'base_link')
        assert imu.header.frame_id == 'base_link'
        # A car drives along -y of its body: that is x of base_link.
        assert odom.twist.twist.linear.x == pytest.approx(-seen('velocimeter_y'), abs=1e-6)
        assert odom.twist.twist.linear.y == pytest.approx(seen('velocimeter_x'), abs=1e-6)
        assert odom.twist.twist.angular.z == pytest.approx(seen('gyro_z'), abs=1e-6)
        assert imu.linear_acceleration.z == pytest.approx(seen('accelerometer_z'), abs=1e-5)
        assert imu.orientation == odom.pose.pose.orientation
        for kind in KINDS:
            scan = heard[f'scan/{kind}'][stamp]
            assert scan.header.frame_id == 'base_link'
            assert len(scan.ranges) == 16
            assert scan.angle_max == pytest.approx(scan.angle_min + 15 * scan.angle_increment)
            ranges = np.array(scan.ranges)
            lidar = np.array([seen(f'{kind}_lidar_{index}') for index in range(16)])
            expected = np.where(lidar > 0, 3 * (1 - lidar), np.inf)
            # Bin 12 begins at -y of the body, which is straight ahead, and so the middle beam.
            np.testing.assert_allclose(ranges, np.roll(expected, -4), atol=1e-5)
        markers = heard['scene'][stamp].markers
        kinds = [marker.ns for marker in markers]
        assert kinds == ['goal', *['hazard'] * 8, 'vase', 'robot']
        assert {marker.header.frame_id for marker in markers} == {'odom'}
        assert markers[-1].pose.position == odom.pose.pose.position


def test_a_velocity_command_drives_until_it_is_missed(nodes, observer, heard):
    from geometry_msgs.msg import Twist

    publisher = observer.node.create_publisher(Twist, 'cmd_vel', 10)
    nodes.start('sim', world='CarGoal1', drive_by_cmd_vel=True, cmd_vel_timeout=1.0)
    observer.spin_until(lambda: publisher.get_subscription_count() == 1 and len(heard['odom']) > 2)

    def speed():
        return heard['odom'][max(heard['odom'])].twist.twist.linear.x

    def drive(speed):
        command = Twist()
        command.linear.x = speed
        publisher.publish(command)

    def fast():
        drive(0.5)
        return speed() > 0.4

    observer.spin_until(fast)
    drive(float('nan'))
    # Nobody commands any more.
    observer.spin_until(lambda: abs(speed()) < 0.1)
    log = nodes.started[0].log.read_text()
    assert 'cmd_vel ignored: a Twist asks for linear.x = nan' in log
