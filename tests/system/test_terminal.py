# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a node tells whoever has nothing but its terminal."""

import json

import pytest
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints


@pytest.fixture
def hears(observer):
    """Return a function that waits until a node has told something, and returns its lines."""

    def wait(process, *words):
        def lines():
            return process.log.read_text().splitlines()

        observer.spin_until(lambda: all(any(w in line for line in lines()) for w in words))
        return lines()

    return wait


def counted(lines, words):
    return sum(words in line for line in lines)


@pytest.fixture
def speed_rules(tmp_path):
    """Return a file with a rule on the speed of a robot."""
    from occ_constraints_pkg.features.feature_map import FeatureMap

    feature_map = FeatureMap.from_document(
        {
            'schema_version': 1,
            'pace': 'odom',
            'max_age': 0.5,
            'features': [
                {
                    'name': 'speed',
                    'topic': 'odom',
                    'field': 'twist.twist.linear.x',
                    'unit': 'm/s',
                }
            ],
        },
        'map',
    )
    rules = RuleSet(feature_map.space, (Rule('FAST', (Literal(0, '>', 1.0),)),), [[0.0, 1.0]])
    path = tmp_path / 'rules.yaml'
    Constraints(rules, feature_map.to_document()).save(path)
    return path


def test_a_monitor_tells_from_its_start_to_each_change(nodes, observer, hears, speed_rules):
    from nav_msgs.msg import Odometry
    from occ_constraints_pkg.ros.qos import LATCHED
    from std_msgs.msg import String

    monitor = nodes.start('monitor', timeout=0.5)
    hears(monitor, 'waiting for rules on /constraints')
    offer = observer.node.create_publisher(String, 'constraints', LATCHED)
    text = speed_rules.read_text()
    offer.publish(String(data=text.replace('unit: m/s', 'unit: km/h', 1)))
    hears(monitor, 'rule set refused, the one before stays: topic constraints: features[0].unit')
    offer.publish(String(data=text))
    hears(monitor, 'from topic constraints, rule set', 'UNKNOWN: nobody publishes odom')
    odom = observer.node.create_publisher(Odometry, 'odom', 10)
    message = Odometry()

    def drive(speed):
        message.header.stamp = observer.node.get_clock().now().to_msg()
        message.twist.twist.linear.x = speed
        odom.publish(message)

    def driven(speed, words):
        def told():
            drive(speed)
            return words in monitor.log.read_text()

        observer.spin_until(told)

    driven(0.25, 'SAFE, margin 0.75')
    driven(1.5, 'VIOLATED: FAST: speed above 1 m/s (speed = 1.5)')
    lines = hears(monitor, 'UNKNOWN: no new input for 0.5 s')
    # Each once, though there were many inputs and many looks.
    for words in ('SAFE, margin', 'VIOLATED', 'nobody publishes odom'):
        assert counted(lines, words) == 1, lines
    for number in range(400):
        drive(1.5 * (number % 2))
        observer.spin(0.005)
    lines = monitor.log.read_text().splitlines()
    assert counted(lines, 'SAFE') + counted(lines, 'VIOLATED') < 12, lines


def test_a_monitor_that_is_not_to_start_by_itself_says_how_it_is_started(nodes, hears):
    monitor = nodes.start('monitor', autostart=False)
    line = hears(monitor, 'unconfigured')[-1]
    assert '/monitor/change_state' in line
    assert 'ros2 lifecycle set /monitor configure' in line


def test_nodes_that_wait_say_for_what(nodes, hears, small_bag):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    waiting = {
        'policy': ({'policy': 'expert'}, "policy 'expert', waiting for /a/observation"),
        'tree_learner': (
            {'feature_map': 'simple_nav'},
            'collecting samples from /a/observation until /a/tree_learner/learn is called',
        ),
        'constrained_learner': (
            {'output': nodes.folder / 'training'},
            'waiting for /a/observation and /a/costs',
        ),
        'player': (
            {'bag': small_bag, 'wait_for_subscribers': 9, 'start_paused': True},
            'waiting for 9 subscriptions and a call of /a/player/resume',
        ),
    }
    for name, (parameters, words) in waiting.items():
        hears(nodes.start(name, namespace='/a', **parameters), words)


def test_a_second_node_of_the_same_name_is_warned_of_on_both_sides(nodes, hears):
    both = [nodes.start('gate'), nodes.start('gate')]
    other = nodes.start('gate', namespace='/elsewhere')
    for gate in both:
        hears(gate, '2 nodes are called /gate; allowed is one')
    hears(other, 'STOP')
    assert counted(other.log.read_text().splitlines(), 'are called') == 0


def test_a_disk_without_room_for_counters_stops_no_monitor(
    nodes, observer, hears, speed_rules, tmp_path
):
    # What nothing can be written into, until it makes room.
    blocked = tmp_path / 'blocked'
    blocked.touch()
    monitor = nodes.start(
        'monitor', constraints_file=speed_rules, counts_file=blocked / 'counts.json'
    )
    hears(monitor, 'counters are not kept: cannot write', 'UNKNOWN: nobody publishes odom')
    observer.spin(2.5)
    assert monitor.is_running
    blocked.unlink()
    lines = hears(monitor, 'counters are kept again')
    assert counted(lines, 'counters are not kept') == 1
    assert (blocked / 'counts.json').is_file()


def test_damaged_counters_stop_no_monitor_and_are_kept_beside(
    nodes, observer, hears, speed_rules, tmp_path
):
    counts = tmp_path / 'counts.json'
    counts.write_text('{"format": "occ_con')
    monitor = nodes.start('monitor', constraints_file=speed_rules, counts_file=counts)
    hears(monitor, 'not a file of rule counters', 'UNKNOWN: nobody publishes odom')
    observer.spin_until(lambda: (tmp_path / 'counts.json.damaged').exists())
    observer.spin_until(counts.exists)
    assert (tmp_path / 'counts.json.damaged').read_text() == '{"format": "occ_con'
    assert json.loads(counts.read_text())['rules']['FAST']['evaluated'] == 0
