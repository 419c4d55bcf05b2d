# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots, played to the monitor message by message, against ``occ check``."""

import os
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.datasets.extraction import extract, rows_of
from occ_constraints_pkg.datasets.reading import read_for_rules
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules import Verdict
from synthetic_bags import ROVER_MAP, write_rover

ROBOTS = Path(os.environ.get('OCC_TEST_DATA', Path(__file__).parents[3] / 'shared/data')) / 'robots'
QUICK = ('bump_neato_zcoakley_fsm',)
REST = sorted(path.name for path in ROBOTS.glob('*/') if path.name not in QUICK)


class LockStep:
    """Plays a recording: the next message goes out when the monitor is done with the one before."""

    def __init__(self, nodes, rules, topics):
        from diagnostic_msgs.msg import DiagnosticArray
        from listener import Listener
        from occ_constraints_pkg.ros.qos import STEPS
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String
        from std_srvs.srv import SetBool

        self.rules = nodes.folder / 'rules.yaml'
        rules.save(self.rules)
        reliable = {
            f'qos_overrides.{topic}.subscription.{key}': value
            for topic in topics
            for key, value in (('reliability', 'reliable'), ('depth', 100))
        }
        # The ages of messages without a stamp are those in the recording, by the recorded time.
        self.monitor = nodes.start(
            'monitor', constraints_file=self.rules, timeout=60.0, use_sim_time=True, **reliable
        )
        nodes.start('event_recorder', store=nodes.folder / 'store')
        self.observer = Listener(nodes.domain)
        self.costs, self.violations, self.told = [], [], []
        node = self.observer.node
        node.create_subscription(String, 'events', self.told.append, STEPS)
        node.create_subscription(PointCloud2, 'costs', self.costs.append, STEPS)
        node.create_subscription(DiagnosticArray, 'violation', self.violations.append, STEPS)
        self.clock = node.create_publisher(Clock, '/clock', STEPS)
        self.done = node.create_client(SetBool, 'monitor/enable')

    def play(self, recording, topics):
        from occ_constraints_pkg.ros.messages import message_class, to_time
        from occ_constraints_pkg.ros.qos import STEPS
        from rosgraph_msgs.msg import Clock
        from std_srvs.srv import SetBool

        observer, node = self.observer, self.observer.node
        publishers = {
            topic: node.create_publisher(
                message_class(recording.topics[topic].msgtype), topic, STEPS
            )
            for topic in topics
        }
        everything = [*publishers.values(), self.clock]
        observer.spin_until(lambda: all(p.get_subscription_count() for p in everything))
        observer.spin_until(lambda: node.count_publishers('events') == 1)
        observer.spin_until(lambda: 'event_recorder' in subscribers_of(node, 'violation'))
        observer.wait_for_monitor(2)
        # Answered, so the monitor has found this client, and we the monitor's topics.
        observer.call(SetBool, 'monitor/enable', data=True)
        observer.spin_until(self.done.service_is_ready)
        for message in recording.messages(topics):
            self.clock.publish(Clock(clock=to_time(message.log_time_ns)))
            publishers[message.topic].publish(message.data)
            # Callbacks run in the order in which their messages came, so whatever this message
            # brings about has been published when the call is answered.
            answer = self.done.call_async(SetBool.Request(data=True))
            observer.spin_until_done(answer)
            assert answer.result().success

    def events(self):
        """Return all events once the last one is over."""
        newest = {}

        def are_over():
            for message in self.told:
                event, _ = Event.from_json(message.data)
                newest[event.id] = event
            self.told.clear()
            is_silent = [
                item for item in newest.values() if item.reason.startswith('no verdict for')
            ]
            return is_silent and all(
                item.ended is not None for item in newest.values() if item not in is_silent
            )

        self.observer.spin_until(are_over)
        return [item for item in newest.values() if not item.reason.startswith('no verdict')]


def subscribers_of(node, topic):
    return [item.node_name for item in node.get_subscriptions_info_by_topic(f'/{topic}')]


@pytest.fixture
def lock_step(nodes):
    made = []

    def make(*arguments):
        made.append(LockStep(nodes, *arguments))
        return made[-1]

    yield make
    for player in made:
        player.observer.__exit__()


def map_of(text):
    return FeatureMap.from_document(parse_yaml(text, 'map'), 'map')


def map_for(bag):
    """Return the rover's map, without gaps where a sector of the bag's scans has never an echo."""
    is_empty = np.isnan(extract([bag], map_of(ROVER_MAP)).values).all(axis=0).any()
    return map_of(ROVER_MAP.replace('drop', 'max_range') if is_empty else ROVER_MAP)


