# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The constrained learner trains over topics, also when a node falls asleep for a while."""

import json
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules import FeatureSpace
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.worlds.registry import world_class

ROBOTS = 8


def test_training_goes_on_when_a_monitor_sleeps_and_when_the_simulation_starts_anew(
    nodes, observer, rules_of
):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    from listener import Listener
    from occ_constraints_pkg.demo.observer import ALL
    from occ_constraints_pkg.ros.messages import to_nanoseconds
    from sensor_msgs.msg import PointCloud2

    rules, output = nodes.folder / 'rules.yaml', nodes.folder / 'training'
    rules_of['simple_nav'].save(rules)
    world = world_class('simple_nav')
    # The simulation keeps what this process has not taken yet, however little time it gets.
    parameters = {
        'world': world.name,
        'num_robots': ROBOTS,
        'wait_for_subscribers': 4,
        'qos_overrides./observation.publisher.depth': ALL.depth,
    }
    monitor = nodes.start('monitor', constraints_file=rules)
    learner = nodes.start('constrained_learner', output=output, rollout_steps=32)
    sim = nodes.start('sim', **parameters)
    done = {}

    def on_observation(message):
        table = Table.from_message(message)
        stamp = to_nanoseconds(message.header.stamp)
        done[stamp] = (table.column('terminated') > 0) | (table.column('truncated') > 0)

    observer.node.create_subscription(PointCloud2, 'observation', on_observation, ALL)
    log = output / 'metrics.jsonl'

    def updates():
        return log.read_text().splitlines() if log.exists() else []

    def hear_all():
        """Listen until all has been heard; the simulation must be repeating its last step.

        A listener that comes now hears nothing but that. Messages come in order, so whoever has
        heard it as well has heard all before.
        """
        with Listener(nodes.domain) as late:
            late.spin_until(lambda: late.heard.true_cost)
            last = next(iter(late.heard.true_cost))
        observer.spin_until(lambda: last in done)

    observer.spin_until(lambda: len(updates()) >= 2)
    monitor.send_signal(signal.SIGSTOP)
    asleep = time.monotonic()
    observer.spin_until(lambda: time.monotonic() > asleep + 2.0)
    before = len(updates())
    monitor.send_signal(signal.SIGCONT)
    observer.spin_until(lambda: len(updates()) >= before + 2)
    # The simulation said its last step again and again; one answer was enough.
    assert observer.heard.duplicates >= 1

    # Of a simulation that ends in mid-step, the last messages may never come.
    monitor.send_signal(signal.SIGSTOP)
    hear_all()
    nodes.stop(sim)
    monitor.send_signal(signal.SIGCONT)
    before = len(updates())
    nodes.start('sim', **parameters)
    observer.spin_until(lambda: len(updates()) >= before + 2)
    nodes.stop(learner, number=signal.SIGTERM)
    hear_all()

    steps = [json.loads(line)['steps'] for line in updates()]
    assert all(first < second for first, second in zip(steps[:-1], steps[1:], strict=True))
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian

    learned = PPOLagrangian.load(output / 'checkpoint.pt').steps
    assert learned in possible_steps(done, round(world.step_seconds * 1e9))

    policy = GaussianPolicy.load(output / 'policy.npz')
    policy.check_world(world.columns, world.action_columns)


@pytest.mark.slow
def test_training_survives_the_death_of_any_node(nodes, observer, rules_of):
    """Each is killed with SIGKILL and started again; the learner goes on from its checkpoint."""
    pytest.importorskip('torch', reason="needs the extra 'train'")
    from occ_constraints_pkg.agents.training import read_metrics

    rules, output, kept = (nodes.folder / name for name in ('rules.yaml', 'training', 'n.json'))
    rules_of['simple_nav'].save(rules)
    parameters = {
        'monitor': {'constraints_file': rules, 'counts_file': kept},
        'constrained_learner': {'output': output, 'rollout_steps': 32, 'resume': True},
        'sim': {'world': 'simple_nav', 'num_robots': ROBOTS, 'wait_for_subscribers': 3},
    }
    running = {name: nodes.start(name, **given) for name, given in parameters.items()}

    def updates():
        return [line['updates'] for line in read_metrics(output / 'metrics.jsonl')]

    def kill(name):
        running[name].send_signal(signal.SIGKILL)
        running[name].join()

    observer.spin_until(lambda: len(updates()) >= 2 and kept.exists())
    learner = running['constrained_learner']

    kill('monitor')
    observer.spin_until(lambda: 'there is no monitor' in learner.log.read_text())
    before = len(updates())
    running['monitor'] = nodes.start('monitor', **parameters['monitor'])
    observer.spin_until(lambda: len(updates()) >= before + 2)
    assert 'counters go on from' in running['monitor'].log.read_text()

    kill('sim')
    observer.spin_until(lambda: 'there is no simulation' in learner.log.read_text())
    before = len(updates())
    running['sim'] = nodes.start('sim', **parameters['sim'])
    observer.spin_until(lambda: len(updates()) >= before + 2)
    assert 'the simulation has started anew' in learner.log.read_text()

    kill('constrained_learner')
    before = updates()[-1]
    # Without a learner the simulation repeats itself, and nothing is counted again.
    repeats = observer.heard.duplicates
    observer.spin_until(lambda: observer.heard.duplicates >= repeats + 2)
    learner = nodes.start('constrained_learner', **parameters['constrained_learner'])
    observer.spin_until(lambda: updates()[-1] >= before + 2)
    text = learner.log.read_text()
    assert 'training on simple_nav goes on from' in text
    assert 'episodes up to here do not count in the means' in text
    nodes.stop(learner, running['sim'])
    nodes.stop(running['monitor'])

    history = read_metrics(output / 'metrics.jsonl')
    assert [line['updates'] for line in history] == list(range(1, len(history) + 1))
    steps = np.diff([line['steps'] for line in history])
    assert (steps > 0).all()
    assert (steps <= 32 * ROBOTS).all()
    # Every state was counted once at most; the last rule tried is reached by the safe ones.
    counts = json.loads(kept.read_text())['rules'].values()
    first = max(item['evaluated'] for item in counts)
    judged = len(observer.heard.costs) * ROBOTS
    assert steps.sum() / 2 < first <= judged
    # The counters of the whole training decide which rules go.
    pruned = nodes.folder / 'pruned.yaml'
    line = ['prune', str(rules), '--counts', str(kept), '--threshold', '0.001', '-o', str(pruned)]
    assert main(line) == 0
    assert max(rule.evaluated for rule in load_constraints(pruned).rule_set.rules) == first


