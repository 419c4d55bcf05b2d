# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recorder and player as users drive them: patterns, split bags, pauses, the clock."""

import time

from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

STRING = 'std_msgs/msg/String'
START_NS = 1_700_000_000_000_000_000
LATCHED_OFFER = [{'reliability': 'reliable', 'durability': 'transient_local'}]


def test_topics_by_pattern_are_recorded_as_offered_in_split_files(nodes, observer):
    from occ_constraints_pkg.ros.qos import LATCHED, SENSORS, STEPS
    from std_msgs.msg import String

    bag, node = nodes.folder / 'bag', observer.node
    latched = node.create_publisher(String, '/map_static', LATCHED)
    latched.publish(String(data='before the recorder'))
    steady = node.create_publisher(String, '/chat', STEPS)
    modest = node.create_publisher(String, '/left/chat', SENSORS)
    secret = node.create_publisher(String, '/secret/chat', STEPS)
    recorder = nodes.start(
        'recorder',
        output=bag,
        topics=['map_static'],
        regex='chat$',
        exclude_topics=['/secret/chat'],
        max_bag_duration=0.3,
    )
    # The recorder was told of all of them at once, so it would have come for the secret one too.
    for publisher in (latched, steady, modest):
        observer.spin_until(lambda p=publisher: p.get_subscription_count() == 1)
    sent = 0

    def files():
        nonlocal sent
        for publisher in (steady, modest, secret):
            publisher.publish(String(data=str(sent)))
        sent += 1
        return len(list(bag.glob('*.mcap')))

    observer.spin_until(lambda: files() >= 4)
    assert secret.get_subscription_count() == 0
    steady.publish(String(data='last'))
    # It has come when it can be read, as the file is flushed twice a second.
    observer.spin_until(lambda: texts(bag, '/chat')[-1:] == ['last'])
    nodes.stop(recorder)

    assert texts(bag, '/map_static') == ['before the recorder']
    assert texts(bag, '/chat')[-2:] == [str(sent - 1), 'last']
    info = YAML(typ='safe').load(bag / 'metadata.yaml')['rosbag2_bagfile_information']
    entries = [item['topic_metadata'] for item in info['topics_with_message_count']]
    offered = {
        item['name']: [(o['reliability'], o['durability']) for o in item['offered_qos_profiles']]
        for item in entries
    }
    assert offered == {
        '/map_static': [('reliable', 'transient_local')],
        '/chat': [('reliable', 'volatile')],
        '/left/chat': [('best_effort', 'volatile')],
    }
    assert len(info['files']) == len(list(bag.glob('*.mcap'))) >= 4
    with AnyReader([bag]) as reader:
        assert sum(1 for _ in reader.messages()) == info['message_count']


def test_the_player_pauses_starts_late_and_tells_the_time(nodes, observer):
    from occ_constraints_pkg.ros.messages import to_nanoseconds
    from occ_constraints_pkg.ros.qos import STEPS
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    bag = nodes.folder / 'bag'
    with BagWriter(bag) as writer:
        writer.write('/map', STRING, string('map'), START_NS, qos=LATCHED_OFFER)
        for tick in range(600):
            writer.write('/tick', STRING, string(str(tick)), START_NS + tick * 10**8)
        writer.write('/clock', 'rosgraph_msgs/msg/Clock', b'\0\1\0\0' + bytes(8), START_NS)
    times, ticks, maps = [], [], []
    node = observer.node
    for kind, topic, callback in (
        (Clock, '/clock', lambda message: times.append(to_nanoseconds(message.clock))),
        (String, '/tick', lambda message: ticks.append(int(message.data))),
    ):
        node.create_subscription(kind, topic, callback, STEPS)
    deep = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, '/map', lambda message: maps.append(message.data), deep)
    nodes.start(
        'player', bag=bag, start_paused=True, start_offset=20.0, clock=100.0, wait_for_subscribers=2
    )
    # Time is told, and stands still.
    observer.spin_until(lambda: len(times) > 20)
    assert set(times) == {START_NS + 20 * 10**9}
    assert ticks == maps == []

    assert observer.call(Trigger, 'player/resume').success
    observer.spin_until(lambda: len(ticks) > 3 and maps)
    assert maps == ['map']
    assert observer.call(Trigger, 'player/pause').message == 'paused'
    # What was under way has come when time has been told to stand still for a while.
    observer.spin_until(lambda: len(times) > 20 and len(set(times[-20:])) == 1)
    paused_at, stood = ticks[-1], times[-1]
    assert ticks == list(range(200, paused_at + 1))
    assert START_NS + paused_at * 10**8 <= stood
    count = len(times)
    observer.spin_until(lambda: len(times) > count + 20)
    assert (ticks[-1], times[-1]) == (paused_at, stood)

    began = time.monotonic()
    # A repeated request would toggle twice, so what came of it is looked at.
    observer.call(Trigger, 'player/toggle_paused')
    observer.call(Trigger, 'player/resume')
    observer.spin_until(lambda: len(ticks) > paused_at - 200 + 4)
    assert ticks == list(range(200, ticks[-1] + 1))
    assert times == sorted(times)
    assert times[-1] - stood <= (time.monotonic() - began) * 1e9


def string(text):
    data = text.encode() + b'\0'
    return b'\0\1\0\0' + len(data).to_bytes(4, 'little') + data


def texts(bag, topic):
    """Return what has reached the files so far."""
    recording = Recording(bag)
    if topic not in recording.topics:
        return []
    return [recording.decode(message).data for message in recording.messages([topic])]
