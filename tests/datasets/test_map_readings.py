# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a map can read of messages beyond plain fields; live as in recordings, bit for bit."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.documents import dump_yaml, parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.paths import number_in
from occ_constraints_pkg.rosbag.recording import Recording
from recordings import write_typed
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
SECOND = 10**9
NAN = math.nan
PX4 = 'uint64 timestamp\nfloat32[4] q\nfloat32[] other\n'
HAZARDS = 'std_msgs/Header header\nlab_msgs/Hazard[] detections\n'


@pytest.fixture(scope='module')
def store():
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(PX4, 'px4_msgs/msg/VehicleAttitude'))
    store.register(get_types_from_msg(PX4, 'lab_msgs/msg/Attitude'))
    store.register(
        get_types_from_msg('uint8 BUMP=1\nuint8 type\nfloat32 size\n', 'lab_msgs/msg/Hazard')
    )
    store.register(get_types_from_msg(HAZARDS, 'lab_msgs/msg/Hazards'))
    return store


def feature_map(*entries, pace='t', max_age=0.5):
    """Return a map of entries in YAML, by way of its document and back."""
    text = f'schema_version: 1\npace: {pace}\nmax_age: {max_age}\nfeatures:\n'
    text += ''.join(f'- {{name: f{i}, {entry}}}\n' for i, entry in enumerate(entries))
    found = FeatureMap.from_document(parse_yaml(text, 'map'), 'map', text=text)
    again = FeatureMap.from_document(parse_yaml(dump_yaml(found.to_document()), 'map'), 'map')
    assert again == found
    return found


def rows_of(path, wanted):
    """Return the features of a recording, which extraction and the live way give alike."""
    recording, extractor = Recording(path), FeatureExtractor(wanted)
    rows = []
    for raw in recording.messages([recording.find(name) for name in wanted.topics]):
        result = extractor.push(raw.topic, recording.decode(raw), raw.log_time_ns)
        if result is not None and not result.repeat:
            rows.append(result.values[0])
    values = extract([path], wanted).values
    np.testing.assert_array_equal(values, np.array(rows))
    known = ~np.isnan(values)
    assert values[known].tobytes() == np.array(rows)[known].tobytes()
    return values


def test_joints_by_name_whatever_their_order(messages, write_bag):
    bag = write_bag(
        [
            (
                '/t',
                messages.joints(1 * SECOND, ['pan', 'left/elbow'], [1.0, 2.0], [], [5.0, 6.0]),
                0,
            ),
            (
                '/t',
                messages.joints(2 * SECOND, ['left/elbow', 'pan'], [3.0, 4.0], [], [7.0, 8.0]),
                1,
            ),
            (
                '/t',
                messages.joints(3 * SECOND, ['left/elbow', 'pan'], [9.0, 9.5], [0.1, 0.2], []),
                2,
            ),
        ]
    )
    wanted = feature_map(
        "topic: t, field: 'position[name=left/elbow]'",
        "topic: t, field: 'effort[name=pan]|abs'",
        "topic: t, field: 'velocity[name=pan]'",
        "topic: t, field: 'position[name=pan]', minus: {topic: t, field: 'position[0]'}",
    )
    np.testing.assert_equal(
        rows_of(bag, wanted),
        # What a publisher leaves empty it does not know.
        [[2.0, 5.0, NAN, 0.0], [3.0, 8.0, NAN, 1.0], [9.0, NAN, 0.2, 0.5]],
    )


