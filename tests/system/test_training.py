# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The constrained learner trains over topics, also when a node falls asleep for a while."""

import json
import signal
import time

import numpy as np
import pytest
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.worlds.registry import world_class

ROBOTS = 8


def test_training_goes_on_when_a_monitor_sleeps_and_when_the_simulation_starts_anew(
    nodes, witness, rules_of
):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    from occ_constraints_pkg.ros.qos import STEPS
    from sensor_msgs.msg import PointCloud2

    rules, output = nodes.folder / 'rules.yaml', nodes.folder / 'training'
    rules_of['simple_nav'].save(rules)
    world = world_class('simple_nav')
    parameters = {'world': world.name, 'num_robots': ROBOTS, 'wait_for_subscribers': 4}
    monitor = nodes.start('monitor', constraints_file=rules)
    learner = nodes.start('constrained_learner', output=output, rollout_steps=32)
    sim = nodes.start('sim', **parameters)
    done = {}

    def on_observation(message):
        table = Table.from_message(message)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        done[stamp] = (table.column('terminated') > 0) | (table.column('truncated') > 0)

    witness.node.create_subscription(PointCloud2, 'observation', on_observation, STEPS)
    log = output / 'metrics.jsonl'

    def updates():
        return log.read_text().splitlines() if log.exists() else []

    witness.spin_until(lambda: len(updates()) >= 2, 60.0)
    monitor.send_signal(signal.SIGSTOP)
    asleep = time.monotonic()
    witness.spin_until(lambda: time.monotonic() > asleep + 2.0, 3.0)
    before = len(updates())
    monitor.send_signal(signal.SIGCONT)
    witness.spin_until(lambda: len(updates()) >= before + 2, 30.0)
    # The simulation said its last step again and again; one answer was enough.
    assert witness.heard.duplicates >= 1

    nodes.stop(sim)
    before = len(updates())
    nodes.start('sim', **parameters)
    witness.spin_until(lambda: len(updates()) >= before + 2, 30.0)
    nodes.stop(learner, number=signal.SIGTERM)
    # All that was published has been heard when the last step has come a second time.
    heard = witness.heard.duplicates
    witness.spin_until(lambda: witness.heard.duplicates > heard, 10.0)

    steps = [json.loads(line)['steps'] for line in updates()]
    assert all(first < second for first, second in zip(steps[:-1], steps[1:], strict=True))
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

    learned = PPOLagrangian.load(output / 'checkpoint.pt').steps
    assert learned in possible_steps(done, round(world.step_seconds * 1e9))

    policy = GaussianPolicy.load(output / 'policy.npz')
    policy.check_world(world.columns, world.action_columns)


def possible_steps(done, step_ns):
    """Return how many transitions there were, in all ways that the ends of runs may have gone.

    One transition leaves each state but the last of an episode; the last state of a run is left
    by none, and may itself have come too late for the learner.
    """
    # In the order of arrival: simulated time runs ahead of the time at which the next run starts.
    stamps = np.array(list(done))
    ends = [*(np.flatnonzero(np.diff(stamps) != step_ns) + 1), len(stamps)]
    assert len(ends) == 2
    transitions = [int((~done[stamp]).sum()) for stamp in stamps]
    runs = [transitions[: ends[0]], transitions[ends[0] :]]
    return {sum(runs[0][:-first]) + sum(runs[1][:-second]) for first in (1, 2) for second in (1, 2)}
