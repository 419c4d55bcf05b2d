# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Simulation, policy, monitor and recorder run; an observer and the bag show what they did."""

import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

TOPICS = ('observation', 'action', 'costs', 'cost', 'violation')
# World, driver, robots, observations at least.
RUNS = {'simple_nav': ('straight', 3, 60), 'PointGoal1': ('straightv', 2, 60)}


@dataclass
class Run:
    """What is left of a run."""

    constraints: Constraints
    robots: int
    heard: object
    bag: Path


@pytest.fixture(scope='module', params=RUNS)
def run(request, make_nodes, rules_of, let_go):
    from listener import Listener

    world = request.param
    driver, robots, least = RUNS[world]
    nodes = make_nodes()
    rules, bag = nodes.folder / 'rules.yaml', nodes.folder / 'bag'
    rules_of[world].save(rules)
    # The first input may take a while; until then nothing shall be called stale.
    nodes.start('monitor', constraints_file=rules, timeout=30.0)
    nodes.start('recorder', output=bag, topics=list(TOPICS))
    policy = nodes.start('policy', policy=driver, wait_for_costs=True)
    nodes.start('sim', world=world, num_robots=robots, wait_for_subscribers=5)
    with Listener(nodes.domain) as observer:
        heard = observer.heard
        observer.wait_for_monitor(2)
        let_go(observer)
        observer.spin_until(lambda: len(heard.true_cost) >= least)
        # Without the policy the simulation repeats its last step, which is answered in the end.
        nodes.stop(policy, number=signal.SIGTERM)
        observer.spin_until(lambda: heard.duplicates >= 2)
        nodes.stop()
        observer.spin_until(lambda: len(heard.violations) == len(heard.costs))
    return Run(rules_of[world], robots, heard, bag)


def test_each_observation_is_answered_on_every_topic_with_its_stamp(run):
    heard = run.heard
    assert heard.true_cost.keys() == heard.costs.keys() == heard.violations.keys()
    assert heard.cost_messages == len(heard.costs) + heard.duplicates
    for table in heard.costs.values():
        assert table.names == ('cost', 'verdict', 'margin', 'rule')
        assert table.values.shape == (run.robots, 4)
        assert table.values.dtype == np.float64
        unsafe = table.column('verdict') != Verdict.SAFE
        np.testing.assert_array_equal(table.column('cost'), unsafe)


def test_a_violation_names_rule_text_values_and_margin(run):
    rule_set = run.constraints.rule_set
    rules = {rule.id: rule for rule in rule_set.rules}
    told = 0
    for stamp, message in run.heard.violations.items():
        table = run.heard.costs[stamp]
        flagged = set(np.flatnonzero(table.column('cost')))
        described = {status.hardware_id for status in message.status}
        assert described == {f'robot {robot}' for robot in flagged or {0}}
        for status in message.status[1:] if flagged else ():
            values = {item.key: item.value for item in status.values}
            if 'id' not in values:
                continue
            told += 1
            rule = rules[values['id']]
            assert status.level == b'\x02'
            assert values['text'] == rule.words(rule_set.space)
            assert values['formula'] == rule.formula(rule_set.space)
            assert float(values['margin']) <= 0.0
            # Of a family, the members that make the rule true are told; the last words name one.
            sample = np.zeros(len(rule_set.space))
            for feature, name in enumerate(rule_set.space.names):
                sample[feature] = float(values.get(name, 0.0))
            assert {rule_set.space.names[feature] for feature in rule.fired(sample)} <= set(values)
            assert status.message == rule.words(rule_set.space, sample)
            assert rules[values['id']] in [
                rule_set.rules[index] for index in rule_set.violated_rules(sample)
            ]
    assert told > 0


def test_the_bag_opens_with_other_readers(run):
    document = YAML(typ='safe').load(run.bag / 'metadata.yaml')['rosbag2_bagfile_information']
    assert document['version'] == 9
    assert document['storage_identifier'] == 'mcap'
    with AnyReader([run.bag]) as reader:
        counts = {item.topic: item.msgcount for item in reader.connections}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    with next(run.bag.glob('*.mcap')).open('rb') as file:
        summary = make_reader(file).get_summary()
    assert sum(summary.statistics.channel_message_counts.values()) == sum(counts.values())
    assert set(counts) == {f'/{topic}' for topic in TOPICS}
    assert document['message_count'] == sum(counts.values())


def test_the_bag_has_all_that_an_observer_heard(run):
    assert list(stamped(run.bag, '/observation')) == sorted(run.heard.true_cost)
    recorded = stamped(run.bag, '/costs')
    assert recorded.keys() == run.heard.costs.keys()
    for stamp, table in recorded.items():
        assert table.values.tobytes() == run.heard.costs[stamp].values.tobytes()


def test_offline_equals_online_bit_for_bit(run):
    feature_map = FeatureMap.from_document(run.constraints.feature_map, 'rules')
    data = extract([run.bag], feature_map)
    judgement = run.constraints.rule_set.judge(data.values)
    recorded = stamped(run.bag, '/costs')
    np.testing.assert_array_equal(data.stamps_ns, np.repeat(list(recorded), run.robots))
    offline = np.stack(
        [judgement.cost, judgement.verdict, judgement.margin, judgement.rule], axis=1
    )
    online = np.concatenate([table.values for table in recorded.values()])
    assert offline.astype(np.float64).tobytes() == online.tobytes()
    assert {0.0, 1.0} <= set(online[:, 1])


def test_playback_is_byte_identical(run, nodes):
    second = nodes.folder / 'second'
    recorder = nodes.start('recorder', output=second, topics=list(TOPICS))
    player = nodes.start('player', bag=run.bag, rate=20.0, wait_for_subscribers=len(TOPICS))
    player.wait(40.0)
    nodes.stop(recorder)
    assert raw(second) == raw(run.bag)


def test_a_killed_recorder_leaves_a_readable_bag(nodes, observer):
    bag = nodes.folder / 'bag'
    recorder = nodes.start('recorder', output=bag, topics=['observation', 'action'])
    nodes.start('policy', policy='random')
    # Slow enough for everybody to keep pace.
    nodes.start('sim', world='simple_nav', num_robots=4, rate=100, wait_for_subscribers=3)
    heard = observer.heard.true_cost
    observer.spin_until(lambda: len(heard) > 0)

    # The recorder writes as it goes: what is in the file before the kill is in it afterwards.
    def written() -> int:
        return sum(file.stat().st_size for file in bag.glob('*.mcap'))

    observer.spin_until(lambda: written() > 50_000)
    flushed = len(stamped(bag, '/observation'))
    assert flushed > 0
    recorder.send_signal(signal.SIGKILL)
    recorder.join()
    assert Recording(bag).warnings
    stamps = list(stamped(bag, '/observation'))
    assert len(stamps) >= flushed
    # The recorder may have been ahead of this listener.
    observer.spin_until(lambda: heard.keys() >= set(stamps))
    assert stamps == sorted(heard)[: len(stamps)]


def stamped(bag: Path, topic: str) -> dict[int, Table]:
    """Return the first table of each stamp, in recorded order."""
    recording, tables = Recording(bag), {}
    for message in recording.messages([topic]):
        cloud = recording.decode(message)
        stamp = cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec
        tables.setdefault(stamp, Table.from_message(cloud))
    return tables


def raw(bag: Path) -> dict[str, list[bytes]]:
    """Return the serialized messages of each topic, in order."""
    recording = Recording(bag)
    return {
        topic: [bytes(message.data) for message in recording.messages([topic])]
        for topic in recording.topics
    }
