# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recorder and player where publishers of one topic offer different qualities of service."""

import signal

import pytest
from occ_constraints_pkg.rosbag.recording import Recording
from ruamel.yaml import YAML


def test_publishers_that_offer_different_qualities_are_recorded_and_played(
    nodes, observer, make_nodes
):
    from listener import Listener
    from occ_constraints_pkg.ros.qos import LATCHED, SENSORS
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    bag = nodes.folder / 'bag'
    latched = observer.node.create_publisher(String, 'mixed', LATCHED)
    latched.publish(String(data='before the recorder'))
    recorder = nodes.start('recorder', output=bag, topics=['mixed', 'never'])
    observer.spin_until(lambda: recorded(bag) == 1)
    modest = observer.node.create_publisher(String, 'mixed', SENSORS)
    for publisher in (latched, modest):
        observer.spin_until(lambda p=publisher: p.get_subscription_count() == 1)
    modest.publish(String(data='modest'))
    latched.publish(String(data='reliable'))
    observer.spin_until(lambda: recorded(bag) >= 3)
    nodes.stop(recorder)
    assert 'nobody has published /never so far' in recorder.log.read_text()
    expected = ['before the recorder', 'modest', 'reliable']
    assert texts(bag) == expected

    # A late subscriber that asks for the most gets all that was latched.
    other, heard = make_nodes(), []
    deep = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with Listener(other.domain) as listener:
        player = other.start('player', bag=bag, rate=100.0, wait_for_subscribers=1)
        listener.node.create_subscription(
            String, 'mixed', lambda message: heard.append(message.data), deep
        )
        listener.spin_until(lambda: not player.is_running)
        listener.spin_until(lambda: heard == expected)
    other.stop()


def recorded(bag):
    """Return how many messages have reached the file so far."""
    try:
        return Recording(bag).message_count
    except Exception:
        return 0


def texts(bag):
    recording = Recording(bag)
    return [recording.decode(message).data for message in recording.messages(['mixed'])]


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_a_recorder_of_many_topics_loses_next_to_nothing(tmp_path, number):
    from occ_constraints_pkg.demo.processes import private_domain

    from benchmarks.record import record

    # With metadata.yaml written for each new topic, it had fallen seconds behind by then.
    with private_domain() as domain:
        ending = record(tmp_path, domain, number, after=4.0, topics=200, rate=5.0)
    assert ending.topics == 200
    assert ending.expected > 2000
    assert ending.late_seconds < 0.5
    listed = len(information(tmp_path / 'bag')['topics_with_message_count'])
    if number == signal.SIGKILL:
        assert ending.lost_seconds <= 0.5
        # It is written again for new topics, but not all the time.
        assert listed >= 20
    else:
        assert ending.lost == 0
        # On a busy machine too; a second is usual.
        assert ending.end_seconds < 10.0
        assert listed >= 200


def information(bag):
    return YAML(typ='safe').load(bag / 'metadata.yaml')['rosbag2_bagfile_information']


def test_the_duration_counts_from_the_first_message(nodes, observer):
    from rclpy.clock import Clock, ClockType
    from std_msgs.msg import String

    bag, steady = nodes.folder / 'bag', Clock(clock_type=ClockType.STEADY_TIME)
    recorder = nodes.start('recorder', output=bag, duration=1.0)
    observer.spin_until(lambda: 'recording' in recorder.log.read_text())
    # Nothing has come so far, for longer than the duration.
    observer.spin(1.5)
    assert recorder.is_running
    publisher = observer.node.create_publisher(String, 'late', 10)
    observer.spin_until(lambda: publisher.get_subscription_count() == 1)
    first = steady.now()

    def publish():
        publisher.publish(String(data='late'))
        return not recorder.is_running

    observer.spin_until(publish)
    assert (steady.now() - first).nanoseconds > 0.9e9
    assert recorder.join() == 0
    assert 'ending, 1 s after the first message' in recorder.log.read_text()
    assert Recording(bag).topics['/late'].count > 0
