# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The constrained learner trains over topics, also when a node falls asleep for a while."""

import json
import signal
import time

import pytest
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.worlds.registry import world_class

ROBOTS = 8


def test_training_survives_a_monitor_that_sleeps_and_counts_no_step_twice(nodes, witness, rules_of):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    from occ_constraints_pkg.ros.qos import STEPS
    from sensor_msgs.msg import PointCloud2

    rules, output = nodes.folder / 'rules.yaml', nodes.folder / 'training'
    rules_of['simple_nav'].save(rules)
    monitor = nodes.start('monitor', constraints_file=rules)
    learner = nodes.start('constrained_learner', output=output, rollout_steps=32)
    nodes.start('sim', world='simple_nav', num_robots=ROBOTS, wait_for_subscribers=4)
    done = {}

    def on_observation(message):
        table = Table.from_message(message)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        done[stamp] = (table.column('terminated') > 0) | (table.column('truncated') > 0)

    witness.node.create_subscription(PointCloud2, 'observation', on_observation, STEPS)
    log = output / 'metrics.jsonl'

    def lines():
        return log.read_text().splitlines() if log.exists() else []

    witness.spin_until(lambda: len(lines()) >= 2, 60.0)
    monitor.send_signal(signal.SIGSTOP)
    asleep = time.monotonic()
    witness.spin_until(lambda: time.monotonic() > asleep + 2.0, 3.0)
    before = len(lines())
    monitor.send_signal(signal.SIGCONT)
    witness.spin_until(lambda: len(lines()) >= before + 2, 30.0)
    # The simulation said its last step again and again, and one answer was enough.
    assert witness.heard.duplicates >= 1
    nodes.stop(learner, number=signal.SIGTERM)
    # All that was published has been heard when the last step has come a second time.
    heard = witness.heard.duplicates
    witness.spin_until(lambda: witness.heard.duplicates > heard, 10.0)

    steps = [json.loads(line)['steps'] for line in lines()]
    assert all(first < second for first, second in zip(steps[:-1], steps[1:], strict=True))
    learned = json.loads((output / 'summary.json').read_text())['steps']
    # Each state but the last of an episode is left by one transition. The learner had the last
    # of all states or did not; it does not learn from what follows that one.
    transitions = [(~done[stamp]).sum() for stamp in sorted(done)]
    assert learned in (sum(transitions[:-1]), sum(transitions[:-2]))

    world = world_class('simple_nav')
    GaussianPolicy.load(output / 'policy.npz').check_world(world.columns, world.action_columns)
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

    assert PPOLagrangian.load(output / 'checkpoint.pt').steps == learned


def test_a_simulation_that_starts_anew_is_no_successor_of_the_old_one(nodes, witness, rules_of):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    rules, output = nodes.folder / 'rules.yaml', nodes.folder / 'training'
    rules_of['simple_nav'].save(rules)
    nodes.start('monitor', constraints_file=rules)
    # Without an update, so that every step taken is in the summary and none else.
    learner = nodes.start('constrained_learner', output=output, rollout_steps=100_000)
    parameters = {'world': 'simple_nav', 'num_robots': 1, 'wait_for_subscribers': 3}
    stamps = witness.heard.costs
    counts = []
    for _ in range(2):
        sim = nodes.start('sim', **parameters)
        before = len(stamps)
        witness.spin_until(lambda least=before + 20: len(stamps) >= least, 30.0)
        nodes.stop(sim)
        seen = [-1]

        def quiet(seen=seen):
            seen.append(len(stamps))
            return seen[-1] == seen[-2]

        witness.spin_until(quiet, 5.0)
        counts.append(len(stamps) - before)
    nodes.stop(learner)
    learned = json.loads((output / 'summary.json').read_text())['steps']
    # In each run one transition less than states, and the last state may have come too late. An
    # episode takes longer than either run.
    assert max(counts) < 150
    assert sum(counts) - 4 <= learned <= sum(counts) - 2
