# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Extraction by blocks gives what pushing message by message gives, bit for bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from occ_constraints_pkg.datasets.blocks import TopicColumns
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.features.sources import Reading
from occ_constraints_pkg.rosbag import storage
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 10**9


def pushed(path, feature_map):
    """Return stamps and rows without repeats, message by message."""
    recording, extractor = Recording(path), FeatureExtractor(feature_map)
    topics = [recording.find(name) for name in feature_map.topics]
    stamps, rows = [], []
    for raw in recording.messages(topics):
        result = extractor.push(raw.topic, recording.decode(raw), raw.log_time_ns)
        if result is not None and not result.repeat:
            stamps.append(result.stamp_ns)
            rows.append(result.values[0])
    return stamps, np.array(rows)


def assert_equal(path, feature_map):
    data = extract([path], feature_map)
    stamps, rows = pushed(path, feature_map)
    assert data.stamps_ns.tolist() == stamps
    assert np.array_equal(data.values, rows, equal_nan=True)
    known = ~np.isnan(rows)
    assert data.values[known].tobytes() == rows[known].tobytes()
    return data


def fields(topic, *options):
    return [
        FeatureSource(f'{topic.strip("/")}_{number}'.replace('/', '_'), topic, **option)
        for number, option in enumerate(options)
    ]


SCAN = fields(
    'scan',
    {'field': 'ranges[0:40]', 'reduce': 'min', 'missing': 'max_range'},
    {'field': 'ranges[5:17]', 'reduce': 'max'},
    {'field': 'ranges[3:203]', 'reduce': 'mean', 'missing': 'max_range'},
    {'field': 'ranges[-150:]', 'reduce': 'mean'},
    {'field': 'ranges', 'reduce': 'norm', 'missing': 'max_range'},
    {'field': 'ranges[7]', 'missing': 'max_range'},
    {'field': 'ranges[-1]'},
    {'field': 'angle_increment'},
    {'field': 'header.stamp.nanosec'},
)
ODOMETRY = fields(
    'odom',
    {'field': 'twist.twist.linear.x', 'transform': 'abs'},
    {'field': 'twist.twist.angular', 'reduce': 'norm'},
    {'field': 'pose.pose.orientation', 'transform': 'yaw'},
    {'field': 'pose.covariance[7]'},
    {'field': 'pose.covariance[0:6]', 'reduce': 'mean'},
)
COMMAND = fields('cmd_vel', {'field': 'angular.z'}, {'field': 'linear', 'reduce': 'max'})


@pytest.mark.parametrize('pace', ['scan', 'odom', 'cmd_vel'])
@pytest.mark.parametrize(
    'bag', ['safe_neato_zcoakley_teleop', 'contact_tb3_surya', 'close_epuck_webots_aakash']
)
def test_real_robots(robots, bag, pace, monkeypatch):
    # Small blocks: what is held has to come across their borders.
    monkeypatch.setattr(storage, '_BLOCK_BYTES', 50_000)
    few_beams = Recording(robots / bag).decode(next(Recording(robots / bag).messages(['scan'])))
    scan = [
        source
        for source in SCAN
        if len(few_beams.ranges) > 203 or source.field in ('ranges', 'ranges[7]', 'ranges[-1]')
    ]
    data = assert_equal(robots / bag, FeatureMap(pace, 0.3, (*scan, *ODOMETRY, *COMMAND)))
    assert len(data) > 10


