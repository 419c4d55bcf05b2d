# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.features.fields import MessageReader, header_stamp_ns
from occ_constraints_pkg.features.sources import FeatureSource, Reading
from occ_constraints_pkg.rosbag.recording import Recording
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

SECOND = 10**9
STORE = get_typestore(Stores.ROS2_JAZZY)


def feature_map(*features, pace='scan', max_age=0.5):
    sources = [FeatureSource(f'f{i}', **options) for i, options in enumerate(features)]
    return FeatureMap(pace, max_age, tuple(sources))


def one_value(message, **options):
    extractor = FeatureExtractor(feature_map({'topic': 'scan', **options}))
    return extractor.push('/scan', message, 1).values[0, 0]


@pytest.mark.parametrize(
    ('options', 'expected'),
    [
        ({'field': 'ranges[1]'}, 2.0),
        ({'field': 'ranges[-1]'}, 4.0),
        ({'field': 'ranges[-2:]', 'reduce': 'mean'}, 3.5),
        ({'field': 'ranges[1:3]', 'reduce': 'min'}, 2.0),
        ({'field': 'ranges', 'reduce': 'max'}, 4.0),
        ({'field': 'ranges[2:]', 'reduce': 'norm'}, 5.0),
        ({'field': 'range_max', 'transform': 'abs'}, 10.0),
        ({'field': 'header.stamp.sec'}, 0.0),
    ],
)
def test_field_paths(messages, options, expected):
    assert one_value(messages.scan([1, 2, 3, 4], range_max=10.0), **options) == expected


@pytest.mark.parametrize(
    ('ranges', 'unknown', 'max_range'),
    [
        ([1.5, np.inf], 1.5, 1.5),
        ([1.5, np.nan], np.nan, 1.5),
        ([1.5, 0.0], 0.0, 1.5),
        ([np.inf, np.nan], np.nan, 4.0),
        ([1.5, -np.inf], -np.inf, -np.inf),
        ([], np.nan, np.nan),
    ],
)
def test_missing_ranges(messages, ranges, unknown, max_range):
    scan = messages.scan(ranges, range_max=4.0)
    options = {'field': 'ranges', 'reduce': 'min'}
    np.testing.assert_equal(one_value(scan, **options), unknown)
    np.testing.assert_equal(one_value(scan, missing='max_range', **options), max_range)


def test_a_single_missing_range(messages):
    scan = messages.scan([np.inf], range_max=4.0)
    assert one_value(scan, field='ranges[0]', missing='max_range') == 4.0
    assert one_value(scan, field='ranges[0]') == np.inf


@pytest.mark.parametrize('length', [1.0, 3.0])
@pytest.mark.parametrize('yaw', [-3.0, -0.5, 0.0, 1.0, 3.1])
def test_yaw(messages, yaw, length):
    z, w = length * math.sin(yaw / 2), length * math.cos(yaw / 2)
    value = one_value(
        messages.imu(messages.quaternion(0.0, 0.0, z, w)), field='orientation', transform='yaw'
    )
    assert value == pytest.approx(yaw, abs=1e-12)


def test_unset_orientation_is_missing(messages):
    message = messages.imu(messages.quaternion(0.0, 0.0, 0.0, 0.0))
    assert np.isnan(one_value(message, field='orientation', transform='yaw'))


def test_norm_and_abs_of_a_vector(messages):
    twist = messages.twist(x=-3.0, y=4.0)
    assert one_value(twist, field='linear', reduce='norm') == 5.0
    assert one_value(twist, field='linear.x', transform='abs') == 3.0


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ({'field': 'rangez[0]'}, "no 'rangez'; did you mean 'ranges'? it has header"),
        ({'field': 'header.stamp.x'}, "header.stamp has no 'x'; it has sec, nanosec"),
        ({'field': 'ranges[4]'}, "asks for 'ranges[4]', but ranges has 4 elements"),
        ({'field': 'ranges[0:9]', 'reduce': 'min'}, 'the array has 4 elements'),
        ({'field': 'ranges[2:2]', 'reduce': 'min'}, 'the array has 4 elements'),
        ({'field': 'range_max[0]'}, 'range_max is not an array'),
        ({'field': 'ranges'}, 'allowed is one number; an array needs the key "reduce"'),
        ({'field': 'header.frame_id'}, 'is str; allowed is one number'),
        ({'field': 'header.stamp'}, 'Time; allowed is one number'),
        ({'field': 'range_max', 'reduce': 'min'}, 'allowed is an array or vector'),
        ({'field': 'header', 'transform': 'yaw'}, 'allowed is a quaternion'),
        ({'column': 'a'}, "column 'a' of topic 'scan', whose messages are"),
    ],
)
def test_a_field_that_is_not_there(messages, options, sentence):
    with pytest.raises(OccError) as caught:
        one_value(messages.scan([1, 2, 3, 4]), **options)
    assert sentence in str(caught.value)
    assert "'scan'" in str(caught.value)


