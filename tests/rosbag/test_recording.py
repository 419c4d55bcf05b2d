# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import hashlib
import io
import shutil

import pytest
from mcap.writer import CompressionType, IndexType, Writer
from occ_constraints_pkg.datasets.manifest import select
from occ_constraints_pkg.documents import dump_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.recording import Recording
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore


def mcap_bytes(times, **options):
    """Return an MCAP file with one message of its own number per time."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=400, **options)
    writer.start('ros2')
    schema = writer.register_schema('std_msgs/msg/UInt64', 'ros2msg', b'uint64 data\n')
    channels = [writer.register_channel(topic, 'cdr', schema) for topic in ('/even', '/odd')]
    for number, time in enumerate(times):
        data = b'\0\1\0\0' + number.to_bytes(8, 'little')
        writer.add_message(channels[number % 2], time, data, time)
    writer.finish()
    return stream.getvalue()


def numbers(recording, topics=None):
    return [int.from_bytes(m.data[4:], 'little') for m in recording.messages(topics)]


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'compression': CompressionType.LZ4},
        {'use_chunking': False},
        {'use_statistics': False},
        {'repeat_channels': False, 'repeat_schemas': False},
        {'index_types': IndexType.NONE, 'use_summary_offsets': False},
    ],
)
def test_log_order_whatever_the_file_tells_of_itself(tmp_path, options):
    # Chunks overlap in time, and times are equal here and there.
    times = [1000 + (i * 37) % 100 // 2 + i // 3 for i in range(600)]
    path = tmp_path / 'a.mcap'
    path.write_bytes(mcap_bytes(times, **options))
    recording = Recording(path)
    expected = sorted(range(600), key=lambda i: times[i])
    assert numbers(recording) == expected
    assert numbers(recording, ['odd']) == [i for i in expected if i % 2]
    assert {name: info.count for name, info in recording.topics.items()} == {
        '/even': 300,
        '/odd': 300,
    }
    assert not recording.warnings
    raw = next(recording.messages(['/odd']))
    assert recording.decode(raw).data == int.from_bytes(raw.data[4:], 'little')


@pytest.mark.parametrize(
    'compression', [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE, None]
)
def test_a_file_cut_anywhere_gives_its_complete_messages(tmp_path, compression):
    options = {'use_chunking': False} if compression is None else {'compression': compression}
    whole = mcap_bytes(range(60), **options)
    path = tmp_path / 'cut.mcap'
    counts = []
    # The stride shares no factor with the sizes of records, so it falls on every part of them.
    for size in range(8, len(whole), 13):
        path.write_bytes(whole[:size])
        try:
            recording = Recording(path)
        except OccError:
            # Nothing complete is in there yet.
            counts.append(0)
            continue
        found = numbers(recording)
        assert found == list(range(len(found)))
        assert recording.message_count == len(found)
        # Only a file that lacks nothing but its summary is taken without a word.
        assert recording.warnings or len(found) == 60
        counts.append(len(found))
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 60)


def test_a_damaged_chunk_is_told(tmp_path):
    whole = bytearray(mcap_bytes(range(60), compression=CompressionType.NONE))
    whole[whole.index(b'\0\1\0\0' + (30).to_bytes(8, 'little')) + 6] ^= 1
    path = tmp_path / 'a.mcap'
    path.write_bytes(whole)
    with pytest.raises(OccError, match='is damaged.*checksum'):
        numbers(Recording(path))


def test_directory_without_metadata_and_with_split_files(tmp_path):
    bag = tmp_path / 'bag'
    bag.mkdir()
    for part in (10, 9):
        (bag / f'bag_{part}.mcap').write_bytes(mcap_bytes(range(part, part + 3)))
    recording = Recording(bag)
    assert [file.name for file in recording.files] == ['bag_9.mcap', 'bag_10.mcap']
    assert [m.log_time_ns for m in recording.messages()] == [9, 10, 10, 11, 11, 12]
    assert recording.fingerprint() == {
        'name': 'bag',
        'sha256': hashlib.sha256(b''.join(f.read_bytes() for f in recording.files)).hexdigest(),
        'messages': 6,
    }


@pytest.mark.parametrize('plugin', list(StoragePlugin))
@pytest.mark.parametrize('mode', list(CompressionMode))
def test_bags_of_rosbags(tmp_path, plugin, mode):
    if plugin is StoragePlugin.SQLITE3 and mode is CompressionMode.STORAGE:
        pytest.skip('SQLite has no such compression')
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        channel = writer.add_connection('/n', 'std_msgs/msg/UInt64', typestore=store)
        for number in range(20):
            writer.write(channel, 100 + number, b'\0\1\0\0' + number.to_bytes(8, 'little'))
    recording = Recording(tmp_path / 'bag')
    assert numbers(recording) == list(range(20))
    assert [recording.decode(m).data for m in recording.messages(['n'])] == list(range(20))
    assert recording.message_count == 20


def test_real_bag_equals_rosbags(robots):
    recording = Recording(robots / 'safe_neato_zcoakley_teleop')
    with AnyReader([robots / 'safe_neato_zcoakley_teleop']) as reader:
        theirs = [(c.topic, c.msgtype, t, bytes(data)) for c, t, data in reader.messages()]
        scans = [
            reader.deserialize(data, c.msgtype).ranges
            for c, _, data in reader.messages()
            if c.topic == '/scan'
        ]
    ours = [(m.topic, m.msgtype, m.log_time_ns, m.data) for m in recording.messages()]
    assert ours == theirs
    for raw, ranges in zip(recording.messages(['scan']), scans, strict=True):
        assert recording.decode(raw).ranges.tobytes() == ranges.tobytes()


def test_real_bag_cut_in_the_middle(robots, tmp_path):
    source = robots / 'safe_tb3_abhishek' / 'safe_tb3_abhishek.mcap'
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(source.read_bytes()[:1_000_000])
    recording = Recording(cut)
    whole = list(Recording(source).messages())
    assert 1000 < recording.message_count < len(whole)
    assert {m.data for m in recording.messages()} <= {m.data for m in whole}
    assert f'{recording.message_count} complete messages' in recording.warnings[0]


def test_what_is_no_recording(tmp_path):
    with pytest.raises(OccError, match='there is no recording at'):
        Recording(tmp_path / 'none')
    with pytest.raises(OccError, match='neither a metadata.yaml'):
        Recording(tmp_path)
    text = tmp_path / 'notes.txt'
    text.write_text('hello')
    with pytest.raises(OccError, match='is not a recording'):
        Recording(text)
    for content in (b'', b'hello'):
        (tmp_path / 'a.mcap').write_bytes(content)
        with pytest.raises(OccError, match='is not an MCAP file'):
            Recording(tmp_path / 'a.mcap')
    (tmp_path / 'a.db3').write_bytes(b'hello' * 1000)
    with pytest.raises(OccError, match='cannot be read'):
        Recording(tmp_path / 'a.db3')
    (tmp_path / 'a.mcap').write_bytes(mcap_bytes([]))
    with pytest.raises(OccError, match='holds no messages'):
        Recording(tmp_path / 'a.mcap')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('{', 'metadata.yaml.* is not valid YAML'),
        ('[]', 'is not the metadata'),
        ('rosbag2_bagfile_information: {version: 10}', 'allowed are 1 to 9'),
        (
            'rosbag2_bagfile_information: {version: 9, relative_file_paths: [x/gone.mcap]}',
            'lacks gone.mcap',
        ),
    ],
)
def test_wrong_metadata(tmp_path, text, reason):
    (tmp_path / 'metadata.yaml').write_text(text)
    (tmp_path / 'a.mcap').write_bytes(mcap_bytes([1]))
    with pytest.raises(OccError, match=reason):
        Recording(tmp_path)


def test_unknown_topic_names_the_closest(tmp_path):
    (tmp_path / 'a.mcap').write_bytes(mcap_bytes([1, 2]))
    with pytest.raises(OccError, match=r"no topic 'evn'; did you mean '/even'\? .*/even, /odd"):
        Recording(tmp_path / 'a.mcap').messages(['evn'])


def test_wrong_serialization_is_refused(tmp_path, messages, write_bag):
    bag = write_bag([('/t', messages.twist(), 1)])
    path = bag / 'metadata.yaml'
    path.write_text(path.read_text().replace('format: cdr', 'format: json'))
    recording = Recording(bag)
    with pytest.raises(OccError, match="serialized as 'json'; allowed is 'cdr'"):
        recording.decode(next(recording.messages()))


def test_bytes_that_are_no_message(tmp_path):
    stream = mcap_bytes([1])
    (tmp_path / 'a.mcap').write_bytes(stream)
    recording = Recording(tmp_path / 'a.mcap')
    raw = next(recording.messages())
    with pytest.raises(OccError, match='3 bytes are not a std_msgs/msg/UInt64'):
        recording.decode(type(raw)(raw.topic, raw.msgtype, 1, b'\0\1\0'))


def test_a_moved_bag_keeps_its_hash(tmp_path, messages, write_bag):
    bag = write_bag([('/t', messages.twist(), 1)])
    shutil.copytree(bag, tmp_path / 'copy')
    first, second = Recording(bag).fingerprint(), Recording(tmp_path / 'copy').fingerprint()
    assert first['sha256'] == second['sha256']
    assert (first['name'], second['name']) == ('bag', 'copy')


@pytest.mark.parametrize('name', ['a' * 300, f'{"a" * 300}.mcap', '\0'])
def test_names_that_no_file_can_have_are_told_in_one_sentence(tmp_path, name):
    listing = {'version': 9, 'relative_file_paths': [name]}
    (tmp_path / 'metadata.yaml').write_text(
        dump_yaml({'rosbag2_bagfile_information': listing}), encoding='utf-8'
    )
    manifest = tmp_path / 'manifest.yaml'
    manifest.write_text(
        dump_yaml({'schema_version': 1, 'recordings': [{'path': name}]}), encoding='utf-8'
    )
    (listed,) = select([manifest])
    for path in (tmp_path, tmp_path / name, listed.path):
        with pytest.raises(OccError) as caught:
            Recording(path)
        assert '\n' not in str(caught.value)


def test_a_manifest_whose_name_is_too_long_is_told_in_one_sentence(tmp_path):
    with pytest.raises(OccError, match='File name too long'):
        select([tmp_path / f'{"a" * 300}.yaml'])
