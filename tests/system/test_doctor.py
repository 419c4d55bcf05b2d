# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ doctor`` beside real nodes."""

import json
import subprocess
import sys

import pytest
from occ_constraints_pkg.demo.processes import environment


@pytest.fixture
def doctor(nodes):
    """Return a function that runs ``occ doctor``: exit code, and findings by name."""

    def run():
        done = subprocess.run(
            [sys.executable, '-m', 'occ_constraints_pkg', 'doctor', '--json'],
            env=environment(nodes.domain),
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        assert done.stderr == ''
        found = json.loads(done.stdout)['findings']
        return done.returncode, {item['name']: item for item in found}

    return run


def test_one_robot_is_well_and_two_monitors_are_not(nodes, observer, doctor, rules_of, tmp_path):
    rules = tmp_path / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    nodes.start('monitor', constraints_file=rules)
    nodes.start('gate')
    node = observer.node
    observer.spin_until(lambda: node.count_publishers('/violation') == 1)
    observer.spin_until(lambda: node.count_publishers('/cmd_vel') == 1)
    code, found = doctor()
    assert (code, found['discovery']['level']) == (0, 'ok'), found
    assert '1 topic of verdicts, one publisher each' in found['publishers']['text']
    nodes.start('monitor', constraints_file=rules)
    observer.spin_until(lambda: node.count_publishers('/violation') == 2)
    code, found = doctor()
    assert code == 1
    assert '/violation has 2 publishers' in found['publishers']['text']
    assert 'a gate stops' in found['publishers']['advice']
    assert 'several nodes are called /monitor' in found['publishers']['text']


def test_simulated_time_without_a_clock_is_found(nodes, observer, doctor):
    nodes.start('gate', use_sim_time=True)
    observer.spin_until(lambda: observer.node.count_publishers('/cmd_vel') == 1)
    code, found = doctor()
    assert code == 1
    assert '/gate have use_sim_time, and nobody publishes' in found['simulated time']['text']
