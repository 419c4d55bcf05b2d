# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Faults of clocks and of transport: each ends in UNKNOWN, and the monitor says which it is.

docs/nodes.md lists all faults with their tests, many of which are in other files.
"""

import signal
import time

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints

SECOND = 10**9
LATE = ' s late; allowed is 1 s, by max_lag'
MAP = {
    'schema_version': 1,
    'pace': 'odom',
    'max_age': 0.5,
    'features': [{'name': 'v', 'topic': 'odom', 'field': 'twist.twist.linear.x'}],
}


def rules():
    space = FeatureMap.from_document(MAP, '').space
    rule_set = RuleSet(space, (Rule('fast', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]]))
    return Constraints(rule_set, MAP)


class Robot:
    """Publishes odometry, and hears what is said of it."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry
        from occ_constraints_pkg.ros.qos import STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Float64

        self.observer, self.verdicts, self.cost = observer, [], []
        node = observer.node
        # Only so that the monitor counts as many subscribers of each.
        node.create_subscription(PointCloud2, 'costs', lambda message: None, STEPS)
        node.create_subscription(DiagnosticArray, 'violation', self.verdicts.append, STEPS)
        node.create_subscription(Float64, 'cost', self.cost.append, STEPS)
        self.odom = node.create_publisher(Odometry, 'odom', STEPS)
        self.new = Odometry

    def send(self, stamp_ns, speed=0.5):
        """Publish, and return what is said of it; UNKNOWN goes with cost 1, nothing else does."""
        from occ_constraints_pkg.ros.messages import to_time

        message = self.new()
        message.header.stamp = to_time(stamp_ns)
        message.twist.twist.linear.x = speed
        verdicts, costs = len(self.verdicts), len(self.cost)
        self.odom.publish(message)
        self.observer.spin_until(lambda: len(self.verdicts) > verdicts and len(self.cost) > costs)
        said = self.verdicts[-1].status[0].message
        assert self.cost[-1].data == (0.0 if said == 'SAFE' else 1.0)
        return said

    def until_heard(self):
        self.observer.wait_for_monitor(2)
        self.observer.spin_until(lambda: self.odom.get_subscription_count() == 1)


