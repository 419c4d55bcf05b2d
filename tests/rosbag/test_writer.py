# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import logging
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.metadata import dump_plain
from occ_constraints_pkg.rosbag.qos import parse_profiles
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

FOREVER = {'sec': 9223372036, 'nsec': 854775807}
QOS = {
    'history': 'keep_last',
    'depth': 1,
    'reliability': 'reliable',
    'durability': 'transient_local',
    'deadline': FOREVER,
    'lifespan': FOREVER,
    'liveliness': 'automatic',
    'liveliness_lease_duration': FOREVER,
    'avoid_ros_namespace_conventions': False,
}
STRING = 'std_msgs/msg/String'


def string(text):
    data = text.encode() + b'\0'
    return b'\0\1\0\0' + len(data).to_bytes(4, 'little') + data


def information(bag):
    return YAML(typ='safe').load(bag / 'metadata.yaml')['rosbag2_bagfile_information']


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_opens_everywhere_with_the_same_bytes(tmp_path, compression):
    sent = [(f'/t{i % 3}', STRING, string('x' * (i % 700)), 10**9 + i) for i in range(3000)]
    with BagWriter(tmp_path / 'run', compression=compression) as bag:
        for entry in sent:
            bag.write(*entry, publish_time_ns=5, qos=[QOS])
        assert bag.message_count == 3000
    with AnyReader([tmp_path / 'run']) as reader:
        seen = [(c.topic, c.msgtype, bytes(data), t) for c, t, data in reader.messages()]
        assert reader.deserialize(seen[2][2], STRING).data == 'xx'
        assert reader.connections[0].ext.offered_qos_profiles[0].durability.name == (
            'TRANSIENT_LOCAL'
        )
    assert seen == sent
    with (tmp_path / 'run' / 'run_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert [message.data for _, _, message in reader.iter_messages()] == [s[2] for s in sent]
        assert reader.get_header().profile == 'ros2'
        assert {schema.encoding for schema in reader.get_summary().schemas.values()} == {'ros2msg'}
        assert next(reader.iter_messages())[2].publish_time == 5
        assert [record.name for record in reader.iter_metadata()] == ['rosbag2']
    recording = Recording(tmp_path / 'run')
    assert [(m.topic, m.msgtype, m.data, m.log_time_ns) for m in recording.messages()] == sent
    assert recording.topics['/t0'].offered_qos == (QOS,)


def test_metadata_is_version_9(tmp_path):
    with BagWriter(tmp_path / 'run') as bag:
        assert information(tmp_path / 'run')['message_count'] == 0
        bag.write('/a', STRING, string('a'), 7, qos=[QOS])
        # A killed recorder would leave this: with a flush after the first messages, unless the
        # metadata was written just before.
        end = time.monotonic() + 10.0
        while information(tmp_path / 'run')['message_count'] != 1:
            assert time.monotonic() < end
            bag.flush()
        bag.write('/b', STRING, string('b'), 3)
    info = information(tmp_path / 'run')
    assert (info['version'], info['storage_identifier']) == (9, 'mcap')
    assert info['relative_file_paths'] == ['run_0.mcap']
    assert info['starting_time']['nanoseconds_since_epoch'] == 3
    assert info['duration']['nanoseconds'] == 4
    assert [entry['message_count'] for entry in info['topics_with_message_count']] == [1, 1]
    topic = info['topics_with_message_count'][0]['topic_metadata']
    assert topic['offered_qos_profiles'] == [QOS]
    assert topic['type_description_hash'].startswith('RIHS01_')


def test_a_bag_without_messages_is_finished_too(tmp_path):
    BagWriter(tmp_path / 'run').close()
    with (tmp_path / 'run' / 'run_0.mcap').open('rb') as file:
        assert list(make_reader(file).iter_messages()) == []
    with pytest.raises(OccError, match='holds no messages'):
        Recording(tmp_path / 'run')


def test_a_type_is_looked_up_where_packages_are_installed(tmp_path, monkeypatch):
    folder = tmp_path / 'share' / 'lab_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'Arm.msg').write_text('Joint[] joints\ngeometry_msgs/Point tip\n')
    (folder / 'Joint.msg').write_text('float64 angle\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere{os.pathsep}{tmp_path}')
    data = b'\0\1\0\0' + (1).to_bytes(4, 'little') + bytes(4 + 8 + 24)
    with BagWriter(tmp_path / 'run') as bag:
        bag.write('/arm', 'lab_msgs/msg/Arm', data, 1)
    recording = Recording(tmp_path / 'run')
    message = recording.decode(next(recording.messages()))
    assert message.joints[0].angle == 0.0
    with AnyReader([tmp_path / 'run']) as reader:
        assert 'lab_msgs/msg/Joint' in reader.typestore.fielddefs


def test_an_unknown_type_is_recorded_with_a_warning(tmp_path, caplog):
    with caplog.at_level(logging.WARNING), BagWriter(tmp_path / 'run') as bag:
        bag.write('/x', 'nobody_msgs/msg/Thing', b'\0\1\0\0abc', 1)
    assert 'nobody_msgs/msg/Thing' in caplog.text
    recording = Recording(tmp_path / 'run')
    raw = next(recording.messages())
    assert raw.data == b'\0\1\0\0abc'
    with pytest.raises(OccError, match='nobody_msgs/msg/Thing'):
        recording.decode(raw)


def test_refuses_what_it_cannot_record(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(OccError, match='exists already'):
        BagWriter(tmp_path)
    with pytest.raises(OccError, match='cannot record to'):
        BagWriter(tmp_path / 'file' / 'run')
    with pytest.raises(OccError, match='allowed are zstd, lz4, none'):
        BagWriter(tmp_path / 'run', compression='zip')
    assert not (tmp_path / 'run').exists()
    with BagWriter(tmp_path / 'run') as bag:
        bag.write('/a', STRING, string('a'), 1)
        with pytest.raises(OccError, match='one type for each topic'):
            bag.write('/a', 'std_msgs/msg/Bool', b'', 2)
        with pytest.raises(OccError, match='the times -1'):
            bag.write('/a', STRING, string('a'), -1)
    with pytest.raises(OccError, match='is closed'):
        bag.write('/a', STRING, string('a'), 2)
    assert Recording(tmp_path / 'run').message_count == 1


RECORD_FOREVER = """
import sys, time
from occ_constraints_pkg.rosbag.writer import BagWriter
bag = BagWriter(sys.argv[1])
number = 0
while True:
    data = number.to_bytes(8, 'little')
    bag.write('/count', 'std_msgs/msg/UInt64', b'\\0\\1\\0\\0' + data, time.time_ns())
    print(number, flush=True)
    number += 1
    time.sleep(0.002)
"""


def test_a_killed_recorder_loses_no_more_than_it_promises(tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-c', RECORD_FOREVER, str(tmp_path / 'run')],
        stdout=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    try:
        for _ in range(700):
            process.stdout.readline()
    finally:
        process.send_signal(signal.SIGKILL)
        written = 700 + len(process.stdout.read().splitlines())
        process.wait(30)
        process.stdout.close()
    recording = Recording(tmp_path / 'run')
    numbers = [int.from_bytes(m.data[4:], 'little') for m in recording.messages()]
    assert numbers == list(range(len(numbers)))
    # 0.5 s at one message each 2 ms or slower.
    assert written - 260 <= len(numbers) <= written
    assert 'was not finished' in recording.warnings[0]
    assert information(tmp_path / 'run')['version'] == 9


RECORD_INTO_LIMIT = """
import os, resource, sys
from occ_constraints_pkg.rosbag.writer import BagWriter
from occ_constraints_pkg.errors import OccError
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
try:
    with BagWriter(sys.argv[1]) as bag:
        for number in range(1000):
            data = b'\\0\\1\\0\\0' + number.to_bytes(8, 'little') + os.urandom(10_000)
            bag.write('/count', 'std_msgs/msg/UInt64', data, number)
except OccError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == 'win32', reason='needs resource limits')
def test_a_full_disk_ends_the_recording_with_the_bag_intact(tmp_path):
    result = subprocess.run(
        [sys.executable, '-c', RECORD_INTO_LIMIT, str(tmp_path / 'run')],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    check_what_is_kept(tmp_path / 'run', result, 'File too large')


def check_what_is_kept(bag, result, reason):
    """Compare a bag with what the recorder, which counts messages, said of it at its end."""
    assert result.returncode == 0, result.stderr
    recording = Recording(bag)
    assert not recording.warnings
    numbers = [int.from_bytes(m.data[4:12], 'little') for m in recording.messages()]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 50
    assert f'{reason}; the {len(numbers)} messages before that are kept' in result.stdout
    assert len(seen_by_others(bag)) == len(numbers)
    assert information(bag)['message_count'] == len(numbers)


@pytest.mark.parametrize('how', ['removed', 'renamed'])
def test_messages_of_a_directory_that_is_gone_are_not_called_kept(tmp_path, how):
    bag = BagWriter(tmp_path / 'run')
    bag.write('/a', STRING, string('a'), 1)
    shutil.rmtree(tmp_path / 'run') if how == 'removed' else (tmp_path / 'run').rename(
        tmp_path / 'other'
    )
    bag.write('/b', STRING, string('b'), 2)
    with pytest.raises(OccError, match='removed or renamed, and the 2 messages .* went with it'):
        bag.close()


@pytest.mark.slow
def test_metadata_of_many_topics_is_written_in_linear_time(tmp_path):
    seconds = {}
    for count in (200, 1600):
        begin = time.process_time()
        with BagWriter(tmp_path / str(count)) as bag:
            for number in range(count):
                bag.write(f'/t{number}', STRING, string('a'), number, qos=[QOS])
        seconds[count] = time.process_time() - begin
        assert len(information(tmp_path / str(count))['topics_with_message_count']) == count
    # Eight times the topics; it would be 64 times if all were written with each new one.
    assert seconds[1600] < 25 * max(seconds[200], 0.02)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(PLAIN)
@example({'\x1f' * 300: [None, {'a' * 2000 + ' ': {'\n' * 600: 1}}]})
def test_plain_yaml_comes_back(document):
    text = dump_plain(document)
    for reader in (parse_yaml, lambda text, _: yaml_1_1(text)):
        assert reader(text, 'it') == document


def yaml_1_1(text):
    reader = YAML(typ='safe', pure=True)
    reader.version = (1, 1)
    return reader.load(text)


HOSTILE_PROFILES = (
    *('[' * 5000, '{a: ' * 3000, '- ' * 30_000, '"' * 60_000, '- &a [1]\n- *a'),
    *('- !!python/object/apply:os.system [true]', '- history: 1\n' * 10_000),
)


@pytest.mark.parametrize('number', range(len(HOSTILE_PROFILES)))
def test_hostile_profiles_count_as_not_stated_at_once(number):
    begin = time.process_time()
    assert parse_profiles(HOSTILE_PROFILES[number]) == ()
    assert time.process_time() - begin < 2.0


def test_profiles_of_older_metadata_get_names():
    text = '- history: 1\n  depth: 5\n  reliability: 2\n  durability: 9\n  liveliness: 1\n'
    assert parse_profiles(text) == (
        {
            'history': 'keep_last',
            'depth': 5,
            'reliability': 'best_effort',
            'durability': 'unknown',
            'liveliness': 'automatic',
        },
    )
    assert parse_profiles('') == parse_profiles('{') == parse_profiles(None) == ()


def test_splits_by_size_into_files_that_read_as_one(tmp_path):
    noise = np.random.default_rng(0).bytes
    sent = [(f'/t{i % 2}', STRING, string('') + noise(40_000), 10**9 + i) for i in range(60)]
    # A topic that comes late, and one that is not in every file.
    sent.append(('/late', STRING, string('late'), 2 * 10**9))
    with BagWriter(tmp_path / 'run', max_file_bytes=600_000) as bag:
        for entry in sent:
            bag.write(*entry, qos=[QOS])
        assert bag.message_count == len(sent)
        names = [path.name for path in bag.paths]
    assert names == [f'run_{number}.mcap' for number in range(len(names))]
    assert len(names) >= 3
    sizes = [(tmp_path / 'run' / name).stat().st_size for name in names]
    assert all(600_000 <= size < 1_000_000 for size in sizes[:-1])
    info = information(tmp_path / 'run')
    assert info['relative_file_paths'] == names == [item['path'] for item in info['files']]
    assert sum(item['message_count'] for item in info['files']) == info['message_count'] == 61
    assert {t['topic_metadata']['name'] for t in info['topics_with_message_count']} == {
        '/t0',
        '/t1',
        '/late',
    }
    first, second = info['files'][:2]
    begin = first['starting_time']['nanoseconds_since_epoch']
    assert begin == info['starting_time']['nanoseconds_since_epoch'] == 10**9
    assert second['starting_time']['nanoseconds_since_epoch'] == (
        begin + first['duration']['nanoseconds'] + 1
    )
    assert seen_by_others(tmp_path / 'run') == sent
    recording = Recording(tmp_path / 'run')
    assert [(m.topic, m.msgtype, m.data, m.log_time_ns) for m in recording.messages()] == sent
    assert not recording.warnings
    # Each file also stands for itself.
    for name, item in zip(names, info['files'], strict=True):
        with (tmp_path / 'run' / name).open('rb') as file:
            reader = make_reader(file, validate_crcs=True)
            assert sum(1 for _ in reader.iter_messages()) == item['message_count']
            (record,) = reader.iter_metadata()
        own = YAML(typ='safe').load(record.metadata['serialized_metadata'])
        assert own['message_count'] == item['message_count']
        assert own['relative_file_paths'] == [name]


def test_splits_by_time(tmp_path):
    with BagWriter(tmp_path / 'run', max_file_seconds=1.0) as bag:
        for tenths in range(35):
            bag.write('/a', STRING, string('a'), tenths * 10**8)
    counts = [item['message_count'] for item in information(tmp_path / 'run')['files']]
    assert counts == [10, 10, 10, 5]
    assert len(seen_by_others(tmp_path / 'run')) == 35


def seen_by_others(bag):
    """Return what the reader of rosbags sees."""
    with AnyReader([bag]) as reader:
        return [(c.topic, c.msgtype, bytes(data), t) for c, t, data in reader.messages()]


# In a name space of its own, as only there one may mount without being root.
RECORD_TO_TINY_DISK = """
set -e
mount -t tmpfs -o size=1m tmpfs "$1"
"$2" -c '
import os, sys
from occ_constraints_pkg.rosbag.writer import BagWriter
from occ_constraints_pkg.errors import OccError
try:
    with BagWriter(sys.argv[1], max_file_bytes=400_000) as bag:
        for number in range(1000):
            data = bytes([0, 1, 0, 0]) + number.to_bytes(8, "little") + os.urandom(10_000)
            bag.write("/count", "std_msgs/msg/UInt64", data, number)
except OccError as error:
    print(error)
' "$1/run"
cp -r "$1/run" "$3"
"""


def test_a_really_full_disk_leaves_a_split_bag_that_opens_everywhere(tmp_path):
    may_mount = ['unshare', '--map-root-user', '--mount']
    (tmp_path / 'disk').mkdir()
    try:
        subprocess.run(
            [*may_mount, 'mount', '-t', 'tmpfs', 'tmpfs', tmp_path / 'disk'],
            check=True,
            capture_output=True,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('needs the right to mount in a name space of its own')
    result = subprocess.run(
        [*may_mount, 'sh', '-c', RECORD_TO_TINY_DISK, 'sh']
        + [str(tmp_path / 'disk'), sys.executable, str(tmp_path / 'run')],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    check_what_is_kept(tmp_path / 'run', result, 'No space left on device')
    info = information(tmp_path / 'run')
    assert len(info['files']) >= 2
    assert sorted(path.name for path in (tmp_path / 'run').iterdir()) == [
        'metadata.yaml',
        *info['relative_file_paths'],
    ]
