# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Mapped topics that are published with a wrong type, or with another one than before."""

import time

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints


def rules(pace='speed'):
    document = {
        'schema_version': 1,
        'pace': pace,
        'max_age': 0.5,
        'features': [{'name': 'v', 'topic': 'speed', 'field': 'twist.linear.x'}],
    }
    space = FeatureMap.from_document(document, '').space
    rule_set = RuleSet(space, (Rule('fast', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]]))
    return Constraints(rule_set, document)


class Publisher:
    """Another process's part: a node of its own, for a participant has one type per topic."""

    def __init__(self, domain, kind, topic='speed'):
        import rclpy

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('other', context=self.context)
        self.publisher, self.kind = self.node.create_publisher(kind, topic, 10), kind

    def send(self, speed=0.5):
        from occ_constraints_pkg.ros.messages import to_time

        message = self.kind()
        if hasattr(message, 'header'):
            message.header.stamp = to_time(time.time_ns())
        if hasattr(getattr(message, 'twist', None), 'linear'):
            message.twist.linear.x = speed
        self.publisher.publish(message)

    def close(self):
        import rclpy

        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def publisher(nodes):
    made = []

    def make(*arguments):
        made.append(Publisher(nodes.domain, *arguments))
        return made[-1]

    yield make
    for one in made:
        if one.context.ok():
            one.close()


@pytest.fixture
def told(observer):
    """Return a function that lets time go on until the last verdict is some words."""
    from diagnostic_msgs.msg import DiagnosticArray

    heard = []
    observer.node.create_subscription(DiagnosticArray, 'violation', heard.append, 10)

    def until(words, *publishers):
        def is_told():
            for publisher in publishers:
                publisher.send()
            return bool(heard) and heard[-1].status[0].message == words

        observer.spin_until(is_told)

    return until


WRONG = (
    'speed is published as geometry_msgs/msg/Point; '
    "feature 'v' of topic 'speed' asks for 'twist.linear.x', but the message has no 'twist'; "
    'it has x, y, z'
)


def test_a_wrong_type_is_told_and_the_right_one_taken_when_it_comes(nodes, publisher, told):
    from geometry_msgs.msg import Point, TwistStamped

    rules().save(nodes.folder / 'rules.yaml')
    wrong = publisher(Point)
    wrong.send()
    monitor = nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=0.5)
    told(f'UNKNOWN: {WRONG}', wrong)
    right = publisher(TwistStamped)
    # Though the wrong one is still there.
    told('SAFE', right, wrong)
    lines = monitor.log.read_text().splitlines()
    # Not counting the one that tells the change to UNKNOWN.
    assert sum(WRONG in line and '[ERROR]' in line for line in lines) == 1


def test_a_type_that_changes_is_followed(nodes, publisher, told):
    from geometry_msgs.msg import AccelStamped, TwistStamped, TwistWithCovarianceStamped

    rules().save(nodes.folder / 'rules.yaml')
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=0.5)
    first = publisher(TwistStamped)
    told('SAFE', first)
    first.close()
    wrong = publisher(AccelStamped)
    told(
        'UNKNOWN: speed is published as geometry_msgs/msg/AccelStamped; '
        "feature 'v' of topic 'speed' asks for 'twist.linear.x', but the message has no 'twist'; "
        'it has header, accel',
        wrong,
    )
    wrong.close()
    second = publisher(TwistStamped)
    told('SAFE', second)
    second.close()
    deeper = publisher(TwistWithCovarianceStamped)
    told(
        'UNKNOWN: speed is published as geometry_msgs/msg/TwistWithCovarianceStamped; '
        "feature 'v' of topic 'speed' asks for 'twist.linear.x', but twist has no 'linear'; "
        'it has twist, covariance',
        deeper,
    )


def test_two_types_that_can_both_be_read_are_followed(nodes, publisher, told):
    from geometry_msgs.msg import TwistStamped
    from nav_msgs.msg import Odometry

    constraints = rules()
    document = {**constraints.feature_map, 'features': [
        {'name': 'v', 'topic': 'speed', 'field': 'header.stamp.sec'}
    ]}  # fmt: skip
    far = (Rule('far', (Literal(0, '<', 0.0),)),)
    space = constraints.rule_set.space
    Constraints(RuleSet(space, far, np.array([[0.0, 1e10]])), document).save(
        nodes.folder / 'rules.yaml'
    )
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=0.5)
    first = publisher(TwistStamped)
    told('SAFE', first)
    first.close()

    told('SAFE', publisher(Odometry))


def test_a_held_topic_of_a_wrong_type_is_named_in_each_row(nodes, publisher, told):
    from geometry_msgs.msg import Point, TwistStamped
    from nav_msgs.msg import Odometry

    rules('odom').save(nodes.folder / 'rules.yaml')
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=5.0)

    odom = publisher(Odometry, 'odom')
    wrong = publisher(Point)
    told(f'UNKNOWN: {WRONG}', odom, wrong)
    right = publisher(TwistStamped)
    told('SAFE', right, odom)
