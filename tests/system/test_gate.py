# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gate stops a robot whenever the monitor does not say that it is safe."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.features.table import Table

COLUMNS = ('x', 'y', 'reward', 'terminated', 'truncated', 'episode', 'true_cost')
SAFE, UNSAFE, BROKEN = (0.8, 0.2), (0.2, 0.8), (np.nan, 0.2)


class Robot:
    """Sends observations and commands, and hears what the gate makes of the commands."""

    def __init__(self, observer, kind):
        from occ_constraints_pkg.ros.qos import COMMANDS, STEPS
        from sensor_msgs.msg import PointCloud2

        self.observer, self.kind, self.heard = observer, kind, []
        self.observation = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
        self.command = observer.node.create_publisher(kind, 'cmd_vel_in', COMMANDS)
        observer.node.create_subscription(kind, 'cmd_vel', self._on_output, 10)
        self.stamp, self.state = 10**18, SAFE

    def _on_output(self, message):
        twist = getattr(message, 'twist', message)
        self.heard.append((twist.linear.x, twist.angular.z))

    def drive(self, speed=1.0, turn=0.5):
        """Send one observation and one command."""
        from occ_constraints_pkg.ros.tables import table_message

        values = np.zeros((1, len(COLUMNS)), dtype=np.float32)
        values[0, :2] = self.state
        self.stamp += 10**8
        self.observation.publish(table_message(Table(COLUMNS, values), self.stamp, 'simple_nav'))
        message = self.kind()
        twist = getattr(message, 'twist', message)
        twist.linear.x, twist.angular.z = speed, turn
        self.command.publish(message)

    def until(self, wanted, **command):
        """Drive until the gate's output is ``wanted``."""

        def there():
            self.heard.clear()
            self.drive(**command)
            self.observer.spin(0.1)
            return self.heard and self.heard[-1] == wanted

        self.observer.spin_until(there)

    def stays_stopped(self, seconds):
        """Drive for a while, in which nothing but zero may come."""
        self.heard.clear()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.drive()
            self.observer.spin(0.05)
        return set(self.heard) == {(0.0, 0.0)}


def kind_of(stamped):
    from geometry_msgs.msg import Twist, TwistStamped

    return TwistStamped if stamped else Twist


@pytest.mark.parametrize('stamped', [False, True])
def test_commands_pass_only_while_the_monitor_says_safe(nodes, observer, rules_of, stamped):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    gate = nodes.start('gate', stamped=stamped, slow_margin=0.0, timeout=1.0)
    robot = Robot(observer, kind_of(stamped))
    observer.spin_until(lambda: robot.command.get_subscription_count() == 1)
    # Without a monitor nothing passes.
    assert robot.stays_stopped(1.0)
    monitor = nodes.start('monitor', constraints_file=rules, timeout=0.5)
    robot.until((1.0, 0.5))
    robot.state = UNSAFE
    robot.until((0.0, 0.0))
    assert robot.stays_stopped(0.5)
    robot.state = SAFE
    robot.until((1.0, 0.5))
    robot.state = BROKEN
    robot.until((0.0, 0.0))
    robot.state = SAFE
    robot.until((1.0, 0.5))
    # A command that is no number is a stop as well.
    robot.until((0.0, 0.0), speed=float('nan'))
    robot.until((1.0, 0.5))

    monitor.send_signal(signal.SIGKILL)
    monitor.join()
    robot.until((0.0, 0.0))
    assert robot.stays_stopped(0.5)
    text = gate.log.read_text()
    for said in ('no verdict yet', 'VIOLATED: ', 'UNKNOWN: x is missing', 'no verdict for 1 s'):
        assert f'STOP: {said}' in text


