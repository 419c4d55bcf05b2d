# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's example from demonstrations to the one rule that is left, over real nodes."""

from dataclasses import replace

import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.rules.constraints_file import load_constraints


def test_simple_navigation_is_pruned_to_the_rule_of_the_paper(nodes, observer, trigger, let_go):
    bag, rules, pruned_file = (nodes.folder / name for name in ('bag', 'a.yaml', 'b.yaml'))
    episode = {'world': 'simple_nav', 'num_robots': 200, 'episodes': 1, 'wait_for_subscribers': 3}
    monitor = nodes.start(
        'monitor', namespace='/drive', pruned_file=pruned_file, prune_threshold=0.01
    )
    recorder = nodes.start('recorder', namespace='/drive', output=bag, topics='observation')
    expert = nodes.start('policy', namespace='/drive', policy='expert')
    demonstration = nodes.start('sim', namespace='/drive', **episode)
    let_go(observer, '/drive/observation')
    observer.spin_until(lambda: not demonstration.is_running)
    demonstration.raise_error()
    nodes.stop(recorder, expert)
    learner = nodes.start(
        'tree_learner',
        namespace='/drive',
        bags=[bag],
        feature_map='simple_nav',
        output=rules,
        clip='density',
        alpha=0.5,
        max_depth=2,
    )
    observer.spin_until(lambda: 'enabled rule' in monitor.log.read_text())
    nodes.start('policy', namespace='/drive', policy='straight', wait_for_costs=True)
    # The observer listens to observations still.
    drive = nodes.start('sim', namespace='/drive', seed=5, **episode)
    observer.spin_until(lambda: not drive.is_running)
    drive.raise_error()
    nodes.stop(learner)
    answer = trigger('/drive/monitor/prune')
    assert answer.success, answer.message

    pruned = load_constraints(pruned_file)
    left = [rule for rule in pruned.rule_set.rules if rule.enabled]
    assert len(left) == 1
    assert len(pruned.rule_set.rules) == len(load_constraints(rules).rule_set.rules) > 1
    literals = {pruned.rule_set.space.names[item.feature]: item for item in left[0].literals}
    assert literals.keys() == {'x', 'y'}
    assert literals['x'].is_upper
    assert not literals['y'].is_upper
    assert literals['x'].bound == pytest.approx(0.7, abs=0.07)
    assert literals['y'].bound == pytest.approx(0.3, abs=0.03)

    # The same from a file with counters, without ROS.
    counted = tuple(replace(rule, enabled=True, note='') for rule in pruned.rule_set.rules)
    file = nodes.folder / 'c.yaml'
    pruned.with_rule_set(replace(pruned.rule_set, rules=counted)).save(file)
    assert main(['prune', str(file), '--threshold', '0.01']) == 0
    assert load_constraints(file).rule_set.rules == pruned.rule_set.rules
