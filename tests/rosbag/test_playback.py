# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.playback import Playback
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter

STRING = 'std_msgs/msg/String'
START_NS = 1_700_000_000_000_000_000
# Topic and seconds after the start.
MESSAGES = [('/tf_static', 0.0), ('/a', 0.5), ('/b', 1.0), ('/map', 1.5), ('/a', 2.0), ('/b', 4.0)]
LATCHED = [{'reliability': 'reliable', 'durability': 'transient_local'}]


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'drive'
    with BagWriter(path) as bag:
        for number, (topic, seconds) in enumerate(MESSAGES):
            qos = LATCHED if topic == '/map' else []
            data = b'\0\1\0\0' + number.to_bytes(4, 'little')
            bag.write(topic, STRING, data, START_NS + round(seconds * 1e9), qos=qos)
    return Recording(path)


def numbers(messages):
    return [int.from_bytes(message.data[4:], 'little') for message in messages]


def playing(recording, topics=None, **settings):
    return Playback(recording, topics or list(recording.topics), **settings)


def test_keeps_the_recorded_spacing_scaled(recording):
    playback = playing(recording, rate=2.0)
    assert numbers(playback.due(7.0)) == []
    playback.resume(10.0)
    assert numbers(playback.due(10.0)) == [0]
    assert numbers(playback.due(10.5)) == [1, 2]
    assert playback.time_ns(10.5) == START_NS + 10**9
    assert not playback.is_over
    assert numbers(playback.due(12.0)) == [3, 4, 5]
    assert playback.is_over


def test_time_stands_still_while_paused(recording):
    playback = playing(recording)
    assert playback.is_paused
    playback.resume(0.0)
    playback.pause(0.75)
    playback.pause(50.0)
    assert playback.is_paused
    assert playback.time_ns(99.0) == START_NS + 750_000_000
    assert numbers(playback.due(99.0)) == []
    playback.resume(100.0)
    playback.resume(100.25)
    assert numbers(playback.due(100.25)) == [0, 1, 2]


def test_what_was_latched_before_the_start_still_holds(recording):
    playback = playing(recording, start_offset=1.75)
    playback.resume(0.0)
    assert numbers(playback.due(0.0)) == [0, 3]
    assert numbers(playback.due(0.25)) == [4]
    assert playback.time_ns(0.25) == START_NS + 2 * 10**9


def test_the_start_is_that_of_the_recording_and_not_of_the_topics(recording):
    playback = playing(recording, ['/b'])
    playback.resume(0.0)
    assert numbers(playback.due(0.9)) == []
    assert numbers(playback.due(1.0)) == [2]


def test_begins_again_at_the_end(recording):
    playback = playing(recording, ['/a', '/b'], loop=True, start_offset=1.75)
    playback.resume(0.0)
    assert numbers(playback.due(2.25)) == [4, 5]
    assert numbers(playback.due(2.5)) == [4]
    assert numbers(playback.due(4.5)) == [5]
    assert not playback.is_over


@given(st.lists(st.floats(0.0, 1.0), max_size=30), st.integers(1, 4))
def test_each_message_comes_once_and_in_order_however_time_goes(recording, steps, burst):
    playback, now, seen = playing(recording), 5.0, []
    playback.resume(now)
    for step in steps:
        now += step
        seen += islice(playback.due(now), burst)
    assert numbers(seen) == list(range(len(seen)))
    playback.resume(now)
    seen += playback.due(now + 10.0)
    assert numbers(seen) == list(range(len(MESSAGES)))


def test_refuses_to_start_after_the_end(recording):
    with pytest.raises(OccError, match='no message to play from 4.5 s after its start on'):
        playing(recording, start_offset=4.5)
    with pytest.raises(OccError, match='no message to play'):
        playing(recording, ['/a'], start_offset=3.0)