def test_arm_and_gripper_on_one_topic(messages, write_bag):
    entries = []
    for tick in range(4):
        time = SECOND + tick * SECOND // 10
        entries.append(('/t', messages.joints(time, ['elbow'], [tick]), time))
        entries.append(('/t', messages.joints(time + 1000, ['finger'], [10 + tick]), time + 1000))
    # The gripper stops.
    entries += [
        ('/t', messages.joints(time := 2 * SECOND + tick, ['elbow'], [50.0 + tick]), time)
        for tick in range(2)
    ]
    wanted = feature_map(
        "topic: t, field: 'position[name=elbow]'",
        "topic: t, field: 'position[name=finger]'",
        "topic: t, field: 'position[name=finger]', max_age: 5",
    )
    values = rows_of(write_bag(entries), wanted)
    expected = [[0, NAN, NAN], [0, 10, 10], [1, 10, 10], [1, 11, 11], [2, 11, 11], [2, 12, 12]]
    expected += [[3, 12, 12], [3, 13, 13], [50, NAN, 13], [51, NAN, 13]]
    np.testing.assert_equal(values, expected)


def test_a_name_that_no_message_has(messages, write_bag):
    bag = write_bag([('/t', messages.joints(SECOND, ['shoulder', 'elbow'], [1.0, 2.0]), 0)] * 3)
    for entry in ("'position[name=elbo]'", "'position[name=elbo]', max_age: 3"):
        with pytest.raises(
            OccError, match=r"no message has name 'elbo'; did you mean 'elbow'"
        ) as e:
            extract([bag], feature_map(f'topic: t, field: {entry}'))
        assert 'the last one has shoulder, elbow' in str(e.value)
    with pytest.raises(OccError, match="neither position nor the message has 'nam'"):
        extract([bag], feature_map("topic: t, field: 'position[nam=elbow]'"))
    extractor = FeatureExtractor(feature_map("topic: t, field: 'position[name=elbo]'"))
    extractor.push('t', messages.joints(SECOND, ['shoulder'], [1.0]), 0)
    assert "no message has name 'elbo'" in extractor.fault


def test_diagnostics_by_name_and_key(messages, write_bag):
    types = STORE.types

    def message(stamp_ns, voltage, level):
        def status(name, level, **values):
            pairs = [types['diagnostic_msgs/msg/KeyValue'](*pair) for pair in values.items()]
            return types['diagnostic_msgs/msg/DiagnosticStatus'](level, name, '', '', pairs)

        return types['diagnostic_msgs/msg/DiagnosticArray'](
            messages.header(stamp_ns),
            [status('motor', 0, Voltage='1'), status('Battery 1', level, Voltage=voltage)],
        )

    bag = write_bag(
        [('/t', message(SECOND, '24.5 V', 1), 0), ('/t', message(2 * SECOND, 'N/A', 2), 1)]
    )
    wanted = feature_map(
        "topic: t, field: 'status[name=Battery 1].values[key=Voltage].value'",
        "topic: t, field: 'status[name=Battery 1].level'",
        "topic: t, field: 'status|count'",
    )
    np.testing.assert_equal(rows_of(bag, wanted), [[24.5, 1, 2], [NAN, 2, 2]])
    with pytest.raises(OccError, match="no message has key 'Volt'; did you mean 'Voltage'"):
        extract([bag], feature_map("topic: t, field: 'status[name=motor].values[key=Volt].value'"))


@pytest.mark.parametrize(
    ('text', 'number'),
    [
        ('12', 12), (' -1.5e3 ', -1500), ('12.30 V', 12.3), ('98 %', 98), ('98%', 98), ('True', 1),
        ('40 °C', 40), ('1.2 m/s', 1.2), ('0.5 m/s2', 0.5), ('false', 0), ('.5', 0.5),
        ('N/A', None), ('', None), ('12:30', None), ('192.168.0.1', None), ('3 of 4', None),
        ('1,5', None), ('0x1F', None),
    ],
)  # fmt: skip
def test_numbers_in_texts(text, number):
    assert number_in(text) == number


def euler(roll, pitch, yaw):
    """Return the quaternion x, y, z, w of turns about the fixed axes x, y and z, in this order."""
    cr, sr, cp, sp, cy, sy = (
        function(angle / 2) for angle in (roll, pitch, yaw) for function in (math.cos, math.sin)
    )
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


