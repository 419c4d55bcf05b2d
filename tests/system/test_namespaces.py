# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots with a monitor each, and a gate, do not hear each other."""

import signal

import numpy as np
from occ_constraints_pkg.features.table import Table


def test_monitors_in_two_namespaces_do_not_mix(nodes, observer, rules_of):
    from diagnostic_msgs.msg import DiagnosticArray
    from occ_constraints_pkg.ros.qos import STEPS
    from occ_constraints_pkg.ros.tables import table_message
    from sensor_msgs.msg import PointCloud2

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    robots = ('robot1', 'robot2')
    publishers, costs, violations, judging = {}, {}, {}, set()

    def on_diagnostics(message):
        judging.update(item.name for item in message.status if 'judging' in item.name)

    observer.node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 10)
    for robot in robots:
        nodes.start('monitor', namespace=f'/{robot}', constraints_file=rules, timeout=60.0)
        costs[robot], violations[robot] = [], []
        topic = f'/{robot}/observation'
        publishers[robot] = observer.node.create_publisher(PointCloud2, topic, STEPS)
        for kind, name, heard in (
            (PointCloud2, 'costs', costs[robot]),
            (DiagnosticArray, 'violation', violations[robot]),
        ):
            observer.node.create_subscription(kind, f'/{robot}/{name}', heard.append, STEPS)

    def matched():
        return (
            all(
                publishers[robot].get_subscription_count() == 1
                and observer.node.count_publishers(f'/{robot}/costs') == 1
                for robot in robots
            )
            and len(judging) == 2
        )

    observer.spin_until(matched)
    assert judging == {'robot1/monitor: judging', 'robot2/monitor: judging'}
    for robot, rows, count in (('robot1', [(0.8, 0.2)], 3), ('robot2', [(0.2, 0.8)] * 2, 5)):
        for number in range(count):
            table = Table(('x', 'y'), np.array(rows, dtype=np.float32))
            publishers[robot].publish(table_message(table, 10**18 + number))
    observer.spin_until(lambda: len(violations['robot1']) == 3 and len(violations['robot2']) == 5)
    for robot, rows, cost in (('robot1', 1, 0.0), ('robot2', 2, 1.0)):
        for message in costs[robot]:
            assert Table.from_message(message).column('cost').tolist() == [cost] * rows
    assert (len(costs['robot1']), len(costs['robot2'])) == (3, 5)


class Robot:
    """Drives one simulated robot by its observations, and commands it through its gate."""

    def __init__(self, observer, name):
        from geometry_msgs.msg import Twist
        from occ_constraints_pkg.ros.qos import COMMANDS, STEPS
        from sensor_msgs.msg import PointCloud2

        self.up, self.heard, self.kind = 0.0, [], Twist
        self.action = observer.node.create_publisher(PointCloud2, f'/{name}/action', STEPS)
        self.command = observer.node.create_publisher(Twist, f'/{name}/cmd_vel_in', COMMANDS)
        observer.node.create_subscription(
            PointCloud2, f'/{name}/observation', self._on_observation, STEPS
        )
        observer.node.create_subscription(Twist, f'/{name}/cmd_vel', self._on_output, 10)

    def _on_observation(self, message):
        from occ_constraints_pkg.ros.messages import to_nanoseconds
        from occ_constraints_pkg.ros.tables import table_message

        table = Table(('d_x', 'd_y'), np.array([[0.0, self.up]], dtype=np.float32))
        stamp = to_nanoseconds(message.header.stamp)
        self.action.publish(table_message(table, stamp, 'simple_nav'))

    def _on_output(self, message):
        self.heard.append(message.linear.x)

    def ask(self):
        command = self.kind()
        command.linear.x = 1.0
        self.command.publish(command)


def test_of_three_robots_each_is_stopped_by_its_own_monitor_only(nodes, observer, rules_of):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    names = ('robot1', 'robot2', 'robot3')
    monitors = {}
    for name in names:
        nodes.start('gate', namespace=f'/{name}', slow_margin=0.0, timeout=2.0)
        monitors[name] = nodes.start(
            'monitor', namespace=f'/{name}', constraints_file=rules, timeout=2.0
        )
        nodes.start('sim', namespace=f'/{name}', world='simple_nav', rate=20.0)
    robots = {name: Robot(observer, name) for name in names}

    def passing(*wanted):
        """Tell whether just these robots are let through, and the others held."""

        def holds():
            for robot in robots.values():
                robot.ask()
            observer.spin(0.05)
            return all(
                len(robot.heard) >= 5 and set(robot.heard[-5:]) == {1.0 if name in wanted else 0.0}
                for name, robot in robots.items()
            )

        observer.spin_until(holds)

    passing(*names)
    # Only the second one drives into what is forbidden, and comes back.
    robots['robot2'].up = 1.0
    passing('robot1', 'robot3')
    robots['robot2'].up = -1.0
    passing(*names)
    monitors['robot3'].send_signal(signal.SIGKILL)
    passing('robot1', 'robot2')
