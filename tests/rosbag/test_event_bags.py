# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of events on the disk: whole or not there, within a quota, the pinned ones kept."""

import json
import signal
import subprocess
import sys
import time

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag import event_writer
from occ_constraints_pkg.rosbag.event_bags import CUSTOM_KEY, EventBags, event_bags, event_document
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.ring import Batch, LiveTopic
from ruamel.yaml import YAML

NOW = 1_700_000_000_000_000_000
TOPIC = LiveTopic('/said', 'std_msgs/msg/String', [{'durability': 'volatile'}])
RULES = LiveTopic('/rules', 'std_msgs/msg/String', [{'durability': 'transient_local'}])


def message(number, size=8, topic=TOPIC):
    text = f'{number:08}' + 'x' * (size - 8)
    data = b'\0\1\0\0' + (len(text) + 1).to_bytes(4, 'little') + text.encode() + b'\0'
    return topic, NOW + number * 1_000_000, NOW, data


def batch(first, count=10, size=8):
    return Batch.of(0.0, [message(number, size) for number in range(first, first + count)])


def write(bags, count=20, label='violation_R1', size=8, when=NOW):
    """Write a recording and return what became of it."""
    writer = EventBagWriter(bags)
    path = bags.next_path(when, label)
    writer.begin(path, {'complete': False}, [])
    for first in range(0, count, 10):
        writer.put(batch(first, size=size))
    writer.end({'complete': True, 'reason': '', 'events': [{'id': 'a1'}, {'id': 'a2'}]})
    writer.close()
    (outcome,) = writer.outcomes
    return outcome


def custom(path):
    text = (path / 'metadata.yaml').read_text()
    metadata = YAML(typ='safe').load(text)['rosbag2_bagfile_information']
    return json.loads(metadata['custom_data'][CUSTOM_KEY])


def test_a_recording_has_its_messages_and_says_what_of(tmp_path):
    bags = EventBags(tmp_path / 'bags')
    writer = EventBagWriter(bags)
    path = bags.next_path(NOW, 'violation_R1')
    assert path.name == 'event_000001_2023-11-14T22-13-20Z_violation_R1'
    writer.begin(path, {'complete': False}, [message(3, topic=RULES)])
    writer.put(batch(5))
    writer.end({'complete': True, 'events': [{'id': 'é"\n'}]})
    writer.close()
    assert writer.backlog == 0
    (outcome,) = writer.outcomes
    assert (outcome.path, outcome.problem, outcome.is_kept) == (path, '', True)
    recording = Recording(path)
    found = [(raw.topic, raw.log_time_ns) for raw in recording.messages()]
    assert found == [('/rules', NOW + 3_000_000)] + [
        ('/said', NOW + number * 1_000_000) for number in range(5, 15)
    ]
    assert recording.topics['/rules'].offered_qos[0]['durability'] == 'transient_local'
    expected = {'complete': True, 'events': [{'id': 'é"\n'}], 'messages': 11}
    assert custom(path) == event_document(path) == outcome.document == expected
    # The storage file alone tells it too.
    assert b'serialized_metadata' in (path / f'{path.name}_0.mcap').read_bytes()
    assert CUSTOM_KEY.encode() in (path / f'{path.name}_0.mcap').read_bytes()
    assert [bag.path for bag in event_bags(bags.directory)] == [path]


@pytest.mark.parametrize('label', ['', '../../etc/passwd', 'unknown\nR 7\0', 'x' * 300])
def test_names_are_safe(tmp_path, label):
    bags = EventBags(tmp_path)
    outcome = write(bags, label=label)
    assert outcome.is_kept
    assert outcome.path.parent == tmp_path.resolve()
    assert [bag.path for bag in event_bags(tmp_path)] == [outcome.path]


def test_the_oldest_go_first_and_the_pinned_stay_whatever_the_clock_said(tmp_path):
    first = write(EventBags(tmp_path), size=4000)
    (size,) = (bag.size for bag in event_bags(tmp_path))
    # Three fit, with what is being written.
    quota = 3 * size + size // 2
    paths = [first.path]
    for number in range(4):
        bags = EventBags(tmp_path, quota)
        bags.pinned = {str(first.path)}
        outcome = write(bags, size=4000, when=NOW - number * 10**18)
        assert int(outcome.path.name.split('_')[1]) == number + 2
        paths.append(outcome.path)
        del bags
    left = [bag.path for bag in event_bags(tmp_path)]
    assert left == [paths[0], *paths[-2:]]
    assert sum(bag.size for bag in event_bags(tmp_path)) <= quota
    outcome = write(EventBags(tmp_path, quota), size=4000)
    assert [(one.path, one.events) for one in outcome.removed] == [(first.path, ('a1', 'a2'))]
    assert first.path not in [bag.path for bag in event_bags(tmp_path)]
    assert all(Recording(bag.path).message_count == 20 for bag in event_bags(tmp_path))