def test_the_learner_waits_for_a_monitor_that_knows(nodes, observer, rules_of):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    rules, output = nodes.folder / 'rules.yaml', nodes.folder / 'training'
    rules_of['simple_nav'].save(rules)
    unknowing = rules_of['simple_nav']
    space = unknowing.rule_set.space
    narrow = FeatureSpace(tuple(replace(f, low=5.0, high=6.0) for f in space.features))
    unknowing = replace(unknowing, rule_set=replace(unknowing.rule_set, space=narrow))
    unknowing.save(nodes.folder / 'unknowing.yaml')
    learner = nodes.start('constrained_learner', output=output, rollout_steps=8)
    nodes.start('sim', world='simple_nav', num_robots=ROBOTS, wait_for_subscribers=1)

    def says(words):
        return lambda: words in learner.log.read_text()

    observer.spin_until(says('there is no monitor'))
    monitor = nodes.start('monitor', constraints_file=nodes.folder / 'unknowing.yaml')
    observer.spin_until(says('the monitor reports UNKNOWN for every robot'))
    # Not one action was given.
    assert len(observer.heard.true_cost) == 1
    nodes.stop(monitor)
    nodes.start('monitor', constraints_file=rules)
    observer.spin_until((output / 'metrics.jsonl').exists)
    assert says('training goes on after')()


@pytest.fixture
def words_of_refusal(make_nodes, rules_of):
    """Return a function that starts a training which must end at once, and returns its words.

    The training's directory is ``output`` of the function, and is there before.
    """
    pytest.importorskip('torch', reason="needs the extra 'train'")
    from listener import Listener

    nodes = make_nodes()
    output, rules = nodes.folder / 'training', nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    output.mkdir()

    def words(**parameters):
        learner = nodes.start('constrained_learner', output=output, rollout_steps=32, **parameters)
        nodes.start('monitor', constraints_file=rules)
        nodes.start('sim', world='simple_nav', num_robots=ROBOTS, wait_for_subscribers=2)
        with Listener(nodes.domain) as observer:
            observer.spin_until(lambda: not learner.is_running)
        assert learner.exit_code == 2
        return learner.last_words()

    words.output = output
    return words


def test_fewer_steps_than_one_update_needs_are_refused(words_of_refusal):
    output = words_of_refusal.output
    (output / 'metrics.jsonl').touch()
    assert words_of_refusal(total_steps=32 * ROBOTS - 1) == (
        f'error: total_steps is {32 * ROBOTS - 1}, which ends a training before its first update; '
        f'allowed is {32 * ROBOTS} or more: rollout_steps 32 x robots {ROBOTS}'
    )
    # The training that was there has not been moved aside.
    assert [path.name for path in output.parent.glob('training*')] == ['training']
    assert [path.name for path in output.iterdir()] == ['metrics.jsonl']


def test_a_training_of_another_world_is_not_resumed(words_of_refusal):
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
    from occ_constraints_pkg.agents.settings import PPOLagrangianConfig

    output, world = words_of_refusal.output, world_class('simple_nav')
    config = PPOLagrangianConfig(rollout_steps=32)
    other = PPOLagrangian(config, world.columns, world.action_columns, 'other', seed=0)
    other.save(
        output / 'checkpoint.pt', settings={'cost_limit': config.cost_limit, 'rollout_steps': 32}
    )
    assert words_of_refusal(resume=True) == (
        f'error: the training in {output} is one of other, and the simulation is simple_nav; '
        'allowed is that of the training'
    )


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