def test_speed_falls_near_the_boundary_and_zero_comes_without_commands(nodes, observer, rules_of):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    nodes.start('monitor', constraints_file=rules)
    nodes.start('gate', slow_margin=2.0, min_speed_scale=0.5, timeout=5.0, command_timeout=0.3)
    robot = Robot(observer, kind_of(False))
    # The rule on y begins at 0.95; its demonstrated range is 0.5 wide.
    robot.state = (0.8, 0.45)

    def slowed():
        robot.heard.clear()
        robot.drive()
        observer.spin(0.1)
        return robot.heard and 0.0 < robot.heard[-1][0] < 1.0

    observer.spin_until(slowed)
    linear, angular = robot.heard[-1]
    # Margin (0.8 - 0.7) / 0.5 = 0.2 to the corner, a tenth of slow_margin.
    assert linear == pytest.approx(0.55, abs=1e-6)
    assert angular == pytest.approx(0.5 * linear)
    robot.heard.clear()
    observer.spin_until(lambda: len(robot.heard) >= 5)
    observer.spin(0.5)
    assert set(robot.heard[-5:]) == {(0.0, 0.0)}


class Verdicts:
    """Stands in for a monitor, sends commands at 50 Hz, and hears what the gate does with them."""

    def __init__(self, observer, topic='violation'):
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.qos import COMMANDS, VERDICTS

        self.node, self.observer, self.heard, self.states = observer.node, observer, [], []
        self.publisher = self.node.create_publisher(DiagnosticArray, topic, VERDICTS)
        self.command = self.node.create_publisher(kind_of(False), 'cmd_vel_in', COMMANDS)
        self.node.create_subscription(
            kind_of(False), 'cmd_vel', lambda message: self.heard.append(message.linear.x), 100
        )

    def listen_to_state(self):
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.qos import LATCHED

        self.node.create_subscription(DiagnosticArray, 'gate/state', self.states.append, LATCHED)

    def message(self, letter='S', stamp_ns=None, judged_ns=None):
        """Return a verdict: S, V or U; stamped now unless told otherwise."""
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.diagnostics import status
        from occ_constraints_pkg.ros.messages import to_time

        level, text = {
            'S': (b'\x00', 'SAFE'),
            'V': (b'\x02', 'VIOLATED: too fast'),
            'U': (b'\x03', 'UNKNOWN: no input'),
        }[letter]
        values = {'margin': 1.0} | ({} if judged_ns is None else {'judged_at': judged_ns})
        message = DiagnosticArray(status=[status('monitor: verdict', level, text, values)])
        if letter == 'V':
            message.status.append(status('monitor: rule R7', level, 'too fast'))
        message.header.stamp = to_time(time.time_ns() if stamp_ns is None else stamp_ns)
        return message

    def send(self, message):
        self.publisher.publish(message)

    def step(self, *messages):
        """Send these verdicts and one command of speed 1, and listen for a moment."""
        for message in messages:
            self.publisher.publish(message)
        command = kind_of(False)()
        command.linear.x = 1.0
        self.command.publish(command)
        self.observer.spin(0.02)

    def is_open_within(self, seconds, *others):
        """Say SAFE until the robot drives at full speed."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.heard.clear()
            for other in others:
                other.send(other.message())
            self.step(self.message())
            if 1.0 in self.heard:
                return True
        return False

    def never_drives(self, seconds, make):
        """Send what ``make(step)`` returns for a while; False if anything but zero came."""
        self.heard.clear()
        end, step = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            self.step(*make(step))
            step += 1
        return bool(self.heard) and not any(self.heard)

    def stop(self):
        """Fall silent until the gate has stopped."""
        self.observer.spin_until(
            lambda: self.step() or (len(self.heard) > 3 and not any(self.heard[-3:]))
        )
        self.observer.spin(0.6)


HOUR = 3600 * 10**9
# What an operator might replay, or a broken clock or network make of verdicts; each is sent with a
# fresh source time.
NO_PROOF = {
    'ten seconds old': lambda v, step: [v.message(stamp_ns=time.time_ns() - 10**10)],
    'an hour old': lambda v, step: [v.message(stamp_ns=time.time_ns() - HOUR)],
    'an hour ahead': lambda v, step: [v.message(stamp_ns=time.time_ns() + HOUR)],
    'stamp 0': lambda v, step: [v.message(stamp_ns=0)],
    'from 1970 on': lambda v, step: [v.message(stamp_ns=(step + 1) * 10**8)],
    'played back': lambda v, step: [
        v.message(stamp_ns=time.time_ns() - HOUR, judged_ns=time.time_ns() - HOUR)
    ],
    'played back with new stamps': lambda v, step: [v.message(judged_ns=time.time_ns() - HOUR)],
    'a time of judging that is none': lambda v, step: [v.message(judged_ns='now')],
    'swapped in pairs': lambda v, step: [
        v.message(stamp_ns=time.time_ns() - offset) for offset in (0, 10**7)
    ],
    'two violations, then older safe ones': lambda v, step: [
        v.message('V') if step < 2 else v.message(stamp_ns=time.time_ns() - 2 * 10**9)
    ],
}


def test_verdicts_that_prove_nothing_about_now_never_open_it(nodes, observer):
    gate = nodes.start('gate')
    verdicts = Verdicts(observer)
    assert verdicts.is_open_within(20.0)
    for name, make in NO_PROOF.items():
        verdicts.stop()
        assert verdicts.never_drives(1.5, lambda step, make=make: make(verdicts, step)), name
        # Verdicts of now open it again.
        assert verdicts.is_open_within(20.0), name
    verdicts.stop()
    one = verdicts.message()
    assert verdicts.never_drives(1.5, lambda step: [one])
    one = verdicts.message(judged_ns=time.time_ns())
    assert verdicts.never_drives(4.0, lambda step: [one])
    assert 'made more than 0.5 s ago' in gate.log.read_text()


# Commands as fast as one can send them, about 4 kHz.
FLOOD = """
import rclpy
from geometry_msgs.msg import Twist
from occ_constraints_pkg.ros.qos import COMMANDS

