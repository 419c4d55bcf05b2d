# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robot 0 of a simulation as the messages of a real robot, and driven as one."""

from importlib.util import find_spec

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table

pytest.importorskip('mujoco')

KINDS = ('goal', 'hazards', 'vases')


@pytest.fixture
def heard(observer):
    """Return by topic what the observer hears, each by its stamp."""
    from geometry_msgs.msg import TransformStamped
    from nav_msgs.msg import Odometry
    from occ_constraints_pkg.ros.messages import to_nanoseconds
    from occ_constraints_pkg.ros.qos import STEPS
    from sensor_msgs.msg import Imu, LaserScan, PointCloud2
    from visualization_msgs.msg import MarkerArray

    topics = {'observation': PointCloud2, 'odom': Odometry, 'imu': Imu, 'scene': MarkerArray}
    if find_spec('tf2_msgs') is None:
        topics['transform'] = TransformStamped
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
        for covariance in (
            odom.pose.covariance,
            odom.twist.covariance,
            imu.orientation_covariance,
            imu.angular_velocity_covariance,
            imu.linear_acceleration_covariance,
        ):
            size = round(len(covariance) ** 0.5)
            # A filter can invert it, and believes it.
            assert (np.linalg.eigvalsh(covariance.reshape(size, size)) > 1e-9).all()
        if 'transform' in heard:
            transform = heard['transform'][stamp]
            assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
            position, place = odom.pose.pose.position, transform.transform.translation
            assert (place.x, place.y, place.z) == (position.x, position.y, position.z)
            assert transform.transform.rotation == odom.pose.pose.orientation
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


MAP = """
schema_version: 1
pace: odom
max_age: 0.5
features:
- {name: v, topic: odom, field: twist.twist.linear.x, unit: m/s, bounds: [-10, 10]}
- {name: near, topic: scan/hazards, field: ranges, reduce: min, missing: max_range, unit: m, bounds: [0, 5]}
"""  # noqa: E501


@pytest.fixture
def sensor_rules(tmp_path):
    """Rules about the messages of a real robot, which hold for hardly any state."""
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.rules import Literal, Rule, RuleSet
    from occ_constraints_pkg.rules.constraints_file import Constraints

    (tmp_path / 'map.yaml').write_text(MAP)
    feature_map = load_feature_map(tmp_path / 'map.yaml')
    rule = Rule('R0', (Literal(0, '>', 9.0),))
    rule_set = RuleSet(feature_map.space, (rule,), np.array([[-1.0, 9.0], [0.0, 5.0]]))
    Constraints(rule_set, feature_map.to_document()).save(tmp_path / 'rules.yaml')
    return tmp_path / 'rules.yaml'


# At full speed a busy machine falls behind simulated time, which the monitor rightly tells.
@pytest.mark.parametrize('rate', [pytest.param(0.0, marks=pytest.mark.slow), 20.0])
def test_a_monitor_with_defaults_accepts_the_stamps(nodes, observer, sensor_rules, rate):
    from diagnostic_msgs.msg import DiagnosticArray

    # At full speed, 20 s of simulation take less than a second; at 20 Hz, 20 s take 50 s.
    verdicts = []
    observer.node.create_subscription(
        DiagnosticArray, 'violation', lambda message: verdicts.append(message.status[0]), 100
    )
    nodes.start('monitor', constraints_file=sensor_rules)
    nodes.start('policy', policy='expert')
    nodes.start('sim', world='PointGoal1', rate=rate)
    observer.spin_until(lambda: len(verdicts) > (3000 if rate == 0.0 else 60))
    later = verdicts[len(verdicts) // 2 :]
    assert {item.message.partition(':')[0] for item in later} == {'SAFE'}
