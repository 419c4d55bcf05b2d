# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Other people's test data: the MCAP conformance suite, bags of rosbag2 and of other readers."""

import json
import shutil
from dataclasses import fields

import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.rosbag.recording import Recording
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML


def expected_messages(path):
    """Return (topic, type, time, data) in log order, as the JSON beside an MCAP file tells."""
    records = json.loads(path.with_suffix('.json').read_text())['records']
    fields = [(record['type'], dict(record['fields'])) for record in records]
    schemas = {item['id']: item['name'] for kind, item in fields if kind == 'Schema'}
    channels = {item['id']: item for kind, item in fields if kind == 'Channel'}
    messages = []
    for kind, item in fields:
        if kind == 'Message':
            channel = channels[item['channel_id']]
            msgtype = schemas.get(channel['schema_id'], '')
            data = bytes(int(byte) for byte in item['data'])
            messages.append((channel['topic'], msgtype, int(item['log_time']), data))
    return sorted(messages, key=lambda message: message[2])


def test_all_files_of_the_conformance_suite(odd):
    files = sorted((odd / 'mcap_conformance').rglob('*.mcap'))
    assert len(files) == 416
    read = 0
    for path in files:
        expected = expected_messages(path)
        if not expected:
            with pytest.raises(OccError, match='holds no messages'):
                Recording(path)
            continue
        recording = Recording(path)
        found = [(m.topic, m.msgtype, m.log_time_ns, m.data) for m in recording.messages()]
        assert found == expected, path
        assert recording.message_count == len(expected)
        assert not recording.warnings
        # Their messages are not those of ROS.
        with pytest.raises(OccError, match="serialized as '.*'; allowed is 'cdr'"):
            recording.decode(next(recording.messages()))
        read += 1
    assert read == 382


def bags(odd):
    """Return every rosbag2 directory, bare file and directory without metadata."""
    folders = [path.parent for path in odd.rglob('metadata.yaml')]
    files = [
        path
        for suffix in ('mcap', 'db3', 'zstd')
        for path in odd.rglob(f'*.{suffix}')
        if 'mcap_conformance' not in path.parts
    ]
    return sorted({*folders, *files, *(path.parent for path in files)})


def test_every_bag_is_read_completely_or_refused(odd):
    """Counts are those of metadata.yaml, or of rosbags for bare files."""
    read = 0
    for path in bags(odd):
        if 'empty_bag' in path.parts or 'empty_dir' in path.parts:
            with pytest.raises(OccError, match='holds no messages|is not a recording'):
                Recording(path)
            continue
        recording = Recording(path)
        read += 1
        counts = dict.fromkeys(recording.topics, 0)
        last = 0
        for raw in recording.messages():
            counts[raw.topic] += 1
            assert raw.log_time_ns >= last
            last = raw.log_time_ns
        assert counts == {name: info.count for name, info in recording.topics.items()}
        assert not recording.warnings
        told = path / 'metadata.yaml'
        if told.exists():
            document = YAML(typ='safe').load(told.read_text())['rosbag2_bagfile_information']
            promised = {
                entry['topic_metadata']['name']: entry['message_count']
                for entry in document['topics_with_message_count']
            }
            assert {name: count for name, count in counts.items() if count} == {
                name: count for name, count in promised.items() if count
            }
        elif path.is_file() and path.suffix != '.zstd':
            with Reader(path) as reader:
                assert sum(counts.values()) == reader.message_count
    assert read > 60


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_contents_equal_those_that_rosbags_reads(odd, kind):
    for folder in ('wbag', 'convert_b', 'convert_a'):
        path = odd / 'rosbag2' / 'rosbag2_py' / 'test' / 'resources' / kind / folder
        ours = [(m.topic, m.log_time_ns, m.data) for m in Recording(path).messages()]
        theirs = []
        # File by file: of a directory rosbags passes over topics whose QoS is told in two ways.
        for file in Recording(path).files:
            with Reader(file) as reader:
                theirs += [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
        assert sorted(ours) == sorted(theirs)


def shown(message, like):
    """Return a message as text, with the fields that another one has: rosbags adds constants."""
    if isinstance(message, list):
        return [shown(*pair) for pair in zip(message, like, strict=True)]
    if not hasattr(like, '__msgtype__'):
        return repr(message)
    names = [field.name for field in fields(like)]
    return {name: shown(getattr(message, name), getattr(like, name)) for name in names}


def test_twins_of_many_types(odd):
    folder = odd / 'many_types' / 'tests' / 'test_bags'
    first, second = (Recording(folder / f'test_bag_{kind}') for kind in ('mcap', 'sqlite3'))
    assert len(first.topics) == len(second.topics) == 94
    with AnyReader([first.path]) as reader:
        theirs = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        ]
    ours = [first.decode(raw) for raw in first.messages()]
    assert shown(theirs, ours) == shown(ours, ours)
    kinds = {raw.msgtype: type(second.decode(raw)).__name__ for raw in second.messages()}
    assert kinds == {raw.msgtype: type(first.decode(raw)).__name__ for raw in first.messages()}


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_a_wrong_serialization_is_refused(odd, kind):
    path = odd / 'rosbag2' / 'rosbag2_tests' / 'resources' / kind / 'wrong_rmw_test'
    feature_map = FeatureMap('test_topic', 1.0, (FeatureSource('f', 'test_topic', 'int32_value'),))
    with pytest.raises(OccError, match="serialized as 'wrong_format'; allowed is 'cdr'"):
        extract([path], feature_map)


