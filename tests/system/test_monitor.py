# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The monitor under bad input: what cannot be judged is UNKNOWN, and the node lives on."""

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules import Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints

COLUMNS = ('x', 'y', 'reward', 'terminated', 'truncated', 'episode', 'true_cost')
SAFE, UNSAFE = (0.8, 0.2), (0.2, 0.8)
STALE = b'\x03'


class Robot:
    """Publishes observations as a simulation would, and listens to the monitor."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.qos import LATCHED, STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import Float64, String

        self.observer = observer
        self.costs, self.cost, self.violations, self.rule_stats = [], [], [], []
        self.publisher = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
        self.constraints = observer.node.create_publisher(String, 'constraints', LATCHED)
        for kind, topic, heard in (
            (PointCloud2, 'costs', self.costs),
            (Float64, 'cost', self.cost),
            (DiagnosticArray, 'violation', self.violations),
            (PointCloud2, 'rule_stats', self.rule_stats),
        ):
            observer.node.create_subscription(kind, topic, heard.append, STEPS)
        self.stamp = 10**18

    def wait_for_monitor(self):
        self.observer.wait_for_monitor(2)
        # The observer itself listens as well.
        self.until(lambda: self.publisher.get_subscription_count() >= 2)

    def until(self, condition):
        self.observer.spin_until(condition)

    def message(self, *rows, columns=COLUMNS):
        from occ_constraints_pkg.ros.tables import table_message

        values = np.zeros((len(rows), len(columns)), dtype=np.float32)
        if rows:
            values[:, : len(rows[0])] = rows
        self.stamp += 10**8
        return table_message(Table(columns, values), self.stamp, 'simple_nav')

    def send(self, message):
        """Publish and return the answers: one each of costs (or None), cost and violation."""
        before = len(self.costs), len(self.cost), len(self.violations)
        self.publisher.publish(message)
        self.until(lambda: len(self.violations) > before[2] and len(self.cost) > before[1])
        costs = Table.from_message(self.costs[-1]) if len(self.costs) > before[0] else None
        return costs, self.cost[-1].data, self.violations[-1]

    def is_safe(self):
        costs, cost, _ = self.send(self.message(SAFE))
        return costs.column('verdict')[0] == Verdict.SAFE and cost == 0.0

    def use(self, text):
        """Publish other constraints than before and wait until the monitor has seen them."""
        from std_msgs.msg import String

        before = self.said()
        self.constraints.publish(String(data=text))
        self.until(lambda: self.said() > before)

    def said(self):
        text = self.monitor.log.read_text()
        return text.count('enabled rule') + text.count('rule set refused')

    def start_monitor(self, nodes, rules, **parameters):
        file = nodes.folder / 'rules.yaml'
        rules.save(file)
        self.monitor = nodes.start('monitor', constraints_file=file, **parameters)
        self.wait_for_monitor()


@pytest.fixture(scope='module')
def shared(make_nodes, rules_of):
    """Return a robot with a monitor that several tests use, one after the other."""
    from listener import Listener

    nodes = make_nodes()
    with Listener(nodes.domain) as observer:
        robot = Robot(observer)
        # No test is so slow that its silence would be noticed.
        robot.start_monitor(nodes, rules_of['simple_nav'], timeout=100.0)
        yield robot
        nodes.stop()


@pytest.fixture
def robot(shared, rules_of):
    """Return that robot; afterwards its monitor must be alive and have its first rules again."""
    yield shared
    assert shared.monitor.is_running
    shared.use(rules_of['simple_nav'].dumps() + f'# {shared.stamp}')
    assert shared.is_safe()


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_numbers_that_are_none_are_unknown_and_cost(robot):
    for bad in (np.nan, np.inf, -np.inf, 1.5):
        costs, cost, violation = robot.send(robot.message((0.8, bad), SAFE, UNSAFE))
        verdicts = [Verdict.UNKNOWN, Verdict.SAFE, Verdict.VIOLATED]
        assert costs.column('verdict').tolist() == verdicts
        assert costs.column('cost').tolist() == [1.0, 0.0, 1.0]
        assert np.isnan(costs.column('margin')[0])
        assert costs.column('rule').tolist() == [-1.0, -1.0, 1.0]
        assert cost == 1.0
        assert violation.status[0].level == STALE
        assert violation.status[0].message.startswith('UNKNOWN: y ')
        assert stamp_of(violation) == robot.stamp
    assert robot.is_safe()


def test_input_that_cannot_be_read_is_unknown_and_the_next_is_judged(robot):
    truncated = robot.message(SAFE)
    truncated.data = truncated.data[:-1]
    integers = robot.message(SAFE)
    number = type(integers.fields[1])(name='y', offset=4, datatype=5, count=1)
    integers.fields = [integers.fields[0], number, *integers.fields[2:]]
    broken = {
        'asks for column': robot.message((0.8,), columns=('x', *COLUMNS[2:])),
        'holds only': truncated,
        'is not a table': integers,
        'without rows': robot.message(),
    }
    for reason, message in broken.items():
        costs, cost, violation = robot.send(message)
        assert (costs, cost) == (None, 1.0)
        assert len(violation.status) == 1
        assert violation.status[0].level == STALE
        assert violation.status[0].message.startswith('UNKNOWN: ')
        assert reason in violation.status[0].message
        assert stamp_of(violation) == stamp_of(message)
        assert robot.is_safe()


def test_silence_is_unknown_again_and_again_until_the_next_input(nodes, observer, rules_of):
    robot = Robot(observer)
    robot.start_monitor(nodes, rules_of['simple_nav'], timeout=0.5)
    assert robot.is_safe()
    before = len(robot.cost)
    robot.until(lambda: len(robot.cost) >= before + 3)
    assert {message.data for message in robot.cost[before:]} == {1.0}
    status = robot.violations[-1].status[0]
    assert (status.level, status.message) == (STALE, 'UNKNOWN: no new input for 0.5 s')
    assert stamp_of(robot.violations[-1]) == robot.stamp
    assert robot.is_safe()


def test_an_approach_is_warned_of_and_an_episode_forgets_it(nodes, observer, rules_of):
    from occ_constraints_pkg.ros.qos import STEPS
    from std_msgs.msg import Float64

    robot = Robot(observer)
    times, margins = [], []
    for topic, heard in (('time_to_violation', times), ('margin', margins)):
        observer.node.create_subscription(Float64, topic, heard.append, STEPS)
    robot.start_monitor(nodes, rules_of['simple_nav'], timeout=100.0, warning_horizon=0.5)
    # The monitor has found this node's subscriptions when it has answered on each topic.
    robot.until(lambda: robot.send(robot.message(SAFE)) and times and margins)
    # A later episode knows nothing of them. Steps of 0.1 s; 1 m/s towards the rule on x <= 0.7.
    for x in (1.0, 0.9, 0.8, 0.75):
        count = len(times)
        message = robot.message((x, 0.4, 0.0, 0.0, 0.0, 1.0, 0.0))
        _, cost, violation = robot.send(message)
        robot.until(lambda least=count: len(times) > least)
        assert cost == 0.0
        told = {item.key: item.value for item in violation.status[0].values}
        if x in (1.0, 0.9):
            assert times[-1].data == np.inf
            assert violation.status[0].message == 'SAFE'
    # Over 0.3 s the line through the four falls by 0.085 per step.
    assert times[-1].data == pytest.approx(0.05 / 0.85, rel=1e-3)
    assert float(told['time_to_violation']) == times[-1].data
    assert (told['next_rule'], told['deciding_feature']) == ('R1', 'x')
    assert told['warning'].startswith('estimate: x at most 0.7 and y at least 0.3 in 0.059 s')
    assert violation.status[0].message == f'SAFE: {told["warning"]}'
    assert margins[-1].data == pytest.approx(0.1, abs=1e-6)
    robot.send(robot.message((0.72, 0.4, 0.0, 0.0, 0.0, 2.0, 0.0)))
    robot.until(lambda: times[-1].data == np.inf)


def test_a_topic_of_another_type_is_unknown_and_named(nodes, observer, rules_of):
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from std_msgs.msg import String

    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=nodes.domain)
    other = rclpy.create_node('other', context=context)
    publisher = other.create_publisher(String, 'observation', 10)
    try:
        process = nodes.start('monitor', constraints_file=rules, timeout=0.5)
        heard = []
        observer.node.create_subscription(DiagnosticArray, 'violation', heard.append, 10)
        expected = (
            'UNKNOWN: observation is published as std_msgs/msg/String; allowed is '
            'sensor_msgs/msg/PointCloud2'
        )

        def told():
            publisher.publish(String(data='x'))
            return heard and heard[-1].status[0].message == expected

        observer.spin_until(told)
        assert process.is_running
    finally:
        other.destroy_node()
        rclpy.shutdown(context=context)


def test_bad_constraints_are_refused_and_new_ones_used_at_once(robot, rules_of):
    good = rules_of['simple_nav']
    typo = good.dumps().replace('operator', 'operatr')
    newer = good.dumps().replace('schema_version: 1', 'schema_version: 2')
    for text in (
        '',
        '{',
        'schema_version: 1',
        typo,
        newer,
        good.dumps()[:200] + '\0',
        Constraints(good.rule_set).dumps(),
    ):
        refused = robot.monitor.log.read_text().count('rule set refused')
        robot.use(text)
        assert robot.monitor.log.read_text().count('rule set refused') == refused + 1
    assert robot.is_safe()
    assert robot.send(robot.message(UNSAFE))[1] == 1.0

    space = good.rule_set.space
    inverse = RuleSet(space, (Rule('only', (Literal(0, '>', 0.5),)),), good.rule_set.demonstrated)
    robot.use(good.with_rule_set(inverse).dumps())
    assert robot.send(robot.message(UNSAFE))[1] == 0.0
    costs, cost, violation = robot.send(robot.message(SAFE))
    assert cost == 1.0
    assert violation.status[1].name == 'monitor: rule only'


def one_rule(constraints):
    """Return the same constraints without the first rule."""
    whole = constraints.rule_set
    return constraints.with_rule_set(RuleSet(whole.space, whole.rules[1:], whole.demonstrated))


def test_no_input_is_missed_while_rules_change(robot, rules_of):
    from std_msgs.msg import String

    good = rules_of['simple_nav']
    before, sent = len(robot.costs), []
    for step in range(200):
        robot.publisher.publish(robot.message(SAFE, UNSAFE))
        sent.append(robot.stamp)
        if step % 10 == 0:
            rules = (one_rule(good), good)[step // 10 % 2]
            robot.constraints.publish(String(data=rules.dumps()))
        # A few under way at any time, fewer than the topics hold.
        robot.until(lambda least=before + step - 20: len(robot.costs) >= least)
    robot.until(lambda: len(robot.costs) >= before + 200)
    assert [stamp_of(message) for message in robot.costs[before:]] == sent
    for message in robot.costs[before:]:
        assert Table.from_message(message).column('cost').tolist() == [0.0, 1.0]


def test_another_feature_map_is_used_from_then_on(robot, rules_of):
    good = rules_of['simple_nav']
    document = dict(good.feature_map, max_age=0.25)
    document['features'] = [dict(item, transform='abs') for item in document['features']]
    robot.use(Constraints(good.rule_set, document).dumps())
    answers = []

    def answered():
        # The new subscription has to be found first; until then all goes to the old one.
        robot.publisher.publish(robot.message((-0.8, -0.2), (-0.2, -0.8)))
        answers[:] = [Table.from_message(item).values for item in robot.costs[-1:]]
        return answers and answers[0][:, 0].tolist() == [0.0, 1.0]

    robot.until(answered)


def test_counters_survive_the_same_rules_and_a_repeat_counts_once(robot, rules_of):
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    text = one_rule(rules_of['simple_nav']).dumps()
    robot.use(text)
    message = robot.message(SAFE, UNSAFE, UNSAFE)
    for _ in range(4):
        first = robot.send(message)[0]
        assert first.column('cost').tolist() == [0.0, 1.0, 1.0]
    robot.constraints.publish(String(data=text))
    robot.send(robot.message(SAFE))

    def counts():
        return Table.from_message(robot.rule_stats[-1]).values.tolist() if robot.rule_stats else []

    robot.until(lambda: counts() == [[4.0, 2.0]])
    assert robot.observer.call(Trigger, 'monitor/reset_stats').success
    robot.until(lambda: counts() == [[0.0, 0.0]])


def test_a_disabled_monitor_says_unknown_and_judges_what_is_repeated_afterwards(robot):
    from std_srvs.srv import SetBool

    assert robot.observer.call(SetBool, 'monitor/enable', data=False).success
    message = robot.message(UNSAFE)
    costs, cost, violation = robot.send(message)
    assert (costs, cost) == (None, 1.0)
    assert violation.status[0].message == 'UNKNOWN: the monitor is disabled'
    assert robot.observer.call(SetBool, 'monitor/enable', data=True).success
    costs, cost, violation = robot.send(message)
    assert costs.column('verdict').tolist() == [Verdict.VIOLATED]
    assert stamp_of(robot.costs[-1]) == stamp_of(violation) == stamp_of(message)


def test_a_disabled_monitor_does_not_repeat_what_it_said_before(robot):
    from std_srvs.srv import SetBool

    message = robot.message(SAFE)
    assert robot.send(message)[1] == 0.0
    judged, told = len(robot.costs), len(robot.violations)
    assert robot.observer.call(SetBool, 'monitor/enable', data=False).success
    for _ in range(2):
        robot.publisher.publish(message)
    # One for being disabled, and one for each repeat.
    robot.until(lambda: len(robot.violations) >= told + 3)
    words = {violation.status[0].message for violation in robot.violations[told:]}
    assert words == {'UNKNOWN: the monitor is disabled'}
    assert len(robot.costs) == judged
    assert robot.observer.call(SetBool, 'monitor/enable', data=True).success


def test_typed_messages_of_a_best_effort_publisher_are_judged(nodes, observer):
    from nav_msgs.msg import Odometry
    from occ_constraints_pkg.ros.messages import to_time
    from occ_constraints_pkg.ros.qos import SENSORS

    document = {
        'schema_version': 1,
        'pace': 'odom',
        'max_age': 0.5,
        'features': [
            {'name': 'v_x', 'topic': 'odom', 'field': 'twist.twist.linear.x', 'unit': 'm/s'},
            {'name': 'v_y', 'topic': 'odom', 'field': 'twist.twist.linear.y', 'unit': 'm/s'},
        ],
    }
    space = FeatureMap.from_document(document, '').space
    rules = RuleSet(space, (Rule('fast', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]] * 2))
    robot = Robot(observer)
    file = nodes.folder / 'rules.yaml'
    Constraints(rules, document).save(file)
    nodes.start('monitor', constraints_file=file, timeout=0.5)
    observer.wait_for_monitor(2)
    publisher = robot.observer.node.create_publisher(Odometry, 'odom', SENSORS)
    robot.until(lambda: publisher.get_subscription_count() == 1)
    for speed, verdict in ((0.5, Verdict.SAFE), (1.5, Verdict.VIOLATED), (np.nan, 2)):
        message = Odometry()
        robot.stamp += 10**8
        message.header.stamp = to_time(robot.stamp)
        message.twist.twist.linear.x = speed
        before = len(robot.costs)
        publisher.publish(message)
        robot.until(lambda count=before: len(robot.costs) > count)
        assert Table.from_message(robot.costs[-1]).column('verdict').tolist() == [verdict]
        assert stamp_of(robot.costs[-1]) == robot.stamp


def test_joints_by_name_and_a_name_that_nobody_has(nodes, observer):
    from occ_constraints_pkg.ros.messages import to_time
    from occ_constraints_pkg.ros.qos import SENSORS
    from sensor_msgs.msg import JointState

    document = {
        'schema_version': 1,
        'pace': 'joint_states',
        'max_age': 5.0,
        'features': [
            {'name': name, 'topic': 'joint_states', 'field': f'position[name={name}]'}
            for name in ('elbow', 'finger')
        ],
    }
    space = FeatureMap.from_document(document, '').space
    rules = RuleSet(space, (Rule('far', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]] * 2))
    robot = Robot(observer)
    file = nodes.folder / 'rules.yaml'
    Constraints(rules, document).save(file)
    nodes.start('monitor', constraints_file=file, timeout=0.5)
    observer.wait_for_monitor(2)
    publisher = robot.observer.node.create_publisher(JointState, 'joint_states', SENSORS)
    robot.until(lambda: publisher.get_subscription_count() == 1)
    for joints, verdict in (
        ({'elbow': 0.5}, Verdict.UNKNOWN),
        ({'finger': 0.1}, Verdict.SAFE),
        ({'wrist': 0.0, 'elbow': 1.5}, Verdict.VIOLATED),
        # The elbow keeps its value.
        ({'finger': 0.2}, Verdict.VIOLATED),
    ):
        robot.stamp += 10**8
        message = JointState(name=list(joints), position=list(joints.values()))
        message.header.stamp = to_time(robot.stamp)
        before = len(robot.costs), len(robot.violations)
        publisher.publish(message)
        robot.until(
            lambda count=before: len(robot.costs) > count[0] and len(robot.violations) > count[1]
        )
        assert Table.from_message(robot.costs[-1]).column('verdict').tolist() == [verdict]
        if verdict is Verdict.UNKNOWN:
            words = robot.violations[-1].status[0].message
            assert "no message has name 'finger'; the last one has elbow" in words


def test_a_frozen_value_is_told(make_nodes, rules_of):
    """On ``/diagnostics`` and in the log, once."""
    from diagnostic_msgs.msg import DiagnosticArray
    from listener import Listener

    nodes, told = make_nodes(), []

    def listen(message):
        told.extend(item.message for item in message.status if item.name == 'monitor: sensors')

    with Listener(nodes.domain) as observer:
        robot = Robot(observer)
        observer.node.create_subscription(DiagnosticArray, '/diagnostics', listen, 10)
        robot.start_monitor(nodes, rules_of['simple_nav'], timeout=100.0, frozen_after=2)
        steps = iter(range(10**6))

        def is_told():
            robot.send(robot.message((0.8, 0.2 + next(steps) % 100 / 1000)))
            return sum('x is 0.8 in all' in words for words in told) > 2

        robot.until(is_told)
        assert 'no doubt' in told
        assert 'y is' not in told[-1]
        assert robot.monitor.log.read_text().count('it may be frozen') == 1
        nodes.stop()