def check(lock_step, bag, feature_map, contamination=0.2):
    """Compare what the monitor says of a recording with what is computed from the file."""
    from occ_constraints_pkg.ros.messages import to_nanoseconds

    recording = Recording(bag)
    rules = learn_from_files(
        [bag],
        feature_map,
        OCTreeSettings(contamination=contamination),
        rng=np.random.default_rng(0),
    )
    topics = [recording.find(topic) for topic in feature_map.topics]
    player = lock_step(rules, topics)
    player.play(recording, topics)

    data = read_for_rules([bag], rules, 'rules', max_lag=1.0)
    rule_set, judgement = rules.rule_set, rules.rule_set.judge(data.values)
    offline = np.stack(
        [judgement.cost, judgement.verdict, judgement.margin, judgement.rule], axis=1
    )

    # A message that came twice is answered twice, and counted once.
    answered = sum(1 for _ in rows_of(recording, FeatureExtractor(feature_map, 1.0)))
    player.observer.spin(10.0, lambda: len(player.costs) >= answered)
    player.observer.spin(10.0, lambda: len(player.violations) >= answered)
    assert len(player.costs) == len(player.violations) == answered
    expected = [
        (stamp, row.tobytes())
        for stamp, row in zip(data.stamps_ns, offline.astype(np.float64), strict=True)
    ]
    place = -1
    for message in player.costs:
        stamp = to_nanoseconds(message.header.stamp)
        answer = stamp, Table.from_message(message).values.tobytes()
        if place + 1 < len(expected) and answer == expected[place + 1]:
            place += 1
        else:
            assert answer == expected[place], f'answer {place} to the message of stamp {stamp}'
    assert place == len(expected) - 1
    # Every violated rule is told by its id, with its own margin.
    samples = dict(zip(expected, zip(judgement.verdict, data.values, strict=True), strict=True))
    for costs, violation in zip(player.costs, player.violations, strict=True):
        stamp = to_nanoseconds(costs.header.stamp)
        assert to_nanoseconds(violation.header.stamp) == stamp
        verdict, sample = samples[stamp, Table.from_message(costs).values.tobytes()]
        told = [{v.key: v.value for v in status.values} for status in violation.status]
        assert told[0]['verdict'] == Verdict(verdict).name
        if verdict == Verdict.UNKNOWN:
            continue
        margins = rule_set.rule_margins(sample)
        assert {item['id']: item['margin'] for item in told[1:]} == {
            rule_set.rules[place].id: repr(float(margins[place]))
            for place in rule_set.violated_rules(sample)
        }
    check_events(player.events(), data, rule_set)
    return judgement, data


def check_events(events, data, rule_set):
    """Compare the recorded events with the intervals of ``occ check``, one for one."""
    line = check_data(data, rule_set)

    def told(interval):
        stamps = data.stamps_ns[interval.samples]
        return int(stamps[0]), int(stamps[-1])

    assert sorted(
        (item.rule, item.stamps.began, item.stamps.last, item.stamps.worst, item.margin)
        for item in events
        if item.kind == 'violation'
    ) == sorted(
        (rule_set.rules[item.rule].id, *told(item), int(data.stamps_ns[item.worst]), item.margin)
        for item in line.violations
    )
    unknown = [item.stamps for item in events if item.kind == 'unknown']
    assert sorted((item.began, item.last) for item in unknown) == sorted(map(told, line.unknown))


@pytest.mark.parametrize(
    'pace',
    [
        '/scan',
        pytest.param('/cmd_vel', marks=pytest.mark.slow),
        pytest.param('{rate: 8}', marks=pytest.mark.slow),
    ],
)
def test_a_made_up_bag(lock_step, tmp_path, pace):
    """Commands carry no stamp: what they set the pace for is stamped with their arrival."""
    bag = write_rover(tmp_path / 'rover')
    text = ROVER_MAP.replace('pace: /scan', f'pace: {pace}')
    judgement, data = check(lock_step, bag, map_of(text))
    if pace == '/scan':
        # One scan came twice.
        assert len(data) == Recording(bag).topics['/scan'].count - 1
        assert set(judgement.verdict) == set(Verdict)
    elif pace == '/cmd_vel':
        assert data.stamps_ns.tolist() == [m.log_time_ns for m in Recording(bag).messages([pace])]
    else:
        assert len(data) == pytest.approx(12 * 8, abs=9)
    assert {Verdict.SAFE, Verdict.UNKNOWN} <= set(judgement.verdict)


@pytest.mark.parametrize('ahead', [0.0, pytest.param(3600.0, marks=pytest.mark.slow)])
def test_a_bag_with_a_backlog(lock_step, tmp_path, ahead):
    bag = write_rover(tmp_path / 'rover', backlog=5.0, ahead=ahead)
    judgement, data = check(lock_step, bag, map_of(ROVER_MAP))
    # From 7 s on, all is logged 5 s later.
    late = data.times_ns > 11 * 10**9
    assert late.sum() > 10
    assert (judgement.verdict[late] == Verdict.UNKNOWN).all()
    assert (judgement.verdict[~late] != Verdict.UNKNOWN).sum() > 10


@pytest.mark.parametrize(
    'name', [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in REST)]
)
def test_a_real_bag(lock_step, name):
    if not (ROBOTS / name).is_dir():
        pytest.skip(f'no test data at {ROBOTS}; set OCC_TEST_DATA')
    judgement, _ = check(lock_step, ROBOTS / name, map_for(ROBOTS / name))
    assert Verdict.SAFE in judgement.verdict
    assert len(set(judgement.verdict)) > 1