def test_max_range_needs_a_scan(messages):
    with pytest.raises(OccError, match="no field 'range_max'"):
        one_value(messages.twist(), field='linear', reduce='min', missing='max_range')


def test_messages_of_rclpy_are_read_alike():
    class Vector:
        x, _check = 2.5, 1.0

        @classmethod
        def get_fields_and_field_types(cls):
            return {'x': 'double'}

    class Message:
        linear = Vector()

        @classmethod
        def get_fields_and_field_types(cls):
            return {'linear': 'V'}

    message = Message()
    assert one_value(message, field='linear.x') == 2.5
    with pytest.raises(OccError, match="linear has no 'q'; it has x"):
        one_value(message, field='linear.q')
    # What is no field is not read, though Python has it.
    for field in ('linear._check', 'linear.x.real', 'linear.__class__'):
        with pytest.raises(OccError, match='has no'):
            one_value(message, field=field)


def test_constants_of_a_type_are_no_fields():
    status = STORE.types['sensor_msgs/msg/NavSatStatus'](status=0, service=1)
    assert status.STATUS_NO_FIX == -1
    with pytest.raises(OccError, match='it has status, service'):
        one_value(status, field='STATUS_NO_FIX')


def test_held_values_and_their_age(messages):
    extractor = FeatureExtractor(
        feature_map(
            {'topic': 'scan', 'field': 'ranges[0]'},
            {'topic': '/cmd_vel', 'field': 'linear.x'},
            {'topic': 'imu', 'field': 'orientation.w'},
        )
    )

    def scan(stamp, arrival):
        rows = extractor.push(
            'scan', messages.scan([stamp], stamp_ns=round(stamp * SECOND)), arrival
        )
        assert rows.stamp_ns == round(stamp * SECOND)
        assert rows.table is None
        return rows.values.tolist()[0]

    def imu(stamp, arrival):
        orientation = messages.quaternion(0.0, 0.0, 0.0, stamp)
        message = messages.imu(orientation, stamp_ns=round(stamp * SECOND))
        assert extractor.push('/imu', message, arrival) is None

    np.testing.assert_equal(scan(1.0, 0), [1.0, np.nan, np.nan])
    extractor.push('cmd_vel', messages.twist(x=7.0), 0)
    imu(1.0, 10 * SECOND)
    extractor.push('/elsewhere', messages.twist(), 0)
    # The command has no stamp and goes by arrival; the IMU goes by its stamp, however late.
    assert scan(1.5, SECOND // 2) == [1.5, 7.0, 1.0]
    np.testing.assert_equal(scan(1.75, SECOND // 2 + 1), [1.75, np.nan, np.nan])
    # A clock that has jumped back leaves what was held in the future.
    imu(9.0, 0)
    np.testing.assert_equal(scan(2.0, 0), [2.0, 7.0, np.nan])


def test_a_stamp_of_zero_counts_as_none(messages):
    assert header_stamp_ns(messages.scan([])) is None
    assert header_stamp_ns(messages.twist()) is None
    assert header_stamp_ns(messages.scan([], stamp_ns=5)) == 5
    extractor = FeatureExtractor(feature_map({'topic': 'scan', 'field': 'range_max'}))
    rows = [extractor.push('scan', messages.scan([]), 9) for _ in range(2)]
    assert [(r.stamp_ns, r.repeat) for r in rows] == [(9, False), (9, False)]


@pytest.mark.parametrize('dtype', [np.float32, np.float64])
def test_tables_give_one_row_per_robot(messages, dtype):
    extractor = FeatureExtractor(
        feature_map(
            {'topic': 'observation', 'column': 'c'},
            {'topic': 'observation', 'column': 'a', 'transform': 'abs'},
            pace='observation',
        )
    )
    values = np.array([[-1, 2, 3], [-4, 5, 6]], dtype=dtype)
    rows = extractor.push('observation', messages.table('abc', values, stamp_ns=3), 1)
    assert rows.values.tolist() == [[3.0, 1.0], [6.0, 4.0]]
    assert rows.values.dtype == np.float64
    assert rows.table.column('b').tolist() == [2.0, 5.0]
    # Other columns in another order.
    rows = extractor.push('observation', messages.table('cba', values, stamp_ns=3), 1)
    assert rows.values.tolist() == [[-1.0, 3.0], [-4.0, 6.0]]
    assert not rows.repeat
    with pytest.raises(OccError, match=r"column 'c'.*its columns are a, b, d"):
        extractor.push('observation', messages.table('abd', values), 1)


def test_tables_beside_other_topics(messages):
    extractor = FeatureExtractor(
        feature_map(
            {'topic': 'observation', 'column': 'a'},
            {'topic': 'costs', 'column': 'cost'},
            {'topic': 'cmd_vel', 'field': 'linear.x'},
            pace='observation',
        )
    )
    extractor.push('costs', messages.table(['cost'], [[7.0], [8.0]]), 0)
    extractor.push('cmd_vel', messages.twist(x=9.0), 0)
    rows = extractor.push('observation', messages.table('a', [[1.0], [2.0]]), 0)
    assert rows.values.tolist() == [[1.0, 7.0, 9.0], [2.0, 8.0, 9.0]]
    with pytest.raises(OccError, match="'costs' holds 2 rows and the pace topic 'observation' 3"):
        extractor.push('observation', messages.table('a', [[1.0], [2.0], [3.0]]), 0)


def test_pace_that_gives_no_feature(messages):
    extractor = FeatureExtractor(
        feature_map({'topic': 'cmd_vel', 'field': 'linear.x'}, pace='observation')
    )
    extractor.push('cmd_vel', messages.twist(x=9.0), 0)
    rows = extractor.push('observation', messages.table('a', [[1.0], [2.0]]), 0)
    assert rows.values.tolist() == [[9.0], [9.0]]
    extractor = FeatureExtractor(feature_map({'topic': 'cmd_vel', 'field': 'linear.x'}))
    assert extractor.push('scan', messages.scan([]), 0).values.shape == (1, 1)


def observation(messages, step, rows):
    """Return a table of (x, y, episode, true_cost) rows."""
    return (
        '/observation',
        messages.table(
            ['x', 'y', 'episode', 'true_cost'],
            np.array(rows, dtype=np.float32),
            stamp_ns=step * SECOND,
        ),
        step,
    )


def test_extract_tells_robots_episodes_and_repeats_apart(messages, write_bag):
    first = write_bag(
        [
            observation(messages, 1, [[0.1, 0.2, 0, 0], [0.3, 0.4, 0, 1]]),
            observation(messages, 1, [[0.1, 0.2, 0, 0], [0.3, 0.4, 0, 1]]),
            observation(messages, 2, [[0.5, 0.6, 1, 0], [0.7, 0.8, 0, 0]]),
            ('/cmd_vel', messages.twist(), 2),
        ],
        'first',
    )
    second = write_bag(
        [('/observation', messages.table('xy', [[0.0, 1.0]], stamp_ns=1), 5)], 'second'
    )
    calls = []
    data = extract(
        [first, second], load_feature_map('simple_nav'), progress=lambda *call: calls.append(call)
    )
    assert data.names == ('x', 'y')
    expected = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8], [0, 1]], dtype=np.float32)
    assert data.values.tolist() == expected.tolist()
    assert data.stamps_ns.tolist() == [SECOND, SECOND, 2 * SECOND, 2 * SECOND, 1]
    assert data.episodes.tolist() == [0, 2, 1, 2, 3]
    np.testing.assert_equal(data.true_cost, [0, 1, 0, 0, np.nan])
    assert data.sources == tuple(Recording(path).fingerprint() for path in (first, second))
    assert calls == [(3, 4), (4, 4)]
    assert extract([second], load_feature_map('simple_nav')).true_cost is None


