# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The monitor as a managed node: what it does in each state, and what a failed step says."""

import json

import numpy as np
from occ_constraints_pkg.features.table import Table

SAFE = (0.8, 0.2)


class Manager:
    """Leads a monitor through its states, feeds it, and hears its verdicts."""

    def __init__(self, observer):
        from diagnostic_msgs.msg import DiagnosticArray
        from occ_constraints_pkg.ros.qos import LATCHED, STEPS
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self.observer, self.verdicts, self.rules = observer, [], []
        self.publisher = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
        for kind, topic, heard, qos in (
            (DiagnosticArray, 'violation', self.verdicts, STEPS),
            (String, 'rules', self.rules, LATCHED),
        ):
            observer.node.create_subscription(kind, topic, heard.append, qos)
        self.stamp = 10**18

    def change(self, label='', number=0):
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        transition = Transition(label=label, id=number)
        return self.observer.call(
            ChangeState, 'monitor/change_state', transition=transition
        ).success

    def state(self):
        from lifecycle_msgs.srv import GetState

        return self.observer.call(GetState, 'monitor/get_state').current_state.label

    def set(self, name, text):
        from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
        from rcl_interfaces.srv import SetParameters

        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
        answer = self.observer.call(
            SetParameters, 'monitor/set_parameters', parameters=[Parameter(name=name, value=value)]
        )
        return answer.results[0]

    def drive(self):
        from occ_constraints_pkg.ros.tables import table_message

        self.stamp += 10**8
        table = Table(('x', 'y'), np.array([SAFE], dtype=np.float32))
        self.publisher.publish(table_message(table, self.stamp))

    def until_safe(self):
        def there():
            self.drive()
            return self.verdicts and self.verdicts[-1].status[0].message == 'SAFE'

        self.observer.spin_until(there)


def test_a_monitor_is_led_through_its_states(nodes, observer, rules_of):
    good = rules_of['simple_nav']
    good.save(nodes.folder / 'rules.yaml')
    missing = str(nodes.folder / 'nowhere.yaml')
    process = nodes.start('monitor', autostart=False, constraints_file=missing)
    manager = Manager(observer)
    assert manager.state() == 'unconfigured'
    assert not manager.change('configure')
    assert f'configure failed: cannot read {missing}' in process.log.read_text()
    assert manager.state() == 'unconfigured'
    # By number, as lifecycle managers ask: to activate, and what no state knows.
    assert not manager.change(number=3)
    assert not manager.change(number=99)
    assert not manager.change('activate')
    assert 'there is no transition 3 from unconfigured; allowed are 1 (configure)' in (
        process.log.read_text()
    )
    assert manager.state() == 'unconfigured'

    assert manager.set('constraints_file', str(nodes.folder / 'rules.yaml')).successful
    assert manager.change('configure')
    assert manager.state() == 'inactive'
    refused = manager.set('constraints_file', missing)
    assert not refused.successful
    assert 'can only be set while the node is unconfigured; it is inactive' in refused.reason
    observer.spin_until(lambda: len(manager.rules) == 1)
    told = json.loads(manager.rules[0].data)
    assert told['rule_set'] == good.rule_set.fingerprint
    assert [rule['id'] for rule in told['rules']] == [rule.id for rule in good.rule_set.rules]
    assert told['rules'][0]['text'] == 'y above 0.95'
    observer.spin_until(lambda: manager.publisher.get_subscription_count() == 2)
    manager.drive()
    assert manager.state() == 'inactive'
    assert manager.verdicts == []

    assert manager.change('activate')
    manager.until_safe()
    assert manager.change('deactivate')
    assert manager.state() == 'inactive'
    last = manager.verdicts[-1].status[0]
    assert last.message == 'UNKNOWN: the monitor is not active'
    count = len(manager.verdicts)
    manager.drive()
    assert manager.state() == 'inactive'
    assert len(manager.verdicts) == count

    assert manager.change('cleanup')
    assert manager.change(number=1)
    assert manager.change('activate')
    manager.until_safe()
    assert manager.change('shutdown')
    assert manager.state() == 'finalized'
    assert process.is_running


def test_a_monitor_that_started_itself_says_why_a_later_step_fails(nodes, observer, rules_of):
    rules_of['simple_nav'].save(nodes.folder / 'rules.yaml')
    missing = str(nodes.folder / 'nowhere.yaml')
    process = nodes.start('monitor', constraints_file=str(nodes.folder / 'rules.yaml'))
    manager = Manager(observer)
    observer.spin_until(lambda: manager.state() == 'active')
    assert not manager.change(number=1)
    assert manager.change('deactivate')
    assert manager.change('cleanup')
    assert manager.set('constraints_file', missing).successful
    assert not manager.change('configure')
    assert f'configure failed: cannot read {missing}' in process.log.read_text()
    assert manager.state() == 'unconfigured'


def test_a_rule_set_that_came_before_is_used_once_configured(nodes, observer, rules_of):
    from occ_constraints_pkg.ros.qos import LATCHED
    from std_msgs.msg import String

    good = rules_of['simple_nav']
    nodes.start('monitor', autostart=False)
    manager = Manager(observer)
    observer.node.create_publisher(String, 'constraints', LATCHED).publish(
        String(data=good.dumps())
    )
    assert manager.change('configure')
    assert manager.change('activate')
    manager.until_safe()
