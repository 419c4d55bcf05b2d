# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever comes on ``constraints``: it is refused with the reason, or used, and ends nothing."""

import time

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints

MAP = {
    'schema_version': 1,
    'pace': 'odom',
    'max_age': 0.5,
    'features': [{'name': 'v', 'topic': 'odom', 'field': 'twist.twist.linear.x'}],
}

# In the line of the log that tells which rules are used now.
USED = 'from topic constraints, rule set'


def constraints(feature_map=MAP, *, rules=None):
    document = {**MAP, **feature_map}
    names = [item['name'] for item in document['features']]
    space = FeatureMap.from_document(
        {**MAP, 'features': [{'name': name, 'topic': 't', 'field': 'x'} for name in names]}, ''
    ).space
    rules = rules or (Rule('fast', (Literal(0, '>', 1.0),)),)
    return Constraints(RuleSet(space, rules, np.tile([0.0, 1.0], (len(space), 1))), document)


def column(topic):
    return {'pace': topic, 'features': [{'name': 'v', 'topic': topic, 'column': 'x'}]}


def field(topic):
    return {'pace': topic, 'features': [{'name': 'v', 'topic': topic, 'field': 'data'}]}


# What is sent, and what the log says of it.
REFUSED = {
    'max_age': ({'max_age': 1e300}, 'max_age: got 1e+300; allowed is a number of at most 1000000'),
    'rate': ({'pace': {'rate': 1e-300}}, 'allowed is a number of at least 0.001'),
    'huge rate': ({'pace': {'rate': 1e300}}, 'allowed is a number of at most 1000000'),
    'long topic': (field('a' * 300), 'allowed is text no longer than 247'),
    'long in a namespace': (column('a' * 247), 'up to 247 characters with the namespace'),
    'token of digits': ({**field('odom'), 'pace': 'a/1b'}, "got 'a/1b'; allowed is a topic name"),
    'other type': (
        column('odom'),
        "topic 'odom' is to be read as sensor_msgs/msg/PointCloud2, but this node reads it as "
        'nav_msgs/msg/Odometry',
    ),
    'constraints': (column('constraints'), 'but this node reads it as std_msgs/msg/String'),
    **{
        f'{kind.__name__} of {topic}': (
            kind(topic),
            f"topic '{topic}' is one that node 'monitor' publishes itself",
        )
        for kind, topic in (
            (column, 'cost'),
            (column, 'costs'),
            (column, '/rule_stats'),
            (field, 'margin'),
            (field, 'violation'),
            (field, '/diagnostics'),
        )
    },
}