def test_extract_equals_pushing_every_message(messages, write_bag):
    rng = np.random.default_rng(0)
    entries = []
    for step in range(200):
        topic, message = [
            ('/scan', messages.scan(rng.uniform(0, 4, 8), stamp_ns=1 + step * SECOND // 10)),
            ('/cmd_vel', messages.twist(x=rng.normal())),
        ][int(rng.integers(2))]
        entries.append((topic, message, 1 + step * SECOND // 10))
    bag = write_bag(entries)
    wanted = feature_map(
        {'topic': 'scan', 'field': 'ranges[0:4]', 'reduce': 'mean'},
        {'topic': 'cmd_vel', 'field': 'linear.x'},
        max_age=0.3,
    )
    extractor = FeatureExtractor(wanted)
    rows = [r for entry in entries if (r := extractor.push(*entry)) is not None]
    data = extract([bag], wanted)
    assert data.values.tobytes() == np.concatenate([r.values for r in rows]).tobytes()
    assert data.stamps_ns.tolist() == [r.stamp_ns for r in rows]
    assert np.isnan(data.values[:, 1]).any()
    assert set(data.episodes) == {0}


def test_extract_refuses(messages, write_bag):
    bag = write_bag([('/scan', messages.scan([1.0]), 1), ('/cmd_vel', messages.twist(), 2)])
    with pytest.raises(OccError, match='there are no recordings'):
        extract([], feature_map({'topic': 'scan', 'field': 'range_max'}))
    with pytest.raises(OccError, match="no topic 'odom'; its topics are /cmd_vel, /scan"):
        extract([bag], feature_map({'topic': 'odom', 'field': 'x'}))
    path = bag / 'metadata.yaml'
    path.unlink()
    tables = write_bag(
        [('/observation', messages.table(['x', 'y', 'episode'], [[0.0, 0.0, np.nan]]), 1)], 'tables'
    )
    with pytest.raises(OccError, match="not finite in the column 'episode'"):
        extract([tables], load_feature_map('simple_nav'))


def test_real_robot(robots):
    bag = robots / 'safe_tb3_tarunreddyy'
    wanted = feature_map(
        {'topic': 'odom', 'field': 'twist.twist.linear.x'},
        {'topic': 'odom', 'field': 'twist.twist.angular.z'},
        {'topic': 'scan', 'field': 'ranges[0:20]', 'reduce': 'min', 'missing': 'max_range'},
    )
    data = extract([bag], wanted)
    with AnyReader([bag]) as reader:
        decoded = [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
            if connection.topic in ('/odom', '/scan')
        ]
    expected, odom = [], None
    for topic, message in decoded:
        if topic == '/odom':
            odom = message.twist.twist
            continue
        ranges = message.ranges[:20].astype(np.float64)
        ranges[~np.isfinite(ranges) | (ranges == 0)] = message.range_max
        expected.append([odom.linear.x, odom.angular.z, ranges.min()] if odom else [np.nan] * 3)
    assert len(data) == len(expected) == 140
    held = np.isfinite(data.values).all(axis=1)
    assert held.mean() > 0.95
    np.testing.assert_array_equal(data.values[held], np.array(expected)[held])
    assert data.values[held, 0].max() == pytest.approx(0.2, abs=0.01)


def test_rclpy_and_rosbags_give_the_same_bits(messages):
    serialization = pytest.importorskip('rclpy.serialization')
    sensor = pytest.importorskip('sensor_msgs.msg')
    rng = np.random.default_rng(1)
    sent = [
        ('scan', 'LaserScan', messages.scan(rng.normal(2, 1, 40), stamp_ns=5, range_max=3.25)),
        ('imu', 'Imu', messages.imu(messages.quaternion(*rng.normal(size=4)), stamp_ns=5)),
        (
            'table',
            'PointCloud2',
            messages.table('ab', rng.normal(size=(1, 2)).astype(np.float32), stamp_ns=5),
        ),
    ]
    wanted = feature_map(
        {'topic': 'scan', 'field': 'ranges[3:20]', 'reduce': 'mean'},
        {'topic': 'scan', 'field': 'ranges', 'reduce': 'norm', 'missing': 'max_range'},
        {'topic': 'scan', 'field': 'ranges[7]'},
        {'topic': 'scan', 'field': 'ranges', 'degrees': (-30.0, 100.0), 'reduce': 'min'},
        {'topic': 'imu', 'field': 'orientation', 'transform': 'yaw'},
        {'topic': 'table', 'column': 'b'},
        pace='table',
    )
    ours, theirs = FeatureExtractor(wanted), FeatureExtractor(wanted)
    for topic, kind, message in sent:
        data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
        rows = ours.push(topic, message, 0)
        live = serialization.deserialize_message(data, getattr(sensor, kind))
        live_rows = theirs.push(topic, live, 0)
    assert np.isfinite(rows.values).all()
    assert rows.values.tobytes() == live_rows.values.tobytes()
    assert (rows.stamp_ns, rows.table.names) == (live_rows.stamp_ns, live_rows.table.names)


def test_a_blind_scanner_is_not_a_free_road(messages):
    """NaN and 0 read as range_max only beside a beam that says something."""
    reading = Reading('scan', field='ranges[:]', reduce='min', missing='max_range')
    reader = MessageReader([('d', reading)])
    nan, inf = float('nan'), float('inf')
    for blind in ([nan, nan], [0.0, 0.0], [nan, 0.0]):
        assert np.isnan(reader.read(messages.scan(blind))).all()
    assert reader.read(messages.scan([nan, inf])) == messages.scan([1.0]).range_max
    assert reader.read(messages.scan([0.0, 0.5])) == 0.5


def test_other_values_under_the_same_stamp_are_no_repeat(messages):
    extractor = FeatureExtractor(
        FeatureMap('scan', 1.0, (FeatureSource('d', 'scan', field='ranges[:]', reduce='min'),))
    )
    first, same, other = (
        extractor.push('scan', messages.scan(ranges, stamp_ns=5), 0)
        for ranges in ([1.0], [1.0], [0.5])
    )
    assert [rows.repeat for rows in (first, same, other)] == [False, True, False]
