# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gate stops a robot whenever the monitor does not say that it is safe."""

import signal
import time

import numpy as np
import pytest
from occ_constraints_pkg.bags.table import Table

COLUMNS = ('x', 'y', 'reward', 'terminated', 'truncated', 'episode', 'true_cost')
SAFE, UNSAFE, BROKEN = (0.8, 0.2), (0.2, 0.8), (np.nan, 0.2)


class Robot:
    """Sends observations and commands, and hears what the gate makes of the commands."""

    def __init__(self, witness, kind):
        from occ_constraints_pkg.ros.qos import COMMANDS, STEPS
        from sensor_msgs.msg import PointCloud2

        self.witness, self.kind, self.heard = witness, kind, []
        self.observation = witness.node.create_publisher(PointCloud2, 'observation', STEPS)
        self.command = witness.node.create_publisher(kind, 'cmd_vel_in', COMMANDS)
        witness.node.create_subscription(kind, 'cmd_vel', self._on_output, 10)
        self.stamp, self.state = 10**18, SAFE

    def _on_output(self, message):
        twist = getattr(message, 'twist', message)
        self.heard.append((twist.linear.x, twist.angular.z))

    def drive(self, speed=1.0, turn=0.5):
        """Send one observation and one command."""
        from occ_constraints_pkg.ros.messages import table_message

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
            self.witness.spin(0.1)
            return self.heard and self.heard[-1] == wanted

        self.witness.spin_until(there, 20.0)

    def stays_stopped(self, seconds):
        """Drive for a while, in which nothing but zero may come."""
        self.heard.clear()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.drive()
            self.witness.spin(0.05)
        return set(self.heard) == {(0.0, 0.0)}


def kind_of(stamped):
    from geometry_msgs.msg import Twist, TwistStamped

    return TwistStamped if stamped else Twist


@pytest.mark.parametrize('stamped', [False, True])
def test_commands_pass_only_while_the_monitor_says_safe(nodes, witness, rules_of, stamped):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    gate = nodes.start('gate', stamped=stamped, slow_margin=0.0, timeout=1.0)
    robot = Robot(witness, kind_of(stamped))
    witness.spin_until(lambda: robot.command.get_subscription_count() == 1, 20.0)
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


def test_speed_falls_near_the_boundary_and_zero_comes_without_commands(nodes, witness, rules_of):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    nodes.start('monitor', constraints_file=rules)
    nodes.start('gate', slow_margin=2.0, min_speed_scale=0.5, timeout=5.0, command_timeout=0.3)
    robot = Robot(witness, kind_of(False))
    # The rule on y begins at 0.95; its demonstrated range is 0.5 wide.
    robot.state = (0.8, 0.45)

    def slowed():
        robot.heard.clear()
        robot.drive()
        witness.spin(0.1)
        return robot.heard and 0.0 < robot.heard[-1][0] < 1.0

    witness.spin_until(slowed, 20.0)
    linear, angular = robot.heard[-1]
    # Margin (0.8 - 0.7) / 0.5 = 0.2 to the corner, a tenth of slow_margin.
    assert linear == pytest.approx(0.55, abs=1e-6)
    assert angular == pytest.approx(0.5 * linear)
    robot.heard.clear()
    witness.spin_until(lambda: len(robot.heard) >= 5, 10.0)
    witness.spin(0.5)
    assert set(robot.heard[-5:]) == {(0.0, 0.0)}