class Robot:
    """Publishes odometry and constraints, and hears the verdicts."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry
        from occ_constraints_pkg.ros.qos import LATCHED, STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self.observer, self.heard, self.text, self.new = observer, [], String, Odometry
        node = observer.node
        node.create_subscription(PointCloud2, 'costs', lambda message: None, STEPS)
        node.create_subscription(DiagnosticArray, 'violation', self.on_verdict, STEPS)
        self.odom = node.create_publisher(Odometry, 'odom', STEPS)
        self.constraints = node.create_publisher(String, 'constraints', LATCHED)

    def on_verdict(self, message):
        self.heard.append((time.monotonic(), message.status[0].message))

    def send(self, speed=0.5):
        from occ_constraints_pkg.ros.messages import to_time

        message = self.new()
        message.header.stamp = to_time(time.time_ns())
        message.twist.twist.linear.x = speed
        self.odom.publish(message)

    def is_judged(self):
        """Send, and tell whether SAFE is the answer to 0.5 and VIOLATED that to 1.5."""
        said = []
        for speed in (0.5, 1.5):
            count = len(self.heard)
            self.send(speed)
            self.observer.spin_until(lambda least=count: len(self.heard) > least)
            said.append(self.heard[-1][1].partition(':')[0])
        return said == ['SAFE', 'VIOLATED']

    def start(self, nodes):
        constraints().save(nodes.folder / 'rules.yaml')
        monitor = nodes.start(
            'monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=60.0, max_lag=10.0
        )
        self.observer.wait_for_monitor(2)
        self.observer.spin_until(lambda: self.odom.get_subscription_count() == 1)
        return monitor


@pytest.fixture
def robot(observer):
    return Robot(observer)


def test_what_cannot_be_used_is_refused_with_the_reason_and_the_rules_stay(nodes, robot):
    monitor = robot.start(nodes)
    text = constraints().dumps()
    cases = {name: (constraints(part).dumps(), words) for name, (part, words) in REFUSED.items()}
    cases['half a character'] = (text.replace('fast', '"\\ud800"'), 'allowed are whole characters')
    cases['nested'] = ('[' * 400_000, 'allowed are 350 levels at most')
    cases['long'] = (text + '#' * 1_000_001, 'allowed are 1000000 at most')
    cases['nothing'] = ('', 'allowed is a mapping of keys')
    assert robot.is_judged()
    for name, (sent, words) in cases.items():
        refused = monitor.log.read_text().count('rule set refused')
        robot.constraints.publish(robot.text(data=sent))
        robot.observer.spin_until(
            lambda least=refused: monitor.log.read_text().count('rule set refused') > least
        )
        told = monitor.log.read_text().splitlines()[-1]
        assert 'rule set refused, the one before stays: ' in told, name
        assert words in told, name
        assert robot.is_judged(), name
    # One that only another robot may use ends no monitor that starts later either.
    robot.constraints.publish(robot.text(data=cases['max_age'][0]))
    for _ in range(2):
        nodes.stop(monitor)
        monitor = robot.start(nodes)
        robot.observer.spin_until(lambda log=monitor.log: 'rule set refused' in log.read_text())
        assert robot.is_judged()


def test_odd_rules_that_may_be_used_end_nothing(nodes, robot):
    monitor = robot.start(nodes)
    odd = [
        # The smallest and largest numbers, and names that are no plain words.
        constraints(rules=(Rule('a\0b\x1b[31m\n', (Literal(0, '>', 1.7e308),)),)),
        constraints({'max_age': 1e-300}),
        constraints({'max_age': 1e6}),
        constraints({'pace': {'rate': 1e6}}),
        constraints({'features': [{**MAP['features'][0], 'bounds': [-1e308, 1e308]}]}),
        constraints(field('nobody_publishes_this')),
        constraints(field('a' * 200)),
        constraints(rules=(Rule('é' * 10_000, (Literal(0, '<', -5e-324),)),)),
    ]
    for rules in odd:
        used = monitor.log.read_text().count(USED)
        robot.constraints.publish(robot.text(data=rules.dumps()))
        robot.observer.spin_until(
            lambda least=used: monitor.log.read_text().count(USED) > least,
        )
        for speed in (0.0, np.nan, 1e308):
            robot.send(speed)
        robot.observer.spin(0.3)
        assert monitor.is_running, monitor.log.read_text()
    robot.constraints.publish(robot.text(data=constraints().dumps()))

    def is_judged():
        # The new subscription to the odometry has to be found first.
        return robot.odom.get_subscription_count() == 1 and robot.is_judged()

    robot.observer.spin_until(is_judged)


def test_thousands_of_rules_are_read_while_judging_goes_on_and_the_newest_counts(nodes, robot):
    monitor = robot.start(nodes)
    assert robot.is_judged()
    many = constraints(
        rules=tuple(Rule(f'R{n}', (Literal(0, '>', 2.0 + n / 1000),)) for n in range(2000))
    )
    for text in (many.dumps(), constraints(rules=many.rule_set.rules[:1500]).dumps()):
        robot.constraints.publish(robot.text(data=text))
    begin, gaps, sent = time.monotonic(), [], 0
    while 'from topic constraints' not in monitor.log.read_text():
        assert time.monotonic() < begin + 60.0
        count = len(robot.heard)
        robot.send()
        sent += 1
        at = time.monotonic()
        robot.observer.spin_until(lambda least=count: len(robot.heard) > least)
        gaps.append(robot.heard[-1][0] - at)
        robot.observer.spin(0.02)
    # Where the node reads by itself, one waits for all of it: seconds, and one answer. On a busy
    # machine all takes longer.
    took = time.monotonic() - begin
    assert sent > 5
    assert np.median(gaps) < max(0.1, took / 30)
    assert max(gaps) < max(1.0, took / 3)
    assert '1500 enabled rules from topic constraints' in monitor.log.read_text()
    assert '2000 enabled rules' not in monitor.log.read_text()