@settings(max_examples=30)
@given(
    angles=st.lists(
        st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)),
        min_size=1,
        max_size=5,
    ),
    length=st.floats(0.1, 10.0),
)
def test_angles_of_quaternions(angles, length, store, messages, tmp_path_factory):
    entries, expected = [], []
    for tick, (roll, pitch, yaw) in enumerate(angles, 1):
        x, y, z, w = (length * part for part in euler(roll, pitch, yaw))
        expected.append([roll, pitch, yaw, math.acos(math.cos(roll) * math.cos(pitch))])
        q = np.array([w, x, y, z], dtype=np.float32)
        attitude = store.types['lab_msgs/msg/Attitude'](tick, q[[1, 2, 3, 0]], q)
        entries += [
            ('/px4', store.types['px4_msgs/msg/VehicleAttitude'](tick, q, q), tick),
            ('/lab', attitude, tick),
            ('/t', messages.imu(messages.quaternion(x, y, z, w), stamp_ns=tick), tick),
        ]
    path = write_typed(tmp_path_factory.mktemp('angles') / 'a.mcap', store, entries)
    wanted = feature_map(
        *(f'topic: t, field: orientation|{angle}' for angle in ('roll', 'pitch', 'yaw', 'tilt')),
        *(
            f'topic: px4, field: q, transform: [{angle}]'
            for angle in ('roll', 'pitch', 'yaw', 'tilt')
        ),
        *(
            f'topic: lab, field: q|{angle}, order: xyzw'
            for angle in ('roll', 'pitch', 'yaw', 'tilt')
        ),
        'topic: lab, field: other|tilt, order: wxyz',
    )
    values = rows_of(path, wanted)
    np.testing.assert_allclose(values[:, :4], expected, atol=1e-6)
    for first in (4, 8):
        np.testing.assert_allclose(values[:, first : first + 4], expected, atol=2e-3)
    np.testing.assert_allclose(values[:, 12], values[:, 7])


def test_a_quaternion_in_an_array_needs_its_order(store, tmp_path):
    message = store.types['lab_msgs/msg/Attitude'](
        1, np.zeros(4, np.float32), np.zeros(3, np.float32)
    )
    for field, sentence in (
        ('q', 'the key "order" is missing'),
        ('other', 'allowed is a quaternion'),
    ):
        extractor = FeatureExtractor(feature_map(f'topic: t, field: {field}|roll'))
        with pytest.raises(OccError, match=sentence):
            extractor.push('t', message, 0)
    zeros = FeatureExtractor(feature_map('topic: t, field: q|tilt, order: xyzw'))
    assert np.isnan(zeros.push('t', message, 0).values).all()


def test_counts_and_fields_of_elements(messages, store, tmp_path):
    types = store.types

    def hazards(stamp, *pairs):
        found = [types['lab_msgs/msg/Hazard'](*pair) for pair in pairs]
        return types['lab_msgs/msg/Hazards'](messages.header(stamp), found)

    found = [(), ((1, 0.5), (2, 0.25)), ((1, 3.0), (1, 4.0), (2, 1.0))]
    entries = [('/t', hazards(stamp, *pairs), stamp) for stamp, pairs in enumerate(found, 1)]
    bag = write_typed(tmp_path / 'a.mcap', store, entries)
    wanted = feature_map(
        'topic: t, field: detections, reduce: count',
        "topic: t, field: 'detections[type=1]|count'",
        "topic: t, field: 'detections[:].size|max'",
        "topic: t, field: 'detections[type=2].size'",
    )
    np.testing.assert_equal(
        rows_of(bag, wanted), [[0, 0, NAN, NAN], [2, 1, 0.5, 0.25], [3, 2, 4.0, 1.0]]
    )


