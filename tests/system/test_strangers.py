# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a training whose topics others use as well, or a simulation of another kind."""

import json
import signal

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.worlds.registry import world_class

ROBOTS = 4
WORLD = world_class('simple_nav')
ACTION = tuple(column.name for column in WORLD.action_columns)
STEP_NS = round(WORLD.step_seconds * 1e9)


class Stage:
    """Simulation, monitor and whoever else acts, all played by the observer.

    Attributes:
        answers: the stamp of each step that was answered to the columns of the answer.
    """

    def __init__(self, observer) -> None:
        from occ_constraints_pkg.ros.qos import STEPS
        from sensor_msgs.msg import PointCloud2

        self._observer, self._kind, self._qos = observer, PointCloud2, STEPS
        self._observation, self._costs = map(self.publisher, ('observation', 'costs'))
        self.answers = {}
        observer.node.create_subscription(PointCloud2, 'action', self._on_action, STEPS)

    def publisher(self, topic):
        return self._observer.node.create_publisher(self._kind, topic, self._qos)

    def say(self, stamp, kind=WORLD, world=WORLD.name, rules='rules') -> bool:
        """Show a step, and what it costs; return whether it has been answered before."""
        from occ_constraints_pkg.nodes.lockstep import observation_table
        from occ_constraints_pkg.nodes.monitor.outputs import COST_COLUMNS
        from occ_constraints_pkg.ros.tables import table_bytes
        from occ_constraints_pkg.worlds.stream import StepBatch

        none, never = np.zeros(ROBOTS), np.zeros(ROBOTS, dtype=bool)
        seen = np.zeros((ROBOTS, len(kind.columns)))
        batch = StepBatch(seen, none, never, never, none, none)
        table = observation_table(kind.columns, batch)
        self._observation.publish(table_bytes(table, stamp, world))
        costs = Table(COST_COLUMNS, np.zeros((ROBOTS, len(COST_COLUMNS))))
        self._costs.publish(table_bytes(costs, stamp, rules))
        return stamp in self.answers

    def wait_for_answer(self, stamp, **options) -> None:
        self._observer.spin_until(lambda: self.say(stamp, **options))

    def _on_action(self, message) -> None:
        from occ_constraints_pkg.ros.messages import to_nanoseconds

        names = Table.from_message(message).names
        self.answers[to_nanoseconds(message.header.stamp)] = names


@pytest.fixture
def stage(observer):
    return Stage(observer)


@pytest.fixture
def start_learner(nodes):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    output = nodes.folder / 'training'
    return lambda: nodes.start('constrained_learner', output=output, rollout_steps=2), output


def test_nothing_is_learned_from_a_step_that_another_node_answered_too(
    nodes, observer, stage, start_learner
):
    from occ_constraints_pkg.ros.tables import table_bytes

    start, output = start_learner
    learner = start()
    stage.wait_for_answer(0)
    rival = stage.publisher('action')
    other = table_bytes(Table(ACTION, np.full((ROBOTS, len(ACTION)), 0.5, np.float32)), 0, '')

    def waits():
        stage.say(0)
        rival.publish(other)
        return 'another node publishes other actions on /action' in learner.log.read_text()

    # The observer itself listens, too.
    observer.spin_until(lambda: rival.get_subscription_count() == 2)
    observer.spin_until(waits)
    observer.node.destroy_publisher(rival)
    # Whose action led there is not known.
    stage.wait_for_answer(STEP_NS)
    stage.wait_for_answer(2 * STEP_NS)
    observer.spin_until((output / 'metrics.jsonl').exists)
    nodes.stop(learner, number=signal.SIGTERM)
    first = json.loads((output / 'metrics.jsonl').read_text().splitlines()[0])
    assert first['steps'] == ROBOTS


def test_a_second_simulation_other_rules_and_another_world_are_told(
    nodes, observer, stage, start_learner
):
    start, _ = start_learner
    learner = start()
    for stamp in (0, STEP_NS, 1_000_000_000, 2 * STEP_NS):
        stage.wait_for_answer(stamp)
    observer.spin_until(
        lambda: 'two simulations take turns on /observation' in learner.log.read_text()
    )

    stage.wait_for_answer(3 * STEP_NS, rules='others')
    observer.spin_until(
        lambda: 'now those of rule set others, before of rules' in learner.log.read_text()
    )

    # Like the highways, of which one has a part of the other's scenarios, it has the same columns.
    def has_ended():
        stage.say(4 * STEP_NS, world='other')
        return not learner.is_running

    observer.spin_until(has_ended)
    assert learner.exit_code == 2
    assert 'is one of simple_nav, and the simulation is other' in learner.last_words()
    assert 4 * STEP_NS not in stage.answers
    nodes.started.remove(learner)


def test_a_driver_takes_up_another_world(nodes, stage):
    other = world_class('highway')
    nodes.start('policy')
    stage.wait_for_answer(0)
    stage.wait_for_answer(1, kind=other, world=other.name)
    assert stage.answers[0] == ACTION
    assert stage.answers[1] == tuple(column.name for column in other.action_columns)


@pytest.mark.parametrize('rate', [0.0, 20.0])
def test_an_action_that_cannot_be_taken_is_ignored(nodes, observer, stage, rate):
    from occ_constraints_pkg.ros.tables import table_bytes

    action = stage.publisher('action')
    sim = nodes.start('sim', world=WORLD.name, num_robots=2, rate=rate, repeat_after=0.1)

    def act(values):
        stamp = max(observer.heard.true_cost, default=0)
        table = Table(ACTION, np.asarray(values, dtype=np.float32))
        action.publish(table_bytes(table, stamp, ''))

    def is_told(words, values):
        act(values)
        return f'action ignored: an action {words}' in sim.log.read_text()

    good = np.zeros((2, len(ACTION)))
    observer.spin_until(lambda: is_told('holds nan', good * np.nan))
    observer.spin_until(lambda: is_told('has shape', np.zeros((3, len(ACTION)))))
    # None of them was a step.
    assert len(observer.heard.true_cost) == 1
    observer.spin_until(lambda: act(good) or len(observer.heard.true_cost) > 1)