def test_all_topics_of_real_robots(robots):
    """Each numeric field of each type in all bags, from blocks and from messages."""
    compared, seen = 0, set()
    for bag in sorted(robots.iterdir()):
        if not bag.is_dir():
            continue
        recording = Recording(bag)
        for topic in recording.topics:
            kind = recording.topics[topic].msgtype, recording.topics[topic].definition
            if kind in seen:
                continue
            sources = fields(topic, *({'field': field} for field in numbers_of(recording, topic)))
            if not sources:
                continue
            columns = TopicColumns(recording, topic, [(s.name, s.reading) for s in sources])
            assert columns._fields is not None
            block = next(recording.blocks([topic]), None)
            if block is None:
                assert recording.topics[topic].count == 0
                continue
            rows = np.arange(len(block))[:30]
            seen.add(kind)
            values, stamps = columns.read(block, rows)
            slow_values, slow_stamps, _ = columns._one_by_one(block, rows)
            assert np.array_equal(values, slow_values, equal_nan=True), topic
            assert stamps.tolist() == slow_stamps.tolist()
            compared += values.size
    assert len(seen) > 10
    assert compared > 1000


def numbers_of(recording, topic):
    """Return the paths of a topic's numbers, those in sequences of messages left out."""
    definitions = recording.fields(topic)

    def walk(msgtype, path):
        for name, (kind, argument) in definitions[msgtype][1]:
            if isinstance(argument, str):
                yield from walk(argument, f'{path}{name}.')
            elif kind.name == 'BASE' and argument[0] != 'string':
                yield f'{path}{name}'

    return list(walk(recording.topics[topic].msgtype, ''))


RANGE = st.sampled_from([0.0, np.nan, np.inf, -np.inf, 0.5, 1.25, 3.0, 5.0])