@pytest.mark.parametrize(
    ('keys', 'expected'),
    [
        # 0.05 is below range_min 0.125, 65.5 beyond range_max 4.0.
        ('missing: max_range', [0.05, 4.0, NAN, 0.05]),
        ('missing: drop', [0.05, NAN, NAN, 0.05]),
        ('missing: drop, range_limits: own', [2.0, NAN, NAN, NAN]),
        ('missing: max_range, range_limits: own', [2.0, 4.0, NAN, 4.0]),
        ('missing: max_range, range_limits: ignore', [0.05, 4.0, 65.5, 0.05]),
        ('missing: drop, range_limits: [1, 100]', [2.0, 65.5, 65.5, NAN]),
        ('range_limits: own', [NAN, NAN, NAN, NAN]),
        ('', [0.05, 65.5, 65.5, 0.0]),
    ],
)
def test_limits_of_ranges(messages, write_bag, keys, expected):
    ranges = [[0.05, 2.0, 65.5], [65.5, math.inf], [65.5, 65.5], [0.05, 0.0, math.inf]]
    bag = write_bag(
        [
            ('/t', messages.scan(item, stamp_ns=n + 1, least=0.125), n)
            for n, item in enumerate(ranges)
        ]
    )
    wanted = feature_map(f'topic: t, field: ranges, reduce: min{", " if keys else ""}{keys}')
    np.testing.assert_allclose(rows_of(bag, wanted)[:, 0], expected, rtol=1e-6)


def test_too_close_to_measure_is_within_all_limits(messages):
    wanted = feature_map('topic: t, field: ranges|min, missing: drop, range_limits: own')
    row = FeatureExtractor(wanted).push('t', messages.scan([1.0, -math.inf]), 0)
    assert row.values[0, 0] == -math.inf


def test_own_limits_need_a_message_that_has_them(messages):
    extractor = FeatureExtractor(feature_map('topic: t, field: linear.x, range_limits: own'))
    with pytest.raises(OccError, match="range_limits: own, but .* has no field 'range_min'"):
        extractor.push('t', messages.twist(), 0)


def test_the_own_body_is_left_out(messages, write_bag):
    # A beam each 10 degrees; what is at 150 to 210 degrees is the robot's mast.
    ranges = np.full(36, 3.0)
    ranges[15:21] = 0.18
    ranges[3] = 1.0
    step = math.radians(10)
    bag = write_bag([('/t', messages.scan(ranges, stamp_ns=1, step=step), 0)])
    wanted = feature_map(
        'topic: t, field: ranges|min',
        'topic: t, field: ranges|min, exclude_degrees: [[150, 210]]',
        'topic: t, field: ranges|min, degrees: [100, 260], exclude_degrees: [[-210, -150], [0, 5]]',
        'topic: t, field: ranges|count, exclude_degrees: [[150, 210]]',
        'topic: t, field: ranges, sectors: 8, reduce: min, exclude_degrees: [[150, 205]]',
    )
    values = rows_of(bag, wanted)[0]
    assert values[:4].tolist() == pytest.approx([0.18, 1.0, 3.0, 30.0])
    # The sector from 157.5 to 202.5 degrees is gone, the next begins behind the mast.
    assert 'f4_rear' not in wanted.names
    assert len(values) == 11
    assert values[4:].min() == 1.0
    with pytest.raises(OccError, match='all of the 4 sectors'):
        feature_map('topic: t, field: ranges, sectors: 4, reduce: min, exclude_degrees: [[0, 360]]')
    nothing = feature_map(
        'topic: t, field: ranges|min, degrees: [0, 90], exclude_degrees: [[0, 90]]'
    )
    with pytest.raises(OccError, match='besides exclude_degrees'):
        FeatureExtractor(nothing).push('t', messages.scan(ranges, step=step), 0)


