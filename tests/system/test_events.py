# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What happens to a robot is kept by an event_recorder, whatever ends, and told by occ events."""

import json
import signal
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from click.testing import CliRunner
from occ_constraints_pkg.cli.commands import cli
from occ_constraints_pkg.events.event import KINDS, Event
from occ_constraints_pkg.events.store import EventReader
from occ_constraints_pkg.features.table import Table

COLUMNS = ('x', 'y')
SAFE, UNSAFE, BROKEN = (0.8, 0.2), (0.2, 0.8), (np.nan, 0.2)
NAMESPACE = '/robot1'


class Drive:
    """Sends a robot's observations, and hears of events."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import Twist
        from occ_constraints_pkg.ros.qos import STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self.observer, self.told, self.statuses, self.speeds = observer, [], {}, []
        self.goes_on = {kind: set() for kind in KINDS}
        node, self.stamp = observer.node, 10**18
        self.observation = node.create_publisher(PointCloud2, f'{NAMESPACE}/observation', STEPS)
        self.command = node.create_publisher(Twist, f'{NAMESPACE}/cmd_vel_in', 1)
        node.create_subscription(String, f'{NAMESPACE}/events', self.on_event, STEPS)
        node.create_subscription(
            Twist, f'{NAMESPACE}/cmd_vel', lambda twist: self.speeds.append(twist.linear.x), 10
        )
        node.create_subscription(DiagnosticArray, '/diagnostics', self.on_diagnostics, 100)

    def on_event(self, message):
        event, phase = Event.from_json(message.data)
        self.told.append((event, phase))
        (set.discard if phase == 'ended' else set.add)(self.goes_on[event.kind], event.id)

    def on_diagnostics(self, message):
        self.statuses.update({item.name: item for item in message.status})

    def go(self, row):
        from geometry_msgs.msg import Twist
        from occ_constraints_pkg.ros.tables import table_message

        self.stamp += 10**8
        table = Table(COLUMNS, np.array([row], dtype=np.float32))
        self.observation.publish(table_message(table, self.stamp))
        twist = Twist()
        twist.linear.x = 1.0
        self.command.publish(twist)
        self.observer.spin(0.1)

    def stop_by_a_violation(self):
        """Drive until the gate has stopped for a violation; return both events."""
        while True:
            # On a busy machine it stops for other reasons too.
            self.until(lambda: self.goes_on['stop'] == set() and self.speeds[-1:] == [1.0])
            self.told.clear()
            self.until(lambda: self.has('violation', 'began'), UNSAFE)
            for _ in range(20):
                self.go(UNSAFE)
                if self.has('stop', 'began'):
                    return self.has('violation', 'began')[0], self.has('stop', 'began')[0]

    def until(self, condition, row=SAFE):
        def driven():
            self.go(row)
            return condition()

        self.observer.spin_until(driven)

    def has(self, kind, phase):
        return [event for event, told in self.told if (event.kind, told) == (kind, phase)]


@pytest.fixture
def drive(nodes, observer, rules_of):
    nodes.rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(nodes.rules)
    return Drive(observer)


def start_recorder(nodes, **parameters):
    return nodes.start(
        'event_recorder', namespace=NAMESPACE, store=nodes.folder / 'store', **parameters
    )


def occ(*arguments):
    result = CliRunner().invoke(cli, ['events', *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_stop_is_explained_and_kept_whatever_is_killed(nodes, observer, drive):
    recorder = start_recorder(nodes)
    nodes.start('gate', namespace=NAMESPACE, slow_margin=0.0, timeout=2.0)
    monitor = nodes.start('monitor', namespace=NAMESPACE, constraints_file=nodes.rules)
    # The gate stops at the second violation, and is released by five safe verdicts.
    violation, stop = drive.stop_by_a_violation()
    assert (violation.rule, violation.robot, violation.values) == (
        'R1',
        NAMESPACE,
        {'x': pytest.approx(0.2), 'y': pytest.approx(0.8)},
    )
    assert violation.bounds == (
        {'feature': 'x', 'operator': '<=', 'bound': 0.7},
        {'feature': 'y', 'operator': '>=', 'bound': 0.3},
    )
    drive.until(lambda: drive.has('stop', 'ended') and drive.has('violation', 'ended'))
    over, released = drive.has('violation', 'ended')[0], drive.has('stop', 'ended')[0]
    assert (over.id, released.id) == (violation.id, stop.id)
    assert released.cause == violation.id
    assert (released.rule, released.margin, released.values) == ('R1', over.margin, over.values)
    assert f': {over.text} (rule R1, margin {over.margin:.3g}), released after ' in released.text
    assert released.text.endswith(' safe verdicts')
    diagnosed = [status for name, status in drive.statuses.items() if name.startswith('robot1/')]
    assert {status.hardware_id for status in diagnosed} == {'robot1'}
    assert {b'\x03'}.isdisjoint(status.level for status in diagnosed)

    # UNKNOWN, told with its reason, goes on when the recorder is killed, and is then interrupted.
    why = 'x is missing, stale or not a number'

    def broken():
        return [item for item in drive.has('unknown', 'began') if item.reason == why]

    drive.until(broken, BROKEN)
    unknown = broken()[0]
    recorder.send_signal(signal.SIGKILL)
    recorder.join()
    drive.told.clear()
    start_recorder(nodes)
    drive.until(lambda: any(item.id == unknown.id for item in drive.has('unknown', 'ended')))
    interrupted = next(item for item in drive.has('unknown', 'ended') if item.id == unknown.id)
    assert 'interrupted' in interrupted.reason

    # Without a monitor there is no verdict, which is an event too, once it was heard.
    drive.told.clear()
    drive.until(lambda: drive.has('violation', 'began'), UNSAFE)
    monitor.send_signal(signal.SIGKILL)
    monitor.join()

    def silent():
        unknown = [event for event, _ in drive.told if event.kind == 'unknown']
        return {event.id for event in unknown if 'no verdict for' in event.reason}

    observer.spin_until(silent)
    observer.spin(1.0)
    assert len(silent()) == 1

    store = nodes.folder / 'store'
    listed = json.loads(occ('list', '--store', store, '--json'))[0]['events']
    assert [item['number'] for item in listed] == list(range(1, len(listed) + 1))
    assert len({item['id'] for item in listed}) == len(listed)
    number = next(item['number'] for item in listed if item['id'] == stop.id)
    assert released.text in occ('show', number, '--store', store)
    assert [
        item['id']
        for item in json.loads(
            occ('export', '--store', store, '--kind', 'violation', '--rule', 'R1')
        )['events']
    ][0] == violation.id


def test_near_misses_are_told_with_the_rule_that_was_near(nodes, drive):
    start_recorder(nodes, near_margin=0.1)
    nodes.start('monitor', namespace=NAMESPACE, constraints_file=nodes.rules)
    drive.until(lambda: 'robot1/monitor: judging' in drive.statuses)
    drive.until(lambda: drive.statuses['robot1/monitor: judging'].message == 'SAFE')
    for _ in range(3):
        drive.go((0.72, 0.5))
    drive.until(lambda: drive.has('near_miss', 'ended'))
    near = drive.has('near_miss', 'ended')[0]
    assert [event.id for event, _ in drive.told if event.kind == 'near_miss'] == [near.id] * 2
    assert near.rule == 'R1'
    assert 0.0 < near.margin < 0.1
    assert near.text.startswith('margin 0.04: close to x at most 0.7 ')
    assert near.values['x'] == pytest.approx(0.72)


def test_a_store_of_a_newer_schema_is_refused_with_a_sentence(nodes):
    first = start_recorder(nodes)
    path = nodes.folder / 'store' / 'events.db'
    nodes_log = first.log
    while 'keeping events' not in nodes_log.read_text():
        pass
    nodes.stop(first)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute('PRAGMA user_version = 2')
    second = start_recorder(nodes)
    assert second.join() == 2
    assert 'an event store of schema 2; allowed is 1 at most' in second.log.read_text()
    nodes.started.remove(first)
    nodes.started.remove(second)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute('PRAGMA user_version = 1')
    reader = EventReader(path)
    assert reader.events() == []
    reader.close()