@settings(max_examples=20)
@given(data=st.data())
def test_made_up_messages(data, tmp_path_factory, messages, write_entries):
    entries, time = [], 0
    for _ in range(data.draw(st.integers(1, 25))):
        time += data.draw(st.integers(0, 4)) * SECOND // 10
        stamp = data.draw(st.sampled_from([0, time, time, time - SECOND // 2, 3]))
        stamp = max(stamp, 0)
        match data.draw(st.integers(0, 3)):
            case 3:
                names = data.draw(st.lists(st.sampled_from('abc'), unique=True))
                known = data.draw(st.integers(0, len(names)))
                joints = messages.joints(stamp, names, [data.draw(RANGE) for _ in range(known)])
                entries.append(('/joints', joints, time))
            case 0:
                ranges = data.draw(st.lists(RANGE, min_size=0, max_size=6))
                ranges += [1.0] * (4 - len(ranges)) if ranges else []
                entries.append(('/scan', messages.scan(ranges, stamp_ns=stamp), time))
            case 1:
                quaternion = [data.draw(RANGE) for _ in range(4)]
                message = messages.imu(messages.quaternion(*quaternion), stamp_ns=stamp)
                entries.append(('/imu', message, time))
            case _:
                entries.append(('/cmd_vel', messages.twist(x=data.draw(RANGE)), time))
    topics = {topic for topic, _, _ in entries}
    sources = [
        *fields(
            'scan',
            {'field': 'ranges[0:2]', 'reduce': 'min', 'missing': 'max_range'},
            {'field': 'ranges[1:4]', 'reduce': 'max', 'missing': 'max_range'},
            {'field': 'ranges[:]', 'reduce': 'mean'},
            {'field': 'range_max', 'missing': 'max_range'},
            {'field': 'ranges', 'reduce': 'min', 'missing': 'max_range', 'range_limits': 'own'},
            {'field': 'ranges', 'reduce': 'mean', 'missing': 'drop', 'range_limits': (0.5, 3.0)},
            {'field': 'ranges', 'reduce': 'max', 'range_limits': 'own', 'max_age': 0.125},
            {'field': 'ranges', 'reduce': 'count', 'missing': 'drop'},
            {'field': 'ranges', 'reduce': 'count', 'age_by': 'arrival'},
        ),
        *fields(
            'imu',
            {'field': 'orientation', 'transform': 'yaw'},
            {'field': 'orientation.w', 'age_by': 'arrival'},
            *({'field': 'orientation', 'reduce': angle} for angle in ('roll', 'pitch', 'tilt')),
            {'field': 'orientation', 'reduce': 'roll', 'transform': 'rate', 'max_age': 2.0},
        ),
        *fields(
            'cmd_vel',
            {'field': 'linear', 'reduce': 'norm'},
            {
                'field': 'linear.x',
                'minus': Reading('cmd_vel', 'twist.linear.x', transform=(('rate',), ('abs',))),
            },
        ),
        *fields(
            'joints',
            {'field': 'position[name=a]'},
            {'field': 'position[name=b]', 'transform': 'rate'},
            {'field': 'position[name=a]', 'max_age': 1.0, 'age_by': 'arrival'},
            {'field': 'name', 'reduce': 'count'},
        ),
    ]
    heard = {name for topic, item, _ in entries if topic == '/joints' for name in item.name}
    sources = [
        source
        for source in sources
        if not (selectors := source.reading.selectors) or selectors[0].text in heard
    ]
    sources = [source for source in sources if f'/{source.topic}' in topics]
    path = write_entries(tmp_path_factory.mktemp('made') / 'bag', entries)
    pace = data.draw(st.sampled_from(sorted(topics)))
    with np.errstate(all='ignore'):
        assert_equal(path, FeatureMap(pace, 0.25, tuple(sources)))


def test_a_damaged_message_is_told_by_the_decoder_of_single_messages(messages, write_bag):
    bag = write_bag([('/scan', messages.scan([1.0, 2.0]), time) for time in range(5)])
    path = next(bag.glob('*.mcap'))
    recording = Recording(path)
    (source,) = fields('scan', {'field': 'ranges[1]'})
    columns = TopicColumns(recording, '/scan', [(source.name, source.reading)])
    block = next(recording.blocks(['/scan']))
    good, _ = columns.read(block, np.arange(5))
    assert good.ravel().tolist() == [2.0] * 5
    shorter = storage.Block(block.data, block.topics, block.times, block.starts, block.ends - 8)
    with pytest.raises(OccError, match='bytes are not a sensor_msgs/msg/LaserScan'):
        columns.read(shorter, np.arange(5))


def test_big_endian_messages_are_read(messages, tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        for time in range(3):
            message = messages.scan([1.0, 2.0 + time], stamp_ns=7)
            data = STORE.serialize_cdr(message, message.__msgtype__, little_endian=time == 1)
            bag.write('/scan', message.__msgtype__, bytes(data), time)
    data = assert_equal(
        tmp_path / 'bag', FeatureMap('scan', 1.0, tuple(fields('scan', {'field': 'ranges[1]'})))
    )
    assert data.values.ravel().tolist() == [2.0, 3.0, 4.0]


def test_a_definition_that_lacks_a_part(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        text = b'lab_msgs/Part part\nfloat64 x\n'
        schema = writer.register_schema('lab_msgs/msg/A', 'ros2msg', text)
        channel = writer.register_channel('/a', 'cdr', schema)
        writer.add_message(channel, 1, b'\0\1\0\0' + bytes(24), 1)
        writer.finish()
    with pytest.raises(OccError, match='neither complete in the bag nor part of ROS 2 Jazzy'):
        extract([path], FeatureMap('a', 1.0, tuple(fields('a', {'field': 'x'}))))


def test_a_header_without_a_stamp(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        text = b'int32 header\nfloat64 x\n'
        schema = writer.register_schema('lab_msgs/msg/A', 'ros2msg', text)
        channel = writer.register_channel('/a', 'cdr', schema)
        for time in range(3):
            data = b'\0\1\0\0' + bytes(8) + np.float64(time).tobytes()
            writer.add_message(channel, time, data, time)
        writer.finish()
    data = assert_equal(path, FeatureMap('a', 1.0, tuple(fields('a', {'field': 'x'}))))
    assert data.values.ravel().tolist() == [0.0, 1.0, 2.0]
    assert data.stamps_ns.tolist() == [0, 1, 2]