def test_stamps_from_the_future_or_the_past_are_unknown_until_time_goes_on(nodes, observer):
    robot = Robot(observer)
    rules().save(nodes.folder / 'rules.yaml')
    # The default timeout is shorter than a loaded machine may need for a step.
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=60.0)
    robot.until_heard()
    now = time.time_ns()
    assert robot.send(now) == 'SAFE'
    said = robot.send(time.time_ns() + 5 * SECOND)
    assert said.startswith("UNKNOWN: the stamp of a message on 'odom' is ")
    assert said.endswith('ahead of the clock; allowed is 1 s, by the parameter max_lead')
    # What was refused is forgotten.
    assert robot.send(now + SECOND // 10) == 'SAFE'
    # A clock is set back by more than values may age, and goes on from there.
    assert robot.send(now - 3 * SECOND) == 'UNKNOWN: time went back by 3.1 s'
    assert robot.send(now - 3 * SECOND + 1, speed=0.6) == 'SAFE'
    # Messages that overtake one another are no such clock.
    assert robot.send(now - 3 * SECOND - SECOND // 10) == 'SAFE'


def test_a_clock_that_is_missing_paused_or_set_back_is_unknown(nodes, observer):
    from occ_constraints_pkg.ros.messages import to_time
    from occ_constraints_pkg.ros.qos import STEPS
    from rosgraph_msgs.msg import Clock

    robot = Robot(observer)
    rules().save(nodes.folder / 'rules.yaml')
    file = nodes.folder / 'rules.yaml'
    nodes.start('monitor', constraints_file=file, timeout=0.5, use_sim_time=True)
    clock = observer.node.create_publisher(Clock, '/clock', STEPS)
    robot.until_heard()
    assert robot.send(SECOND) == 'UNKNOWN: use_sim_time is set, and nothing has come on /clock'
    observer.spin_until(lambda: clock.get_subscription_count() == 1)

    def ticks_until(wanted, first_ns):
        """Let time go on in both until the monitor says it; return what time it is then."""
        steps = iter(range(first_ns, first_ns + 100 * SECOND, SECOND // 50))

        def said():
            now = next(steps)
            clock.publish(Clock(clock=to_time(now)))
            return robot.send(now) == wanted

        observer.spin_until(said)
        return next(steps)

    now = ticks_until('SAFE', 20 * SECOND)
    # Inputs go on, the clock does not. That their stamps differ makes them new ones.
    stamps = iter(range(now, now + SECOND))
    observer.spin_until(
        lambda: robot.send(next(stamps)) == 'UNKNOWN: /clock has stood still for 0.5 s'
    )
    ticks_until('SAFE', now + SECOND // 4)
    clock.publish(Clock(clock=to_time(10 * SECOND)))
    assert robot.send(10 * SECOND).startswith('UNKNOWN: time went back by 1')
    ticks_until('SAFE', 10 * SECOND)


def test_a_table_that_is_published_best_effort_is_unknown_and_named(nodes, observer, rules_of):
    from diagnostic_msgs.msg import DiagnosticArray
    from occ_constraints_pkg.ros.qos import SENSORS, STEPS
    from occ_constraints_pkg.ros.tables import table_message
    from sensor_msgs.msg import PointCloud2

    rules_of['simple_nav'].save(nodes.folder / 'rules.yaml')
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=0.3)
    publisher = observer.node.create_publisher(PointCloud2, 'observation', SENSORS)
    heard = []
    observer.node.create_subscription(DiagnosticArray, 'violation', heard.append, STEPS)
    table = Table(('x', 'y'), np.array([[0.8, 0.2]], dtype=np.float32))

    def told():
        publisher.publish(table_message(table, time.time_ns()))
        return heard and heard[-1].status[0].message.startswith(
            'UNKNOWN: observation is published best-effort; set the parameter '
            'qos_overrides./observation.subscription.reliability'
        )

    observer.spin_until(told)
    assert all(message.status[0].message.startswith('UNKNOWN') for message in heard)


@pytest.fixture
def robot(nodes, observer):
    rules().save(nodes.folder / 'rules.yaml')
    nodes.start('monitor', constraints_file=nodes.folder / 'rules.yaml', timeout=60.0)
    robot = Robot(observer)
    robot.until_heard()
    return robot


def drive(robot, seconds, stamp):
    """Send at 20 Hz; return what is said, whose stamps ``stamp`` tells from the time."""
    end, said = time.monotonic() + seconds, []
    while time.monotonic() < end:
        said.append(robot.send(round(stamp(time.time_ns()))))
        robot.observer.spin(0.05)
    return said


@pytest.mark.parametrize('offset', [0, 3600, -0.3])
def test_a_bridge_that_falls_behind_is_late_until_it_has_caught_up(robot, offset):
    """The clock of the robot may be another one than that of the bridge and the monitor."""
    base = offset * SECOND
    assert set(drive(robot, 4.5, lambda now: now - base)) == {'SAFE'}
    # Nothing for 3 s, then all of it 3 s later.
    robot.observer.spin(3.0)
    late = drive(robot, 1.5, lambda now: now - base - 3 * SECOND)
    assert all(words.startswith("UNKNOWN: a message on 'odom' is ") for words in late)
    assert all(words.endswith(LATE) for words in late)
    assert set(drive(robot, 0.5, lambda now: now - base)) == {'SAFE'}
    # It passes on half of what comes.
    start = time.time_ns()
    said = drive(robot, 4.0, lambda now: now - base - (now - start) / 2)
    is_late = [words.endswith(LATE) for words in said]
    assert is_late == sorted(is_late)
    assert not is_late[0]
    assert is_late[-1]


def test_what_is_old_from_the_first_message_on_is_late(robot):
    said = drive(robot, 1.0, lambda now: now - 10 * SECOND)
    assert {words.partition(' is ')[2] for words in said} == {'10' + LATE}
    assert robot.send(time.time_ns()) == 'SAFE'


@pytest.mark.parametrize(
    'stamp',
    [
        lambda now, start: now - 40 * SECOND,
        lambda now, start: SECOND + (now - start) / 3,
        lambda now, start: SECOND + 3 * (now - start),
        lambda now, start: 1_700_000_000 * SECOND + (now - start) / 2,
        lambda now, start: start - 600 * SECOND + (now - start) / 2,
    ],
    ids=['host', 'slow simulation', 'fast simulation', 'slow old bag', 'slow bag of today'],
)
def test_other_clocks_simulations_and_recordings_are_not_late(robot, stamp):
    start = time.time_ns()
    assert set(drive(robot, 4.0, lambda now: stamp(now, start))) == {'SAFE'}


def test_a_monitor_that_was_stopped_does_not_pass_what_waited_for_it(nodes, robot):
    from occ_constraints_pkg.ros.messages import to_time

    # The shortest of several ways is what others are compared with.
    assert set(drive(robot, 0.5, lambda now: now)) == {'SAFE'}
    (monitor,) = nodes.started
    # Some or all may be lost, for that is a best-effort subscription, and more so when the monitor
    # stands still for a second, after which the middleware gives it up for a while.
    for _ in range(20):
        monitor.send_signal(signal.SIGSTOP)
        heard = len(robot.verdicts)
        for step in range(5):
            message = robot.new()
            # Not too old yet.
            message.header.stamp = to_time(time.time_ns() - 45 * SECOND // 100 + step)
            robot.odom.publish(message)
        robot.observer.spin(0.8)
        monitor.send_signal(signal.SIGCONT)
        robot.observer.spin(2.0, lambda least=heard: len(robot.verdicts) > least)
        if len(robot.verdicts) > heard:
            break
    robot.observer.spin(0.5)
    assert len(robot.verdicts) > heard
    assert all(message.status[0].message.endswith(LATE) for message in robot.verdicts[heard:])
    assert robot.send(time.time_ns()) == 'SAFE'


def test_a_simulation_behind_the_wall_clock_is_judged_by_its_own_clock(nodes, observer):
    from occ_constraints_pkg.ros.messages import to_time
    from occ_constraints_pkg.ros.qos import STEPS
    from rosgraph_msgs.msg import Clock

    robot = Robot(observer)
    rules().save(nodes.folder / 'rules.yaml')
    file = nodes.folder / 'rules.yaml'
    nodes.start('monitor', constraints_file=file, timeout=60.0, use_sim_time=True)
    clock = observer.node.create_publisher(Clock, '/clock', STEPS)
    robot.until_heard()
    observer.spin_until(lambda: clock.get_subscription_count() == 1)
    start = time.time_ns()

    def tick(now):
        # A fifth as fast as time, after a beginning at the time of the wall.
        simulated = round(start + (now - start) / 5)
        clock.publish(Clock(clock=to_time(simulated)))
        return simulated

    observer.spin_until(lambda: robot.send(tick(time.time_ns())) == 'SAFE')
    assert set(drive(robot, 4.0, tick)) == {'SAFE'}