rclpy.init()
publisher = rclpy.create_node('flood').create_publisher(Twist, 'cmd_vel_in', COMMANDS)
message = Twist()
message.linear.x = 1.0
while True:
    publisher.publish(message)
"""


def test_a_flood_of_commands_keeps_no_verdict_away(nodes, observer):
    nodes.start('gate')
    verdicts = Verdicts(observer)
    assert verdicts.is_open_within(20.0)
    flood = subprocess.Popen([sys.executable, '-c', FLOOD], env=environment(nodes.domain))
    try:
        observer.spin_until(lambda: verdicts.step(verdicts.message()) or len(verdicts.heard) > 2000)
        for letter, speed in (('V', 0.0), ('S', 1.0), ('U', 0.0)):
            verdicts.heard.clear()
            observer.spin_until(
                lambda letter=letter, speed=speed: (
                    verdicts.step(verdicts.message(letter)) or verdicts.heard[-1:] == [speed]
                ),
            )
    finally:
        flood.kill()
        flood.wait()


def test_a_paused_gate_does_not_drive_on_what_it_heard_before(nodes, observer):
    gate = nodes.start('gate')
    verdicts = Verdicts(observer)
    for _ in range(6):
        assert verdicts.is_open_within(20.0)
        gate.send_signal(signal.SIGSTOP)
        for _ in range(30):
            # Queued verdicts and commands.
            verdicts.step(verdicts.message())
        observer.spin(1.0)
        verdicts.heard.clear()
        gate.send_signal(signal.SIGCONT)
        assert verdicts.never_drives(0.7, lambda step: [])
    assert 'the gate itself was paused' in gate.log.read_text()


def test_two_publishers_stop_it_whatever_they_say(nodes, observer):
    gate = nodes.start('gate')
    careful, careless = Verdicts(observer), Verdicts(observer)
    observer.spin_until(lambda: careless.command.get_subscription_count() == 1)

    def both(step):
        if step % 5 == 0:
            careful.send(careful.message('V'))
        return [careless.message()]

    assert careless.never_drives(2.0, both)
    observer.node.destroy_publisher(careful.publisher)
    assert careless.is_open_within(20.0)
    # And when a second one comes while it is open.
    third = Verdicts(observer)
    observer.spin(0.3)
    assert careless.never_drives(1.0, lambda step: [careless.message()])
    assert third.publisher
    assert '2 publishers on /violation' in gate.log.read_text()


@pytest.mark.parametrize('pattern', ['VSS', 'VSSSSSSSSS'])
def test_a_violation_that_comes_again_and_again_stops_it(nodes, observer, pattern):
    nodes.start('gate')
    verdicts = Verdicts(observer)
    assert verdicts.is_open_within(20.0)
    for letter in pattern * 3:
        verdicts.step(verdicts.message(letter))
    assert verdicts.never_drives(2.0, lambda step: [verdicts.message(pattern[step % len(pattern)])])


def test_of_several_monitors_the_worst_acts_and_each_must_be_alive(nodes, observer):
    gate = nodes.start('gate', violation_topics=['a/violation', 'b/violation'])
    one, other = Verdicts(observer, 'a/violation'), Verdicts(observer, 'b/violation')
    assert one.is_open_within(20.0, other)
    # One violated at a tenth of the other's rate.
    for step in range(20):
        other.send(other.message())
        one.step(*([] if step % 10 else [one.message('V')]))

    def one_violated(step):
        other.send(other.message())
        return [] if step % 10 else [one.message('V')]

    assert one.never_drives(1.0, one_violated)
    assert one.is_open_within(20.0, other)
    # One silent.
    one.stop()
    assert other.never_drives(1.0, lambda step: [other.message()])
    assert one.is_open_within(20.0, other)
    observer.node.destroy_publisher(other.publisher)
    observer.spin(0.3)
    assert one.never_drives(3.0, lambda step: [one.message()])
    assert 'nobody publishes /b/violation' in gate.log.read_text()


def test_state_says_what_it_does_why_and_since_when(nodes, observer):
    gate = nodes.start('gate', trigger_window=3)
    verdicts = Verdicts(observer)
    assert verdicts.is_open_within(20.0)
    opened = time.time_ns()
    verdicts.listen_to_state()

    def newest():
        summary, source = verdicts.states[-1].status
        return (
            {item.key: item.value for item in summary.values},
            {item.key: item.value for item in source.values},
        )

    # Latched: it comes though nothing changes.
    observer.spin_until(lambda: len(verdicts.states) > 0)
    summary, source = newest()
    assert (summary['state'], float(summary['scale'])) == ('PASS', 1.0)
    assert abs(int(summary['since']) - opened) < 10**9
    verdicts.step(verdicts.message('V'))
    observer.spin_until(lambda: newest()[0]['state'] == 'SLOW')
    assert newest()[0]['reason'] == 'VIOLATED (1 of 2): too fast'
    verdicts.step(verdicts.message('V'))
    observer.spin_until(lambda: newest()[0]['reason'] == 'VIOLATED: too fast')
    summary, source = newest()
    assert summary['state'] == 'STOP'
    assert (source['verdict'], source['rules'], source['publishers']) == ('VIOLATED', 'R7', '1')
    assert 0.0 <= float(source['age']) < 0.5
    # Flapping for some seconds writes a few lines only.
    for _ in range(20):
        for letter in 'SSSSSVV':
            verdicts.step(verdicts.message(letter))
    assert len(gate.log.read_text().splitlines()) < 12


def test_without_an_enabled_rule_nothing_is_safe(nodes, observer, rules_of):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    gate = nodes.start('gate', timeout=1.0)
    nodes.start('monitor', constraints_file=rules, disabled_rules=['R0', 'R1'])
    robot = Robot(observer, kind_of(False))
    log = 'STOP: UNKNOWN: no rule is enabled'
    observer.spin_until(lambda: robot.drive() or log in gate.log.read_text())
    assert robot.stays_stopped(1.0)


def test_a_recorded_monitor_that_is_played_back_opens_nothing(nodes, observer, rules_of):
    from diagnostic_msgs.msg import DiagnosticArray

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    nodes.start('gate', timeout=1.0)
    monitor = nodes.start('monitor', constraints_file=rules)
    robot, recorded = Robot(observer, kind_of(False)), []
    observer.node.create_subscription(DiagnosticArray, 'violation', recorded.append, 100)
    robot.until((1.0, 0.5))
    nodes.stop(monitor)
    observer.spin(1.5)
    safe = [message for message in recorded if message.status[0].message == 'SAFE']
    assert len(safe) >= 5
    player = Verdicts(observer)
    assert player.never_drives(2.0, lambda step: [safe[step % len(safe)]])
    assert player.is_open_within(20.0)
