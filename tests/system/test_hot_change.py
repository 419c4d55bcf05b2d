# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules change while observations pour in: no verdict is missed, and none is mixed."""

import json

import numpy as np
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules.edits import RuleEdits

SENT = 600
AT_ONCE = 25
ROBOTS = 3


class Flood:
    """Sends observations as fast as they are judged, and keeps every answer."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.qos import LATCHED, STEPS
        from rcl_interfaces.srv import SetParametersAtomically
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self.observer, self.costs, self.verdicts, self.rules = observer, [], [], []
        node = observer.node
        self.observation = node.create_publisher(PointCloud2, 'observation', STEPS)
        self.constraints = node.create_publisher(String, 'constraints', LATCHED)
        for kind, topic, heard, qos in (
            (PointCloud2, 'costs', self.costs, STEPS),
            (DiagnosticArray, 'violation', self.verdicts, STEPS),
            (String, 'rules', self.rules, LATCHED),
        ):
            node.create_subscription(kind, topic, heard.append, qos)
        self.client = node.create_client(
            SetParametersAtomically, 'monitor/set_parameters_atomically'
        )
        self.values = {}

    def set(self, **lists):
        """Ask for parameters without waiting for the answer."""
        from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

        kind = ParameterType.PARAMETER_STRING_ARRAY
        parameters = [
            Parameter(name=name, value=ParameterValue(type=kind, string_array_value=texts or ['']))
            for name, texts in lists.items()
        ]
        return self.client.call_async(self.client.srv_type.Request(parameters=parameters))

    def send(self, stamp, rng):
        from occ_constraints_pkg.ros.tables import table_message

        values = rng.random((ROBOTS, 2)).astype(np.float32)
        self.values[stamp] = values.astype(np.float64)
        self.observation.publish(table_message(Table(('x', 'y'), values), stamp))


def test_every_verdict_is_that_of_the_rule_set_it_names(nodes, observer, rules_of):
    from occ_constraints_pkg.ros.messages import to_nanoseconds
    from std_msgs.msg import String

    good = rules_of['simple_nav']
    file = nodes.folder / 'rules.yaml'
    good.save(file)
    flood = Flood(observer)
    nodes.start('monitor', constraints_file=file, timeout=100.0)
    observer.wait_for_monitor(2)
    observer.spin_until(lambda: flood.rules and flood.client.service_is_ready())
    observer.spin_until(lambda: flood.observation.get_subscription_count() == 2)

    # Without the second rule, with its bound moved, and with a rule set of its own.
    moved = good.with_rule_set(RuleEdits.parse([], [], ['R0: y > 0.5']).apply(good.rule_set))
    edits = [
        RuleEdits(),
        RuleEdits.parse(['R1'], [], []),
        RuleEdits.parse([], [], ['R0: y > 0.25', 'R1: y >= 0.5']),
    ]
    known = {}
    for base in (good, moved):
        for edit in edits:
            rule_set = edit.apply(base.rule_set)
            known[rule_set.fingerprint] = rule_set
    texts = [[], ['R1'], []], [[], [], ['R0: y > 0.25', 'R1: y >= 0.5']]
    rng, answers = np.random.default_rng(0), []
    stamps = [10**18 + 10**6 * number for number in range(SENT)]
    for number, stamp in enumerate(stamps):
        flood.send(stamp, rng)
        if number % 20 == 10:
            place = number // 20 % 3
            answers.append(flood.set(disabled_rules=texts[0][place], moved_bounds=texts[1][place]))
        if number % 50 == 25:
            text = (moved, good)[number // 50 % 2].dumps()
            flood.constraints.publish(String(data=text))
        observer.spin_until(lambda least=number - AT_ONCE: len(flood.costs) > least)
    observer.spin_until(lambda: len(flood.costs) == len(flood.verdicts) == SENT)
    observer.spin_until(lambda: all(answer.done() for answer in answers))
    assert all(answer.result().result.successful for answer in answers)

    assert [to_nanoseconds(message.header.stamp) for message in flood.costs] == stamps
    assert [to_nanoseconds(message.header.stamp) for message in flood.verdicts] == stamps
    used = {}
    for costs, told in zip(flood.costs, flood.verdicts, strict=True):
        rule_set = known[costs.header.frame_id]
        used[rule_set.fingerprint] = used.get(rule_set.fingerprint, 0) + 1
        values = flood.values[to_nanoseconds(costs.header.stamp)]
        judgement, table = rule_set.judge(values), Table.from_message(costs)
        np.testing.assert_array_equal(table.column('verdict'), judgement.verdict)
        np.testing.assert_array_equal(table.column('margin'), judgement.margin)
        np.testing.assert_array_equal(table.column('rule'), judgement.rule)
        # Every rule that is true is told, and by the same rule set.
        by_robot = {}
        for status in told.status:
            entries = {item.key: item.value for item in status.values}
            if status.name == 'monitor: verdict':
                assert entries['rule_set'] == rule_set.fingerprint
                robot, by_robot[int(entries['robot'])] = int(entries['robot']), []
            else:
                by_robot[robot].append((entries['id'], entries['formula']))
        for robot, rules in by_robot.items():
            true = [rule_set.rules[place] for place in rule_set.violated_rules(values[robot])]
            assert rules == [(rule.id, rule.formula(rule_set.space)) for rule in true]
    assert len(used) >= 4, used
    last = json.loads(flood.rules[-1].data)
    assert last['rule_set'] == flood.costs[-1].header.frame_id


def test_an_edit_that_cannot_be_made_changes_nothing(nodes, observer, rules_of):
    file = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(file)
    flood = Flood(observer)
    nodes.start('monitor', constraints_file=file, timeout=100.0, disabled_rules=['R1'])
    observer.spin_until(lambda: flood.rules and flood.client.service_is_ready())
    for lists, reason in (
        ({'disabled_rules': ['R7']}, "there is no rule 'R7'"),
        ({'disabled_rules': ['R0'], 'moved_bounds': ['R0 > 1']}, 'a moved bound is'),
        ({'disabled_rules': [], 'moved_bounds': ['R1: x <= -inf']}, 'a moved bound is'),
    ):
        answer = flood.set(**lists)
        observer.spin_until_done(answer)
        assert not answer.result().result.successful
        assert reason in answer.result().result.reason
    assert len(flood.rules) == 1
    answer = flood.set(disabled_rules=[])
    observer.spin_until_done(answer)
    assert answer.result().result.successful
    observer.spin_until(lambda: len(flood.rules) == 2)
    told = [json.loads(message.data) for message in flood.rules]
    assert [[rule['enabled'] for rule in one['rules']] for one in told] == [
        [True, False],
        [True, True],
    ]
