# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Two robots with a monitor each do not hear each other."""

import numpy as np
from occ_constraints_pkg.bags.table import Table


def test_monitors_in_two_namespaces_do_not_mix(nodes, witness, rules_of):
    from diagnostic_msgs.msg import DiagnosticArray
    from occ_constraints_pkg.ros.messages import table_message
    from occ_constraints_pkg.ros.qos import STEPS
    from sensor_msgs.msg import PointCloud2

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    robots = ('robot1', 'robot2')
    publishers, costs, violations, judging = {}, {}, {}, set()

    def on_diagnostics(message):
        judging.update(status.name for status in message.status)

    witness.node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 10)
    for robot in robots:
        nodes.start('monitor', namespace=f'/{robot}', constraints_file=rules, timeout=60.0)
        costs[robot], violations[robot] = [], []
        topic = f'/{robot}/observation'
        publishers[robot] = witness.node.create_publisher(PointCloud2, topic, STEPS)
        for kind, name, heard in (
            (PointCloud2, 'costs', costs[robot]),
            (DiagnosticArray, 'violation', violations[robot]),
        ):
            witness.node.create_subscription(kind, f'/{robot}/{name}', heard.append, STEPS)

    def matched():
        return (
            all(
                publishers[robot].get_subscription_count() == 1
                and witness.node.count_publishers(f'/{robot}/costs') == 1
                for robot in robots
            )
            and len(judging) == 2
        )

    witness.spin_until(matched, 20.0)
    assert judging == {'robot1/monitor: judging', 'robot2/monitor: judging'}
    for robot, rows, count in (('robot1', [(0.8, 0.2)], 3), ('robot2', [(0.2, 0.8)] * 2, 5)):
        for number in range(count):
            table = Table(('x', 'y'), np.array(rows, dtype=np.float32))
            publishers[robot].publish(table_message(table, 10**18 + number))
    witness.spin_until(
        lambda: len(violations['robot1']) == 3 and len(violations['robot2']) == 5, 10
    )
    for robot, rows, cost in (('robot1', 1, 0.0), ('robot2', 2, 1.0)):
        for message in costs[robot]:
            assert Table.from_message(message).column('cost').tolist() == [cost] * rows
    assert (len(costs['robot1']), len(costs['robot2'])) == (3, 5)