def test_age_by_arrival_joins_clocks(messages, write_bag):
    """A lidar in a clock of its own has no age by stamps; by arrival it has."""
    entries = []
    for tick in range(6):
        time = 1000 * SECOND + tick * SECOND // 10
        entries.append(('/odom', messages.odometry(stamp_ns=time, x=tick), time))
        entries.append(
            ('/t', messages.scan([1.0], stamp_ns=SECOND + tick * SECOND // 10), time + 5)
        )
    wanted = feature_map(
        'topic: t, field: ranges|min',
        'topic: odom, field: twist.twist.linear.x',
        'topic: odom, field: twist.twist.linear.x, age_by: arrival',
        'topic: odom, field: twist.twist.linear.x, age_by: arrival, max_age: 0.000000001',
    )
    values = rows_of(write_bag(entries), wanted)
    np.testing.assert_equal(values[:, 1], [NAN] * 6)
    np.testing.assert_equal(values[:, 2], range(6))
    np.testing.assert_equal(values[:, 3], [NAN] * 6)


def test_a_transform_of_what_is_subtracted(messages, write_bag):
    entries = [
        (topic, messages.odometry(stamp_ns=SECOND + tick * SECOND // 4, x=x), tick)
        for tick in range(3)
        for topic, x in (('/a', -float(tick)), ('/t', float(tick)))
    ]
    x = 'field: twist.twist.linear.x'
    wanted = feature_map(
        f'topic: t, {x}, minus: {{topic: a, {x}|abs}}',
        f'topic: t, {x}, minus: {{topic: a, {x}, transform: [{{scale: -2}}, {{offset: 1}}]}}',
        f'topic: t, {x}, minus: {{topic: a, {x}|rate}}, transform: abs',
    )
    np.testing.assert_equal(
        rows_of(write_bag(entries), wanted), [[0, -1, NAN], [0, -2, 5], [0, -3, 6]]
    )


def test_one_path_for_stamped_and_plain_messages(messages, write_entries, tmp_path):
    plain = messages.twist(x=1.5)
    stamped = STORE.types['geometry_msgs/msg/TwistStamped'](
        messages.header(SECOND), messages.twist(x=2.5)
    )
    for number, (message, x) in enumerate([(plain, 1.5), (stamped, 2.5)]):
        bag = write_entries(tmp_path / str(number), [('/t', message, 7)])
        wanted = feature_map('topic: t, field: linear.x', 'topic: t, field: twist.linear.x')
        assert rows_of(bag, wanted).tolist() == [[x, x]]
    with pytest.raises(OccError, match="the message has no 'twirl'"):
        extract([bag], feature_map('topic: t, field: twirl.linear.x'))


@pytest.mark.parametrize(
    ('entry', 'sentence'),
    [
        ('topic: t, field: q, order: xyzw', "order: got 'xyzw' without an angle"),
        ('topic: t, field: q|roll, order: xywz', "got 'xywz'; did you mean 'xyzw'?"),
        ("topic: t, field: 'a[:].b'", 'the key "reduce" is missing'),
        ('topic: t, field: r|min, range_limits: [3, 1]', 'range_limits: got [3, 1]'),
        ('topic: t, field: r|min, range_limits: mine', 'allowed is own, ignore or [low, high]'),
        ('topic: t, field: r|min, exclude_degrees: [[3, 1]]', 'exclude_degrees[0]: got [3, 1]'),
        ("topic: t, field: 'r[0:3]|min', exclude_degrees: [[1, 3]]", 'beside a sector'),
        ('topic: t, field: r|min, max_age: 0', 'max_age: got 0; allowed is a number above 0'),
        ('topic: t, field: r|min, max_age: .nan', 'max_age: got nan'),
        ('topic: t, field: r|min, age_by: log', "age_by: got 'log'; allowed are stamp, arrival"),
        ('topic: t, column: r, range_limits: own', "range_limits: got 'own' for a table column"),
        ('topic: t, field: r, minus: {topic: t, field: r, transform: rat}', "did you mean 'rate'"),
        ('topic: t, field: q|abs|tilt', 'after another step; allowed is tilt as the first'),
    ],
)  # fmt: skip
def test_mistakes_are_told_with_their_line(entry, sentence):
    with pytest.raises(OccError) as caught:
        feature_map('topic: t, field: x', entry)
    assert sentence in str(caught.value)
    assert str(caught.value).startswith('map, line 6: features[1]')