def test_a_bag_without_what_the_map_needs(odd):
    path = odd / 'no_odometry' / 'test' / 'fixtures' / 'cmd_vel_only.mcap'
    feature_map = FeatureMap('odom', 1.0, (FeatureSource('v', 'odom', 'twist.twist.linear.x'),))
    with pytest.raises(OccError, match="no topic 'odom'; its topics are /"):
        extract([path], feature_map)


def test_a_bag_compressed_as_a_whole_unpacks_nothing_beside_itself(odd):
    folder = odd / 'nav2_file_zstd' / 'nav2_collision_monitor' / 'test' / 'bags'
    path = folder / 'cm_moving_obstacle'
    before = sorted(path.iterdir())
    recording, bare = Recording(path), Recording(next(path.glob('*.zstd')))
    assert bare.name == '_tmp_cm_bag_0'
    ours = [(m.topic, m.log_time_ns, m.data) for m in recording.messages()]
    with Reader(path) as reader:
        theirs = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
    assert sorted(ours) == sorted(theirs)
    assert [(m.topic, m.log_time_ns, m.data) for m in bare.messages()] == ours
    assert sorted(path.iterdir()) == before


def test_custom_types_are_decoded_by_the_definitions_in_the_bag(odd):
    path = odd / 'rosbag2' / 'rosbag2_tests' / 'resources' / 'mcap' / 'cdr_test'
    recording = Recording(path)
    assert recording.topics['/test_topic'].msgtype == 'test_msgs/msg/BasicTypes'
    data = extract(
        [path],
        FeatureMap(
            'test_topic',
            1.0,
            (
                FeatureSource('i', 'test_topic', 'int32_value'),
                FeatureSource('x', 'array_topic', 'float64_values[1]'),
            ),
        ),
    )
    messages = [recording.decode(raw) for raw in recording.messages(['test_topic'])]
    assert data.values[:, 0].tolist() == [message.int32_value for message in messages]


def test_split_bags_with_a_file_less(odd, tmp_path):
    source = odd / 'rosbag2' / 'rosbag2_py' / 'test' / 'resources' / 'mcap' / 'wbag'
    shutil.copytree(source, tmp_path / 'bag')
    (tmp_path / 'bag' / 'wbag_2.mcap').unlink()
    with pytest.raises(OccError, match='lacks wbag_2.mcap, which its metadata.yaml lists'):
        Recording(tmp_path / 'bag')
    # Without metadata.yaml nothing tells that a part is gone.
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert Recording(tmp_path / 'bag').message_count == 6074 - 1240
