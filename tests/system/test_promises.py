# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A consumer notices a dead monitor by quality of service, if the monitor promises some."""

import itertools
import signal

import numpy as np
from occ_constraints_pkg.features.table import Table

SECOND_NS = 1_000_000_000
LEASE = 'qos_overrides./violation.publisher.liveliness_lease_duration'
DEADLINE = 'qos_overrides./violation.publisher.deadline'


def test_a_killed_monitor_is_noticed_by_deadline_and_by_liveliness(nodes, observer, rules_of):
    from diagnostic_msgs.msg import DiagnosticArray
    from occ_constraints_pkg.ros.qos import STEPS
    from occ_constraints_pkg.ros.tables import table_message
    from rclpy.duration import Duration
    from rclpy.event_handler import SubscriptionEventCallbacks
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import PointCloud2

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    monitor = nodes.start(
        'monitor', constraints_file=rules, **{LEASE: 2 * SECOND_NS, DEADLINE: 2 * SECOND_NS}
    )
    heard, missed, alive = [], [], []
    events = SubscriptionEventCallbacks(
        deadline=lambda event: missed.append(event.total_count_change),
        liveliness=lambda event: alive.append(event.alive_count),
    )
    limit = Duration(seconds=2.0)
    profile = QoSProfile(depth=10, deadline=limit, liveliness_lease_duration=limit)
    observer.node.create_subscription(
        DiagnosticArray, 'violation', heard.append, profile, event_callbacks=events
    )
    publisher = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
    stamps = itertools.count(10**18, 10**8)

    def publish():
        table = Table(('x', 'y'), np.array([[0.8, 0.2]]))
        publisher.publish(table_message(table, next(stamps), 'simple_nav'))
        observer.spin(0.1)
        return len(heard) > 10

    observer.spin_until(publish)
    assert alive[-1] == 1
    missed.clear()
    monitor.send_signal(signal.SIGKILL)
    observer.spin_until(lambda: alive[-1] == 0 and missed)


def test_an_override_changes_one_topic_only(nodes, observer, rules_of):
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    nodes.start(
        'monitor',
        constraints_file=rules,
        **{
            'qos_overrides./costs.publisher.reliability': 'best_effort',
            'qos_overrides./violation.publisher.durability': 'transient_local',
        },
    )
    topics = ('costs', 'cost', 'violation', 'margin')
    observer.spin_until(lambda: all(observer.node.count_publishers(topic) for topic in topics))
    offered = {
        topic: observer.node.get_publishers_info_by_topic(topic)[0].qos_profile for topic in topics
    }
    reliable = {
        topic: item.reliability == ReliabilityPolicy.RELIABLE for topic, item in offered.items()
    }
    assert reliable == {'costs': False, 'cost': True, 'violation': True, 'margin': True}
    kept = {
        topic
        for topic, item in offered.items()
        if item.durability == DurabilityPolicy.TRANSIENT_LOCAL
    }
    assert kept == {'violation'}
