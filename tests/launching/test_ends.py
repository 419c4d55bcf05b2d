# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Launches end when their work is done or a node has died, and tell which of the two it was."""

import os
import signal

import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints


@pytest.fixture
def rules(tmp_path):
    """A constraints file of simple_nav."""
    feature_map = load_feature_map('simple_nav')
    rule = Rule('R0', (Literal(feature_map.space.index('y'), '>', 0.95),))
    demonstrated = np.tile([0.0, 0.9], (len(feature_map.space), 1))
    rule_set = RuleSet(feature_map.space, (rule,), demonstrated)
    Constraints(rule_set, feature_map.to_document()).save(tmp_path / 'rules.yaml')
    return 'constraints_file:=rules.yaml'


RECORD = (
    'bag:=2024',
    'feature_map:=simple_nav',
    'constraints_file:=learned.yaml',
    'world:=simple_nav',
    'num_robots:=4',
    'duration:=2',
)


@pytest.mark.parametrize('more', [(), ('namespace:=r1', 'use_sim_time:=true')])
def test_records_learns_and_ends(start, tmp_path, more):
    # That the name of the bag could be a number is part of the test.
    launch = start('record_and_learn', *RECORD, *more)
    assert launch.join() == 0
    assert load_constraints(tmp_path / 'learned.yaml').rules
    topic = '/r1/observation' if more else '/observation'
    times = [message.log_time_ns for message in Recording(tmp_path / '2024').messages([topic])]
    # From the first message on: nodes take longer to start on a busy machine.
    assert len(times) > 20
    if not more:
        assert times[-1] - times[0] > 1.5e9


def test_only_topics_that_are_asked_for_are_recorded(start, tmp_path):
    launch = start('record_and_learn', *RECORD, 'topics:=observation, action')
    assert launch.join() == 0
    assert set(Recording(tmp_path / '2024').topics) == {'/observation', '/action'}


def test_nothing_is_learned_when_the_recording_failed(start, tmp_path):
    (tmp_path / 'file').touch()
    launch = start('record_and_learn', 'bag:=file/bag', *RECORD[1:])
    assert launch.join() == 1
    assert 'recorder ended with exit code 2' in launch.text
    assert 'tree_learner' not in launch.pids
    assert not (tmp_path / 'learned.yaml').exists()


def test_a_learner_that_fails_ends_the_launch(start):
    # Recorded is the simple_nav world, but the map is one of another world.
    launch = start('record_and_learn', *RECORD[:1], 'feature_map:=PointGoal1', *RECORD[2:])
    assert launch.join() == 1
    assert 'tree_learner ended with exit code 2' in launch.text


def test_training_ends_after_its_steps(start, rules, tmp_path):
    pytest.importorskip('torch')
    launch = start(
        'training',
        rules,
        'output:=out',
        'world:=simple_nav',
        'num_robots:=4',
        'total_steps:=256',
        'cost_limit:=5',
    )
    assert launch.join() == 0
    assert (tmp_path / 'out' / 'policy.npz').is_file()


def test_training_without_rules_ends_at_once(start):
    launch = start('training', 'constraints_file:=none.yaml', 'output:=out', 'world:=simple_nav')
    assert launch.join() == 1
    assert 'monitor ended with exit code 2' in launch.text


def test_ctrl_c_ends_all_cleanly(start, rules):
    launch = start('monitor', rules, 'gate:=true')
    launch.wait_for('[gate]: ')
    launch.wait_for('[monitor]: ')
    launch.interrupt()
    assert launch.join() == 0


def test_a_node_that_dies_ends_the_launch(start, rules):
    launch = start('monitor', rules, 'gate:=true')
    launch.wait_for('[gate]: ')
    launch.wait_for('[monitor]: ')
    os.kill(launch.pids['monitor'], signal.SIGKILL)
    assert launch.join() == 1
    assert 'monitor ended with exit code -9' in launch.text


def test_with_respawn_it_is_started_again(start, rules):
    launch = start('monitor', rules, 'respawn:=true')
    launch.wait_for('[monitor]: ')
    first = launch.pids['monitor']
    os.kill(first, signal.SIGKILL)
    launch.wait_for('[monitor]: ', times=2)
    assert launch.pids['monitor'] != first
    launch.interrupt()
    assert launch.join() == 0


def test_with_respawn_a_mistake_ends_the_launch_all_the_same(start):
    launch = start('monitor', 'constraints_file:=none.yaml', 'respawn:=true')
    assert launch.join() == 1
    assert 'monitor ended with exit code 2' in launch.text


def test_ctrl_c_during_the_recording_learns_nothing(start, tmp_path):
    launch = start('record_and_learn', *RECORD[:5], 'duration:=60')
    launch.wait_for('[recorder]: recording all topics')
    launch.interrupt()
    assert launch.join() == 0
    assert 'tree_learner' not in launch.pids
    assert not (tmp_path / 'learned.yaml').exists()


def test_a_monitor_lives_by_the_clock_of_the_simulation(start, observer, rules):
    from diagnostic_msgs.msg import DiagnosticArray

    heard = []
    observer.node.create_subscription(
        DiagnosticArray, '/robot1/violation', lambda message: heard.append(message.status[0]), 100
    )
    options = ('namespace:=robot1', 'use_sim_time:=true')
    start('monitor', rules, *options)
    start('simulation', 'world:=simple_nav', 'policy:=straight', *options)
    observer.spin_until(lambda: any(item.message.startswith('SAFE') for item in heard))