def test_nothing_else_is_ever_removed(tmp_path):
    (tmp_path / 'notes.txt').write_text('mine')
    (tmp_path / 'event_000001_mine').mkdir()
    (tmp_path / 'event_000001_mine' / 'metadata.yaml').write_text('mine')
    outside = write(EventBags(tmp_path / 'elsewhere')).path
    (tmp_path / 'event_000002_link').symlink_to(outside)
    outcome = write(EventBags(tmp_path, 1))
    assert not outcome.is_kept
    assert 'quota' in outcome.problem
    assert (tmp_path / 'notes.txt').read_text() == 'mine'
    assert (tmp_path / 'event_000001_mine' / 'metadata.yaml').read_text() == 'mine'
    assert Recording(outside).message_count == 20
    assert event_bags(tmp_path) == []


def test_a_quota_that_pinned_recordings_use_up_ends_the_next_one_early(tmp_path, monkeypatch):
    monkeypatch.setattr(event_writer, '_LOOK_SECONDS', 0.0)
    pinned = write(EventBags(tmp_path), size=4000).path
    quota = event_bags(tmp_path)[0].size + 60_000
    bags = EventBags(tmp_path, quota, compression='none')
    bags.pinned = {str(pinned)}
    # The writer hands its messages over in chunks of 256 KiB.
    outcome = write(bags, count=400, size=4000)
    assert 'pinned' in outcome.problem
    assert not outcome.document['complete']
    assert 0 < outcome.document['messages'] < 400
    assert pinned.is_dir()


def test_a_full_disk_costs_the_recording_and_nothing_else(tmp_path, monkeypatch):
    bags = EventBags(tmp_path, compression='none')
    old = write(bags).path

    def full(*_):
        raise OSError(28, 'No space left on device')

    writer = EventBagWriter(bags)
    writer.begin(bags.next_path(NOW, 'full'), {}, [])
    while writer.backlog:
        time.sleep(0.001)
    with monkeypatch.context() as patch:
        patch.setattr('os.write', full)
        for first in range(0, 1000, 10):
            writer.put(batch(first, size=4000))
        while writer.backlog:
            time.sleep(0.001)
    writer.end({})
    writer.begin(bags.next_path(NOW, 'again'), {}, [])
    writer.put(batch(0))
    writer.end({})
    writer.close()
    failed, fine = writer.outcomes
    assert not failed.is_kept
    assert 'No space left' in failed.problem
    assert fine.is_kept
    assert [bag.path for bag in event_bags(tmp_path)] == [old, fine.path]
    assert list((tmp_path / '.unfinished').iterdir()) == []


WRITE_FOR_EVER = """
import sys
sys.path.insert(0, {tests!r})
from test_event_bags import *
bags = EventBags({folder!r})
number = 0
while True:
    write(bags, count=200, size=2000)
    print(flush=True)
"""


def test_a_killed_recorder_leaves_no_half_recording_that_looks_whole(tmp_path):
    code = WRITE_FOR_EVER.format(tests=str(__file__).rpartition('/')[0], folder=str(tmp_path))
    unfinished = 0
    for delay in (0.002, 0.007, 0.013, 0.023):
        with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            time.sleep(delay)
            process.send_signal(signal.SIGKILL)
        found = event_bags(tmp_path)
        assert found
        for bag in found:
            assert Recording(bag.path).warnings == ()
            assert Recording(bag.path).message_count == 200
            assert custom(bag.path)['complete']
        unfinished = max(unfinished, len(EventBags(tmp_path).interrupted))
    assert unfinished > 0
    # A quota removes them first.
    whole = event_bags(tmp_path)
    bags = EventBags(tmp_path, sum(bag.size for bag in whole))
    removed, has_room = bags.make_room(0)
    assert has_room
    assert len(removed) == unfinished
    assert event_bags(tmp_path) == whole


def test_two_recorders_in_one_directory_and_what_is_no_directory(tmp_path):
    bags = EventBags(tmp_path)
    with pytest.raises(OccError, match='another program is writing'):
        EventBags(bags.directory)
    (tmp_path / 'file').touch()
    with pytest.raises(OccError, match='file'):
        EventBags(tmp_path / 'file')
    assert event_document(tmp_path) == {}
    with pytest.raises(OccError, match='compression'):
        EventBags(tmp_path / 'zip', compression='zip')
    assert not (tmp_path / 'zip').exists()
