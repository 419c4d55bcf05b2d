# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Bags of the seconds around events: of a violation, by hand, and of a recorder that is ended."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.rosbag.event_bags import event_bags, event_document
from occ_constraints_pkg.rosbag.recording import Recording

SAFE, UNSAFE = (0.8, 0.2), (0.2, 0.8)


class Drive:
    """A robot that is observed, and what is told of its events."""

    def __init__(self, observer):
        from occ_constraints_pkg.ros.qos import STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self.observer, self.events = observer, []
        self.publisher = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
        observer.node.create_subscription(
            String, 'events', lambda message: self.events.append(json.loads(message.data)), STEPS
        )

    def send(self, values, count=1):
        """Publish states, 50 in a second; return their stamps."""
        from occ_constraints_pkg.features.table import Table
        from occ_constraints_pkg.ros.tables import table_message

        stamps = []
        for _ in range(count):
            stamps.append(time.time_ns())
            table = Table(('x', 'y', 'episode'), np.array([[*values, 0.0]]))
            self.publisher.publish(table_message(table, stamps[-1], 'simple_nav'))
            self.observer.spin(0.02)
        return stamps

    def until(self, condition):
        """Go on safely until a condition holds."""
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, 'nothing came of waiting'
            self.send(SAFE)


@pytest.fixture
def recording(nodes, observer, rules_of):
    """Return a drive with a monitor and an event_recorder, the file of rules, and the bags."""
    rules, bags = nodes.folder / 'rules.yaml', nodes.folder / 'bags'
    rules_of['simple_nav'].save(rules)
    drive = Drive(observer)
    nodes.start('monitor', constraints_file=rules)
    drive.recorder = nodes.start(
        'event_recorder',
        store=nodes.folder / 'events',
        directory=bags,
        exclude_kinds=['unknown', 'near_miss', 'stop'],
        before=1.0,
        after=0.5,
    )
    # The monitor, this observer and the recorder, which also captures it; all of them listen.
    drive.until(lambda: drive.publisher.get_subscription_count() >= 3)
    observer.wait_for_monitor(2)
    return drive, rules, bags


def test_a_bag_of_a_violation_shows_the_same_violation(recording, trigger, run_occ):
    drive, rules, bags = recording
    drive.send(SAFE, 75)
    wrong = drive.send(UNSAFE, 10)
    drive.until(lambda: event_bags(bags))
    (bag,) = event_bags(bags)
    # The store and whoever listens know where it is.
    drive.until(lambda: drive.events[-1]['bag'] == str(bag.path))
    event = drive.events[-1]
    assert (event['kind'], event['phase'], event['rule']) == ('violation', 'ended', 'R1')

    found = Recording(bag.path)
    assert {'/observation', '/violation', '/rules', '/events'} <= set(found.topics)
    assert found.topics['/rules'].offered_qos[0]['durability'] == 'transient_local'
    # The rules came long before the window.
    logged = [raw.log_time_ns for raw in found.messages()]
    assert 0.9 <= (wrong[0] - logged[0]) * 1e-9 <= 1.5
    assert len(list(found.messages(['/rules']))) == 1
    assert (logged[-1] - wrong[-1]) * 1e-9 >= 0.5

    code, out, _ = run_occ(f'check {bag.path} -c {rules} --json')
    report = json.loads(out)
    assert code == 1
    (violation,) = report['violations']
    assert violation['rule'] == 'R1'
    stamps = [found.decode(raw).header.stamp for raw in found.messages(['/observation'])]
    assert {stamp.sec * 10**9 + stamp.nanosec for stamp in stamps} >= set(wrong)
    code, out, _ = run_occ(f'info {bag.path}')
    assert code == 0
    assert '/observation' in out

    document = event_document(bag.path)
    assert document['complete']
    assert [one['id'] for one in document['events']] == [event['id']]
    assert document['missing_before'] == 0.0

    answer = trigger('event_recorder/trigger')
    assert answer.success
    path = Path(answer.message)
    assert path.parent == bags
    drive.until(path.exists)
    assert event_document(path)['events'][0]['kind'] == 'trigger'
    code, out, _ = run_occ(f'check {path} -c {rules}')
    assert code == 0


def test_a_recorder_that_is_ended_keeps_what_there_is(recording, trigger, nodes):
    drive, _, bags = recording
    drive.send(SAFE, 25)
    answer = trigger('event_recorder/trigger')
    nodes.stop(drive.recorder)
    path = Path(answer.message)
    assert [bag.path for bag in event_bags(bags)] == [path]
    assert event_document(path)['reason'] == 'the recorder was ended'
    assert not event_document(path)['complete']
    assert 'ends early' in drive.recorder.log.read_text()
    assert Recording(path).topics['/observation'].count >= 20


@pytest.mark.parametrize(
    ('parameters', 'expected'),
    [
        ({'exclude_kinds': ['violations']}, "got 'violations'; allowed are violation, unknown"),
        ({'longest': 1.0}, "'longest' of node 'event_recorder': got 1; allowed is 5"),
        ({'regex': '('}, 'allowed is a regular expression'),
        ({'compression': 'zip'}, 'allowed are zstd, lz4, none'),
        ({'directory': '/proc/nowhere'}, 'cannot write to /proc/nowhere'),
    ],
)
def test_mistakes_are_told_in_one_sentence(make_nodes, parameters, expected):
    nodes = make_nodes()
    recorder = nodes.start('event_recorder', store=nodes.folder / 'events', **parameters)
    assert recorder.join() == 2
    text = recorder.log.read_text()
    assert expected in text
    assert 'Traceback' not in text
