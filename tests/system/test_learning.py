# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The tree learner hands rules to a monitor, from bags and from live topics."""

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules.constraints_file import load_constraints, parse_constraints
from synthetic_bags import write_drive

COLUMNS = ('x', 'y', 'reward', 'terminated', 'truncated', 'episode', 'true_cost')


@pytest.fixture
def drive(observer):
    """Return a function that publishes one observation of robots."""
    from occ_constraints_pkg.ros.qos import STEPS
    from occ_constraints_pkg.ros.tables import table_message
    from sensor_msgs.msg import PointCloud2

    publisher = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
    stamps = iter(range(10**18, 2 * 10**18, 10**8))

    def publish(rows):
        values = np.zeros((len(rows), len(COLUMNS)), dtype=np.float32)
        values[:, :2] = rows
        publisher.publish(table_message(Table(COLUMNS, values), next(stamps), 'simple_nav'))

    publish.publisher = publisher
    return publish


def test_a_monitor_that_starts_later_uses_the_rules_learned_from_a_bag(
    nodes, observer, drive, small_bag
):
    rules = nodes.folder / 'rules.yaml'
    learner = nodes.start(
        'tree_learner', bags=str(small_bag), feature_map='simple_nav', output=rules
    )
    observer.spin_until(lambda: 'rules learned' in learner.log.read_text())
    monitor = nodes.start('monitor', timeout=60.0)
    learned = load_constraints(rules)
    fingerprint = learned.rule_set.fingerprint
    observer.spin_until(lambda: fingerprint in monitor.log.read_text())
    # One more than the observer, which listens to observations as well.
    observer.spin_until(lambda: drive.publisher.get_subscription_count() == 2)
    observer.wait_for_monitor(1)
    rows = np.random.default_rng(0).random((200, 2))
    drive(rows)
    observer.spin_until(lambda: len(observer.heard.costs) > 0)
    cost = next(iter(observer.heard.costs.values())).column('cost')
    expected = learned.rule_set.judge(rows.astype(np.float32).astype(np.float64)).cost
    np.testing.assert_array_equal(cost, expected)
    assert 0 < expected.sum() < 200


def test_in_a_namespace_it_learns_from_bags_of_that_namespace(nodes, observer, tmp_path):
    bag = write_drive(tmp_path / 'bag', robots=3, steps=40, topic='/r1/observation')
    rules = nodes.folder / 'rules.yaml'
    nodes.start(
        'tree_learner', namespace='/r1', bags=str(bag), feature_map='simple_nav', output=rules
    )
    observer.spin_until(rules.is_file)
    assert load_constraints(rules).feature_map['pace'] == 'observation'


def test_learns_from_live_topics_when_asked(nodes, observer, drive, trigger):
    from occ_constraints_pkg.ros.qos import LATCHED
    from std_msgs.msg import String

    rules = nodes.folder / 'rules.yaml'
    nodes.start(
        'tree_learner', feature_map='simple_nav', output=rules, contamination=0, false_alarm=0.2
    )
    answer = trigger('tree_learner/learn')
    assert (answer.success, answer.message) == (False, 'no sample has been received yet')
    observer.spin_until(lambda: drive.publisher.get_subscription_count() == 2)
    rows = np.random.default_rng(1).uniform(0.2, 0.6, (3, 40, 2)).astype(np.float32)
    for batch in rows:
        drive(batch)
    observer.spin_until(lambda: len(observer.heard.true_cost) == 3)
    observer.spin_until(lambda: trigger('tree_learner/learn').success)
    heard = []
    observer.node.create_subscription(String, 'constraints', heard.append, LATCHED)
    observer.spin_until(lambda: heard)
    constraints = parse_constraints(heard[0].data, 'heard')
    assert heard[0].data == rules.read_text()
    assert (
        constraints.coverage['training_samples'] + constraints.coverage['held_out_samples'] == 120
    )
    # Each of the 40 robots drove one episode.
    calibration = constraints.learner['calibration']
    assert (calibration['false_alarm'], calibration['episodes']) == (0.2, 8)

    note = rules.read_text().replace('enabled: true', 'enabled: false', 1)
    rules.write_text(note)
    answer = trigger('tree_learner/learn')
    assert not answer.success
    assert 'was edited' in answer.message
    assert rules.read_text() == note
